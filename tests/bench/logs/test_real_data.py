"""Measurements by other people, and what they published of them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from norton_bench.logs.column_map import ColumnMap, load_map
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.results import LogFit
from norton_bench.models.parameters import Status
from tests.bench.logs.machines import Columns, estimate
from tests.bench.real_data import ROOT, data_file

# Janot, Gautier and Brunot (2019), least squares on the inverse dynamic model, and how near is near.
EMPS = {
    "inertia": (95.1089, 0.005),
    "viscous_damping": (203.5034, 0.02),
    "coulomb_torque": (20.3935, 0.02),
    "offset": (-3.1648, 0.05),
}


def shipped(name: str) -> ColumnMap:
    return load_map(ROOT / "examples" / "logs" / f"{name}.toml")


@pytest.fixture(scope="module")
def emps() -> LogFit:
    return fit_logs(Request((data_file("emps", "DATA_EMPS.mat"),), shipped("emps"), model="coulomb-viscous"))


def check_emps(fit: LogFit, looser: float = 1.0) -> None:
    for name, (published, share) in EMPS.items():
        found = estimate(fit, name)
        assert found.value == pytest.approx(published, rel=share * looser)


@pytest.mark.long
def test_emps_is_what_its_authors_published(emps: LogFit) -> None:
    """But their law does not hold: what other laws agree in is known all the same."""
    check_emps(emps)
    assert estimate(emps, "inertia").status is Status.VALID
    assert {each.status for each in emps.totals} == {Status.VALID}
    assert {estimate(emps, name).status for name in ("coulomb_torque", "viscous_damping")} == {Status.INADEQUATE}
    assert emps.train.exertion is not None
    assert emps.train.exertion.relative <= 0.0408
    by_model = {step.model: step for step in emps.ladder}
    assert by_model["coulomb-viscous-asymmetric"].train_relative <= 0.0311


def test_emps_best_is_lower_and_not_by_fitting_noise(emps: LogFit) -> None:
    (best,) = [step for step in emps.ladder if step.selected]
    published = next(step for step in emps.ladder if step.model == "coulomb-viscous")
    assert best.train_relative < 0.0311
    assert best.held_out_relative < published.held_out_relative


@pytest.mark.long
def test_emps_finds_its_delay_and_a_model_of_few_numbers() -> None:
    """The command is held for a sample: it acts half a sample later, and whatever the drive's own lag is."""
    few = shipped("emps").model.model_copy(update={"candidates": ("stribeck-asymmetric", "film-asymmetric")})
    quick = replace(shipped("emps"), model=few)
    fit = fit_logs(Request((data_file("emps", "DATA_EMPS.mat"),), quick))
    assert fit.train.exertion is not None
    assert fit.train.exertion.relative <= 0.022
    assert len(fit.estimates) <= 15
    assert all(each.status is Status.VALID for each in fit.estimates)
    assert 0.4e-3 < estimate(fit, "command_shift").value < 1.0e-3


@pytest.mark.long
def test_emps_halves_agree_and_neither_is_spoilt_by_what_a_quarter_of_it_does_not_excite() -> None:
    """The first quarters move one way most of the time: fitted alone, they would have no friction the other way."""
    column_map = shipped("emps")
    few = column_map.model.model_copy(update={"candidates": ("film-asymmetric",)})
    path = (data_file("emps", "DATA_EMPS.mat"),)
    halves = [fit_logs(Request(path, replace(column_map, model=few), train=part)) for part in ("0:12.4 s", "12.4: s")]
    for one, other in zip(*(half.estimates for half in halves), strict=True):
        assert one.status is other.status is Status.VALID, (one, other)
        assert abs(one.value - other.value) < 2.0 * np.hypot(one.std, other.std), (one, other)
        assert one.std < 4.0 * other.std < 16.0 * one.std


def test_emps_moves_in_its_own_loop_as_it_was_measured(emps: LogFit) -> None:
    assert emps.train.motion is not None
    assert emps.train.motion.relative < 1e-3


def emps_columns() -> Columns:
    found = loadmat(data_file("emps", "DATA_EMPS.mat"), squeeze_me=True)
    return {name: np.atleast_1d(values) for name, values in found.items() if not name.startswith("__")}


def shorter(found: Columns) -> Columns:
    return {name: values[:18000] for name, values in found.items()}


def slower(found: Columns) -> Columns:
    return {name: values[::2] if values.size > 1 else values for name, values in found.items()}


def rows_without_extras(found: Columns) -> Columns:
    return {name: found[name][None, :] for name in ("t", "qm", "vir", "gtau")}


@pytest.mark.parametrize("change", [shorter, slower, rows_without_extras], ids=lambda change: change.__name__)
def test_the_same_map_fits_other_records_of_that_rig(tmp_path: Path, change: Callable[[Columns], Columns]) -> None:
    savemat(tmp_path / "other.mat", change(emps_columns()))
    column_map = shipped("emps")
    # The ladder has nothing to say here, and takes its time.
    only = {"candidates": ("coulomb-viscous",), "friction": "coulomb-viscous"}
    alone = replace(column_map, model=column_map.model.model_copy(update=only))
    # The law does not hold near rest, and a part of the record has another share of that: 3.2 % of the damping.
    check_emps(fit_logs(Request((tmp_path / "other.mat",), alone)), looser=1.5)


@pytest.mark.long
def test_tribometer_in_presliding() -> None:
    fit = fit_logs(Request((data_file("tribometer", "first_half.tsv"),), shipped("tribometer")))
    assert fit.train.exertion is not None
    assert fit.train.exertion.relative <= 0.048
    (best,) = [step for step in fit.ladder if step.selected]
    assert best.held_out_relative <= 0.048
    assert fit.train.motion is None
    assert not fit.doubtful


@pytest.mark.long
def test_the_tribometers_second_half_is_foretold_by_its_first_as_a_record_of_its_own(tmp_path: Path) -> None:
    header, *rows = data_file("tribometer", "first_half.tsv").read_text().splitlines()
    halves = tmp_path / "first.tsv", tmp_path / "second.tsv"
    middle = len(rows) // 2
    for path, part in zip(halves, (rows[:middle], rows[middle:]), strict=True):
        path.write_text("\n".join([header, *part]))
    column_map = shipped("tribometer")
    for name, limit in (("elasto-plastic-asymmetric", 0.045), ("dahl", 0.25)):
        one = column_map.model.model_copy(update={"candidates": (name,), "friction": name})
        fit = fit_logs(Request(halves, replace(column_map, model=one), test="second.tsv"))
        assert fit.test.exertion is not None
        assert fit.test.exertion.relative <= limit
        assert not fit.alarms
