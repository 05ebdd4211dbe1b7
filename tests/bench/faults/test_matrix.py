"""What is tried covers every kind of fault that there is, wherever it has a place."""

from pathlib import Path

import pytest

from norton_bench.faults.campaign import cases, host_losses
from norton_bench.faults.case import Expected
from norton_bench.faults.host_loss import SIGNALS
from norton_bench.rig.load import load_rig
from norton_sim.faults.injection import read_faults
from norton_sim.faults.schema import KINDS

RIGS = Path(__file__).parents[3] / "rigs"


@pytest.mark.parametrize("name", ["sim-odrive", "sim-dbc", "sim-variable-stiffness"])
def test_every_case_has_a_place_on_the_rig_and_a_name_of_its_own(name: str) -> None:
    rig = load_rig(RIGS / f"{name}.toml")
    found = cases(rig)
    tables = [dict(case.table) for case in found]
    assert len(read_faults(tables, rig.wiring, place="", section="fault")) == len(found)
    assert len({(case.name, case.on) for case in found}) == len(found)


def test_every_kind_is_tried() -> None:
    tried = {case.table["kind"] for case in cases(load_rig(RIGS / "sim-odrive.toml"))}
    assert tried == set(KINDS)
    assert {case.table["kind"] for case in host_losses()} == set(SIGNALS)


def test_there_are_at_least_forty_on_one_family_alone() -> None:
    assert len(cases(load_rig(RIGS / "sim-odrive.toml"))) + len(host_losses()) >= 40


def test_the_short_round_has_both_kinds_of_ending() -> None:
    quick = [case for case in cases(load_rig(RIGS / "sim-odrive.toml")) if case.quick]
    assert {case.expected for case in quick} == set(Expected)
    assert 8 <= len(quick) <= 16


def test_sizes_follow_the_rigs_limits() -> None:
    rig = load_rig(RIGS / "sim-odrive.toml")
    beyond = next(case for case in cases(rig) if case.name == "reads beyond the limit")
    assert beyond.table["torque"] == f"{1.2 * rig.limits.torque_nm:g} N*m"
