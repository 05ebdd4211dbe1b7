"""The actuator's second drive: commanded, watched, recorded and idled with the others, over the same bus."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import ExperimentError, RigError, SafetyStopError
from norton_bench.guard.check import Limited
from norton_bench.procedures.waves import coasting
from norton_bench.records import Measured, join
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use
from norton_drivers.errors import WiringError
from norton_drivers.readings import DriveState
from norton_sim.faults.schema import BusOff, DriveError, Dropout, Fault, Stuck, Undervoltage
from tests.bench.bench_in_simulation import Bench, opened

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-variable-stiffness.toml")
WATCHDOG_NS = 310_000_000  # the rig's 300 ms, and what is on its way


@pytest.fixture
def bench() -> Iterator[Bench]:
    with opened(RIG) as made:
        yield made


def held(modulation: float, ticks: int = 600) -> Segment:
    return replace(coasting("test", "held", Use.PREPARE, np.zeros(ticks)), modulation=np.full(ticks, modulation))


def run(bench: Bench, segment: Segment) -> Measured:
    with bench.loop.running():
        return bench.loop.run(segment)


def test_it_is_commanded_and_all_it_says_is_put_away(bench):
    run(bench, held(2.0))
    everything = join(bench.parts)
    ticks = everything.ticks
    assert np.all(ticks["modulation"] == 2.0)
    travel = bench.backend.world.plant._truth.modulator.angle_rad(2.0)
    assert ticks["modulator_position_rad"][-1] == pytest.approx(travel, abs=1e-3)
    assert ticks["modulator_motion_age_ns"].max() < 5_000_000
    assert 20 < ticks["modulator_transistor_temperature_c"][-1] < 40
    assert np.all(np.isfinite(ticks["load_transistor_temperature_c"][50:]))
    assert len(everything.modulator_motion) > 500
    assert everything.modulator_current["current_a"][-1] == pytest.approx(4.0, abs=0.1)
    assert bench.armed() == []
    assert all(drive.status().state is DriveState.IDLE for drive in bench.devices.drives)


def test_a_segment_that_says_nothing_of_it_leaves_it_at_zero(bench):
    assert np.all(run(bench, coasting("test", "rest", Use.PREPARE, np.zeros(50))).ticks["modulation"] == 0.0)


def test_more_than_its_limit_is_clipped_and_told(bench):
    ticks = run(bench, held(9.0, 100)).ticks
    assert np.all(ticks["modulation"] == 4.0)
    assert np.all(ticks["limited"] & Limited.MODULATION)


def test_what_is_no_number_is_not_sent(bench):
    with pytest.raises(SafetyStopError, match="asked for modulation nan: not a number"):
        run(bench, held(float("nan")))
    assert bench.armed() == []


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Dropout(on="modulator", at_s=0.3), "modulator encoder: silent"),
        (BusOff(on="modulator", at_s=0.3), "modulator encoder: silent"),
        (DriveError(on="modulator", at_s=0.3), "modulator drive: left its torque loop"),
        (Undervoltage(on="modulator", at_s=0.3), "modulator drive: left its torque loop"),
        (DriveError(on="actuator", at_s=0.3), "actuator drive: left its torque loop"),
    ],
)
def test_losing_any_drive_ends_with_all_of_them_idle(bench: Bench, fault: Fault, words: str):
    bench.backend.inject(fault)
    with pytest.raises(SafetyStopError, match=words):
        run(bench, held(3.0, 1000))
    bench.backend.world.advance(bench.backend.world.now_ns + WATCHDOG_NS)
    assert bench.armed() == []
    assert not bench.backend.world.plant.drives("modulator")


def test_one_that_never_speaks_is_named_before_anything_is_enabled(bench):
    bench.cut("modulator")
    with pytest.raises(ExperimentError, match="no readings from: modulator encoder"), bench.loop.running():
        pass


def test_its_watchdog_is_tried_with_the_others(bench):
    bench.devices.await_streams()
    found = bench.devices.verify_watchdogs()
    assert [finding.role for finding in found] == ["actuator", "load", "modulator"]
    assert all(finding.safe_after_s is not None for finding in found)


def test_a_unit_that_its_drive_does_not_take_is_refused():
    assert RIG.modulation is not None
    as_it_is = replace(RIG, modulation=replace(RIG.modulation, sent_as=None))
    words = r'\[modulator.command\] unit: "N\*m/rad", but driver = "odrive"'
    with pytest.raises(RigError, match=words), opened(as_it_is):
        pass


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("modulator", r"\[modulator\] is wired but \[simulated.modulator\] is missing"),
        ("actuator", r"\[modulator\] is wired but \[simulated.actuator\] has nothing that it could set"),
    ],
)
def test_a_simulation_without_one_is_refused(table: str, words: str):
    with pytest.raises(WiringError, match=words), opened(without(table)):
        pass


def without(table: str) -> Rig:
    """The true modulator missing, or the actuator another one."""
    simulated = dict(RIG.simulated)
    if table == "modulator":
        del simulated["modulator"]
    else:
        spring = {"stiffness": "3 N*m/rad"}
        simulated["actuator"] = {**simulated["actuator"], "model": "series_elastic", "spring": spring}
    return replace(RIG, simulated=simulated)


def test_one_that_does_not_follow_is_stopped_before_anything_is_tabulated_under_it(bench):
    run(bench, held(2.0))
    bench.backend.inject(Stuck(on="modulator", after="armed", at_s=0.2))
    plant = bench.backend.world.plant
    modulation = np.concatenate([np.full(200, 2.0), np.linspace(2.0, 3.0, 800)])
    with pytest.raises(SafetyStopError, match=r"modulator encoder: stands still at 0\.49"):
        run(bench, replace(held(2.0, 1000), modulation=modulation))
    assert bench.armed() == []
    assert plant.true_position_rad("modulator") == pytest.approx(0.5, abs=1e-3)


def test_one_that_was_freed_again_goes_on(bench):
    bench.backend.inject(Stuck(on="modulator", after="armed", at_s=0.05, lasts_s=0.15))
    ticks = run(bench, held(2.0, 1000)).ticks
    stands = ticks["modulator_position_rad"] == np.median(ticks["modulator_position_rad"][50:150])
    assert stands.sum() > 90
    assert ticks["modulator_position_rad"][-1] == pytest.approx(0.5, abs=1e-3)
