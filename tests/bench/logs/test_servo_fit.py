"""Servos found again from their motion in their own loop."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.logs.refine import Beginning, ServoRung, held_out, servo_ladder
from norton_bench.logs.servo import LADDER, FittedLogs, spread_of_equals
from tests.bench.logs.servos import TRUTH, measured, pendulum

pytestmark = pytest.mark.long

# As an equation of motion would say it that knows nothing of the load's friction: up to a third wrong.
BEGIN = Beginning(
    gain=0.4 / 4.0,
    inertia=0.0027,
    damping=0.055,
    coulomb=0.03,
    offset=0.0,
    gravity=0.0,
    exertion_rms=0.2,
    velocity_rms=2.0,
    on_voltage=True,
    switched=True,
)


def trial_of(*gains: float) -> FittedLogs:
    logs = [
        measured(pendulum(gain, phase=phase, drop_s=drop_s), TRUTH)
        for gain in gains
        for phase, drop_s in ((0.0, np.inf), (1.2, 1.8))
    ]
    return FittedLogs(tuple(logs), tuple(np.ones(log.position.size, dtype=bool) for log in logs))


@pytest.fixture(scope="module")
def rungs() -> tuple[ServoRung, ...]:
    return servo_ladder(trial_of(0.3, 0.7), BEGIN, (LADDER[0], LADDER[2]))


def test_the_truth_is_found_within_its_deviations(rungs: tuple[ServoRung, ...]) -> None:
    (selected,) = [rung for rung in rungs if rung.selected]
    assert selected.fit.model.name == "load-dependent"
    assert selected.fit.converged
    assert not selected.fit.at_bound
    for name, truth in TRUTH.items():
        found, deviation = selected.fit.values[name], selected.fit.deviations[name]
        # The fit's own steps, coarser than the truth's, are worth another hundredth.
        assert abs(found - truth) < 3 * deviation + 0.01 * truth, name
        assert deviation < 0.3 * truth, name


def test_a_load_whose_zero_is_not_known_gets_its_zero() -> None:
    """A pendulum that hangs at rest at 30 mrad of the encoder, and no constant torque."""
    truth = {name: value for name, value in TRUTH.items() if name != "offset"} | {"gravity_zero": 0.03}
    logs = [measured(pendulum(gain, phase=phase), truth) for gain in (0.3, 0.7) for phase in (0.0, 1.2)]
    trial = FittedLogs(tuple(logs), tuple(np.ones(log.position.size, dtype=bool) for log in logs))
    (rung,) = servo_ladder(trial, replace(BEGIN, gravity=0.5), LADDER[2:3])
    assert abs(rung.fit.values["offset"]) < 3 * rung.fit.deviations["offset"] + 1e-3
    assert rung.fit.values["gravity_zero"] == pytest.approx(0.03, abs=3 * rung.fit.deviations["gravity_zero"] + 3e-4)
    assert rung.fit.deviations["gravity_zero"] < 0.005


def test_a_tick_is_left_and_another_gain_is_foretold(rungs: tuple[ServoRung, ...]) -> None:
    (selected,) = [rung for rung in rungs if rung.selected]
    unseen = trial_of(1.5)
    errors = unseen.errors(selected.fit.values)
    assert np.mean(np.abs(errors)) < 0.02 * unseen.spread
    assert selected.train_relative < 0.02


def test_the_simpler_friction_fails_where_it_is_held_out(rungs: tuple[ServoRung, ...]) -> None:
    simple, right = rungs
    assert simple.held_out_relative > 2 * right.held_out_relative


def test_a_gain_is_held_out_at_a_time_else_a_log_else_a_half() -> None:
    several = trial_of(0.3, 0.7)
    assert [[bool(rows.any()) for rows in fold] for fold in held_out(several)] == [
        [True, True, False, False],
        [False, False, True, True],
    ]
    alike = FittedLogs(several.logs[:2], several.chosen[:2])
    assert [[bool(rows.any()) for rows in fold] for fold in held_out(alike)] == [[True, False], [False, True]]
    single = FittedLogs(several.logs[:1], several.chosen[:1])
    halves = [fold[0] for fold in held_out(single)]
    assert [int(rows.sum()) for rows in halves] == [300, 300]
    assert not np.any(halves[0] & halves[1])


def test_logs_of_which_nothing_is_trained_on_are_in_no_fold() -> None:
    several = trial_of(0.3, 0.7)
    none = np.zeros_like(several.chosen[0])
    half = replace(several, chosen=(several.chosen[0], several.chosen[1], none, none))
    folds = held_out(half)
    assert len(folds) == 2
    assert not any(rows.any() for fold in folds for rows in fold[2:])


def test_minima_that_are_as_good_are_part_of_what_is_not_known() -> None:
    places = np.array([[1.0, 5.0], [1.3, 5.0], [0.6, 5.0], [9.0, 9.0]])
    assert spread_of_equals([1.0, 1.01, 1.019, 1.1], places) == pytest.approx([np.sqrt((0.3**2 + 0.4**2) / 2), 0.0])
    assert spread_of_equals([1.0, 1.1], places[:2]).tolist() == [0.0, 0.0]
    assert spread_of_equals([1.0], places[:1]).tolist() == [0.0, 0.0]
