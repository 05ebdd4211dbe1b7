"""The impedance along a path, of trials that scipy integrates, with a stiffness that changes meanwhile."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from norton_bench.arrays import FloatArray
from norton_bench.identification.assembly import Machine, Trial
from norton_bench.identification.impedance_along import ImpedanceAlong, impedance_along
from norton_bench.procedures.waves import multisine
from tests.bench.linear_assembly import (
    DAMPING_NMS_RAD,
    DURATION_S,
    INERTIA_KGM2,
    LOAD,
    LOAD_KGM2,
    REST_RAD,
    STIFFNESS_NM_RAD,
    TICK_S,
    TICKS,
    trial,
)

PUSH_NM, PUSHES = 0.05, 8
REACH_S, EVERY_S = 0.4, 0.5


def reaching(time_s: float) -> float:
    """Half as stiff again in the middle of each reach: as an arm's."""
    progress = min((time_s % EVERY_S) / REACH_S, 1.0)
    return float(STIFFNESS_NM_RAD * (1.0 + 8.0 * progress**2 * (1.0 - progress) ** 2))


def square(time_s: float) -> float:
    """From one value to another and back, at once."""
    return STIFFNESS_NM_RAD * (1.5 if 0.7 < time_s < 1.3 else 1.0)


STIFFNESSES = {"constant": lambda _: STIFFNESS_NM_RAD, "reaching": reaching, "square": square}


@lru_cache
def pushed(name: str) -> tuple[Trial, ...]:
    """Pushed in several ways, at rest before and after."""
    wave_s = DURATION_S - 2 * len(REST_RAD) * TICK_S
    waves = [multisine(wave_s, TICK_S, low_hz=0.5, high_hz=15.0, seed=seed) for seed in range(PUSHES)]
    return tuple(trial(PUSH_NM * np.concatenate([REST_RAD, wave, REST_RAD]), STIFFNESSES[name]) for wave in waves)


def noisy(name: str, seed: int) -> list[Trial]:
    random = np.random.default_rng(seed)
    return [replace(each, torque_nm=each.torque_nm + 1e-3 * random.standard_normal(TICKS)) for each in pushed(name)]


def along(trials: list[Trial] | tuple[Trial, ...]) -> ImpedanceAlong:
    found = impedance_along(LOAD, trials, TICK_S)
    assert found is not None
    return found


def true_nm_rad(found: ImpedanceAlong, name: str) -> FloatArray:
    return np.array([STIFFNESSES[name](time_s) for time_s in found.time_s])


def test_a_stiffness_that_changes_is_followed() -> None:
    found = along(pushed("reaching"))
    assert found.stiffness_nm_rad == pytest.approx(true_nm_rad(found, "reaching"), rel=0.01)
    assert found.inertia_kgm2 == pytest.approx(INERTIA_KGM2, rel=0.01)
    assert found.damping_nms_rad == pytest.approx(DAMPING_NMS_RAD, rel=0.01)
    assert (found.resolution_s, found.damping_changes, found.linear) == (0.025, False, True)
    assert found.explained > 0.9999
    rest_s = len(REST_RAD) * TICK_S
    assert rest_s < found.time_s[0] < rest_s + 0.2
    assert DURATION_S - rest_s - 0.2 < found.time_s[-1] < DURATION_S


def test_a_stiffness_that_stays_is_said_to_stay() -> None:
    for seed in range(5):
        found = along(noisy("constant", seed))
        assert found.resolution_s == np.inf
        assert np.ptp(found.stiffness_nm_rad) == 0.0
        assert abs(found.stiffness_nm_rad[0] - STIFFNESS_NM_RAD) < 2.0 * found.stiffness_half_nm_rad[0]


def test_noise_of_the_torque_is_in_its_intervals() -> None:
    """20 records with noise; values of one record go together, so their share scatters by some 1 %."""
    shares = []
    for seed in range(20):
        found = along(noisy("reaching", seed))
        off = np.abs(found.stiffness_nm_rad - true_nm_rad(found, "reaching"))
        shares.append(np.mean(off <= found.stiffness_half_nm_rad))
    assert 0.92 < np.mean(shares) < 0.99


def test_a_stiffness_that_jumps_is_as_steep_as_its_resolution_allows() -> None:
    found = along(noisy("square", 1))
    off = found.stiffness_nm_rad - true_nm_rad(found, "square")
    near = np.min(np.abs(found.time_s[:, None] - [0.7, 1.3]), axis=1) < 2.0 * found.resolution_s
    assert found.resolution_s <= 0.1
    assert np.sqrt(np.mean(off[~near] ** 2)) < 0.02 * STIFFNESS_NM_RAD


def test_an_uncertain_load_leaves_the_inertia_uncertain() -> None:
    """3 % of the load's inertia are 9 % of the actuator's, which is a third of it."""
    network = replace(LOAD.network, covariance_names=("inertia",), covariance=(((0.03 * LOAD_KGM2) ** 2,),))
    load = Machine(network, 0.0, 0.0)
    found = impedance_along(load, [each.by(load, TICK_S) for each in pushed("reaching")], TICK_S)
    assert found is not None
    assert found.inertia_half_kgm2 == pytest.approx(2.36 * 0.09 * INERTIA_KGM2, rel=0.3)


def test_friction_is_not_explained_in_trials_that_were_not_seen() -> None:
    dry = []
    for each in pushed("constant"):
        velocity_rad_s = np.gradient(each.seen.load_position_rad, TICK_S)
        dry.append(replace(each, torque_nm=-0.02 * np.sign(velocity_rad_s)))
    assert not along(dry).linear


def test_few_trials_and_such_that_do_not_differ_tell_nothing() -> None:
    trials = pushed("constant")
    assert impedance_along(LOAD, trials[:3], TICK_S) is None
    assert impedance_along(LOAD, [trials[0]] * 5, TICK_S) is None
    stuck = [replace(each, seen=trials[0].seen) for each in trials]
    assert impedance_along(LOAD, stuck, TICK_S) is None
