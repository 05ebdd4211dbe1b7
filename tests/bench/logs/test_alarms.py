"""What the verdict says where a fit does not hold, or where something else explains what friction was taken for."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.logs.alarms import alarms_of_motion
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.results import ErrorFigures, Step
from norton_bench.models.parameters import Status
from tests.bench.logs.machines import FREE, LOADED, Machine, column_map, estimate, fit_of, write_csv

HANGS_NM = 2.0
ANY_LAW = FREE.replace('candidates = ["coulomb-viscous"]', 'candidates = ["coulomb-viscous", "dahl"]')
ANY_LAW = ANY_LAW.replace('friction = "coulomb-viscous"\n', "")
RATIOS = FREE.replace('torque_gain = "2 N*m/A"\n', "")


def hanging(machine: Machine) -> dict:
    log = machine.log()
    return log | {"u": log["u"] + HANGS_NM * np.sin(log["q"]) / machine.gain}


def test_a_weight_that_the_map_does_not_know_is_named_and_passes_for_no_friction(tmp_path: Path) -> None:
    fit = fit_of(tmp_path, hanging(Machine()), ANY_LAW)
    assert fit.doubtful
    assert any("goes with the angle, as a weight does" in said and "gravity = true" in said for said in fit.verdict)
    known = fit_of(tmp_path, hanging(Machine()), ANY_LAW + "gravity = true\n")
    assert not known.doubtful
    assert estimate(known, "gravity_sine").value == pytest.approx(HANGS_NM, rel=0.01)


def test_a_load_that_hangs_in_the_test_alone_is_named(tmp_path: Path) -> None:
    paths = (
        write_csv(tmp_path / "train.csv", Machine().log()),
        write_csv(tmp_path / "test.csv", hanging(Machine(phases=(1.0, 0.2, 2.5), seed=3))),
    )
    fit = fit_logs(Request(paths, column_map(FREE), train="train.csv"))
    (alarm,) = fit.alarms
    assert "goes with the angle, as a weight does" in alarm


def test_ratios_raise_alarms_as_well(tmp_path: Path) -> None:
    paths = (
        write_csv(tmp_path / "train.csv", Machine().log()),
        write_csv(tmp_path / "test.csv", Machine(damping=0.75, seed=3).log()),
    )
    fit = fit_logs(Request(paths, column_map(RATIOS), train="train.csv"))
    (alarm,) = fit.alarms
    assert " A, is " in alarm
    assert "viscous damping" in alarm


@pytest.mark.parametrize(("error", "rings"), [(0.05, False), (0.11, False), (0.15, True), (0.8, True)])
def test_a_refined_fit_is_held_to_what_it_left_on_held_out_parts(error: float, rings: bool) -> None:
    ladder = [Step("coulomb-viscous", 0.04, 0.2, 0.1, False, ()), Step("stribeck", 0.04, 0.05, 0.01, True, ())]
    test = ErrorFigures(rms=error * 0.5, relative=error, mean_absolute=error * 0.4, unit="rad")
    told = alarms_of_motion(test, ladder)
    assert bool(told) is rings
    assert all(f"{error * 0.5:.3g} rad" in said for said in told)
    assert alarms_of_motion(None, ladder) == ()


def test_an_offset_that_is_let_drift_may_go_as_far_as_it_is_said_to(tmp_path: Path) -> None:
    """The deviation of the predictions grows with the time since the training."""
    machine = Machine(duration_s=40.0)
    log = machine.log()
    walk = np.cumsum(np.random.default_rng(5).standard_normal(log["t"].size)) * 0.15 * np.sqrt(1 / machine.rate_hz)
    fit = fit_of(tmp_path, log | {"u": log["u"] + walk / machine.gain}, FREE + 'drift = "2 s"\n', train="0:20 s")
    rows = fit.predictions
    assert rows is not None
    tested = np.array(rows.part) == "test"
    assert rows.deviation[tested].max() > 5 * rows.deviation[~tested].min()
    assert not fit.alarms


@pytest.fixture(scope="module")
def deflecting() -> dict:
    """Over ways that a contact follows like a spring, Dahl's of 3 N·m and 30 N·m/rad."""
    machine, finer = Machine(duration_s=30.0, rate_hz=200.0), 50
    log, step_s = machine.log(), 1 / (finer * machine.rate_hz)
    ways = 0.3 * machine.motion(step_s * np.arange(finer * log["t"].size))[1] * step_s
    held = np.zeros(ways.size)
    for k in range(1, held.size):
        held[k] = held[k - 1] + 30.0 * (1 - held[k - 1] / 3.0 * np.sign(ways[k])) * ways[k]
    q, v, a = (0.3 * each for each in machine.motion(log["t"]))
    noise = machine.noise * np.random.default_rng(1).standard_normal(q.size)
    return {"t": log["t"], "q": q, "w": v, "u": (0.01 * a + 0.3 * v + held[::finer]) / machine.gain + noise}


def test_a_contact_that_deflects_is_no_wrong_sign(tmp_path: Path, deflecting: dict) -> None:
    """A law of velocity alone asks for a negative inertia there."""
    fit = fit_of(tmp_path, deflecting, ANY_LAW)
    assert fit.model == "dahl"
    assert not fit.doubtful, fit.verdict
    for name, true in (("coulomb_torque", 3.0), ("viscous_damping", 0.3), ("inertia", 0.01)):
        assert estimate(fit, name).value == pytest.approx(true, rel=0.05)


def test_what_a_law_says_that_another_one_outdoes_is_inadequate(tmp_path: Path, deflecting: dict) -> None:
    """Its delay, too, which stands for the hysteresis that the law lacks."""
    fit = fit_of(tmp_path, deflecting, ANY_LAW, model="coulomb-viscous")
    assert any("coulomb-viscous does not describe this friction" in said and "dahl" in said for said in fit.verdict)
    for name in ("coulomb_torque", "viscous_damping", "inertia", "command_shift"):
        assert estimate(fit, name).status is Status.INADEQUATE, name
    assert {each.status for each in fit.totals} == {Status.INADEQUATE}
    steps = {step.model: {each.status for each in step.estimates} for step in fit.ladder}
    assert Status.INADEQUATE in steps["coulomb-viscous"]
    assert Status.VALID in steps["dahl"]


@pytest.mark.parametrize(("given", "doubtful"), [("2 N*m/A", False), ("2.3 N*m/A", True), ("0.002 N*m/A", True)])
def test_a_gain_that_the_sensor_does_not_bear_out_is_named(tmp_path: Path, given: str, doubtful: bool) -> None:
    """A milliampere taken for an ampere is one such."""
    fit = fit_of(tmp_path, Machine().log(), f'{LOADED}[actuator]\ntorque_gain = "{given}"\n')
    assert fit.doubtful is doubtful
    assert any("Exertion says that torque_gain is 2" in said for said in fit.verdict) is doubtful
