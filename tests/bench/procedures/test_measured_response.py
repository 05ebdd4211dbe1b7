"""Learning without a model of the actuator, on assemblies that scipy integrates."""

import numpy as np
import pytest

from norton_bench.identification.assembly import Trial
from norton_bench.identification.at_ticks import in_band
from norton_bench.procedures.measured_response import _admittance, load_torque_towards_source
from tests.bench.linear_assembly import LOAD, STIFFNESS_NM_RAD, TICK_S, TICKS, Stiffness, moved, trial

ANY_SPEED = 1e3


def repeated(stiffness: Stiffness, trials: int) -> list[Trial]:
    seen = [trial(np.zeros(TICKS), stiffness)]
    while len(seen) < trials:
        seen.append(trial(load_torque_towards_source(LOAD, seen, ANY_SPEED, TICK_S), stiffness))
    return seen


def rms_nm(each: Trial) -> float:
    return float(np.sqrt(np.mean(in_band(each.torque_nm, TICK_S) ** 2)))


@pytest.fixture(scope="module")
def constant() -> list[Trial]:
    return repeated(lambda _: STIFFNESS_NM_RAD, 8)


def test_the_torque_vanishes_and_the_motion_becomes_the_source(constant: list[Trial]) -> None:
    first, last = constant[0], constant[-1]
    assert rms_nm(last) < 10 ** (-30 / 20) * rms_nm(first)
    free_rad, _ = moved(np.zeros(TICKS), lambda _: STIFFNESS_NM_RAD, 0.0)
    assert np.std(last.seen.load_position_rad - free_rad) < 0.01 * np.std(free_rad)
    assert np.std(first.seen.load_position_rad - free_rad) > 0.05 * np.std(free_rad)


@pytest.mark.long
def test_a_stiffness_that_changes_during_the_movement_makes_it_slower_not_wrong() -> None:
    seen = repeated(lambda now_s: STIFFNESS_NM_RAD * (1.0 + 0.5 * np.sin(2 * np.pi * 0.7 * now_s)), 7)
    assert rms_nm(seen[-1]) < 10 ** (-25 / 20) * rms_nm(seen[0])


def test_motion_that_does_not_go_with_the_torque_is_taken_for_noise() -> None:
    """Noise in both: what chance correlates of them is taken off, and little of an admittance is left."""
    random = np.random.default_rng(1)
    motions, torques = random.standard_normal((2, 2, TICKS))
    weights = np.full(2, 0.5)
    motions, torques = motions - weights @ motions, torques - weights @ torques
    noise = _admittance(motions, torques, weights, TICK_S)
    true = _admittance(-0.3 * torques + 0.003 * motions, torques, weights, TICK_S)
    assert np.sqrt(np.mean(np.abs(noise) ** 2)) < 0.35  # without: 0.5, of a ratio of 1
    assert true == pytest.approx(np.full(len(true), 0.3), rel=0.05)


def test_no_motion_is_aimed_at_that_is_too_fast(constant: list[Trial]) -> None:
    """Nothing is added at limits below the speed that was seen, all of it above."""
    limits_rad_s = (*np.linspace(0.5, 4.0, 36), ANY_SPEED)
    learned = [load_torque_towards_source(LOAD, constant[:2], each, TICK_S) for each in limits_rad_s]
    added = np.array([np.std(each - learned[0]) for each in learned])
    assert added[1] == 0.0
    assert added[-1] > 1e-3
    assert np.all(np.diff(added) >= -1e-12)
    seen_rad_s = np.max(np.abs(np.gradient(constant[1].seen.load_position_rad, TICK_S)))
    assert 0.7 * seen_rad_s < limits_rad_s[int(np.argmax(added > 0.0))] < 1.3 * seen_rad_s


def test_after_a_trial_that_was_worse_it_goes_half_of_the_way_from_the_best(constant: list[Trial]) -> None:
    best, worse = constant[1], constant[0]
    whole_nm = load_torque_towards_source(LOAD, (worse, best), ANY_SPEED, TICK_S)
    half_nm = load_torque_towards_source(LOAD, (best, worse), ANY_SPEED, TICK_S)
    assert half_nm == pytest.approx(0.5 * (whole_nm + best.load_torque_nm), abs=1e-12)
