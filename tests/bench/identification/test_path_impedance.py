"""The impedance about a path, of trials that scipy integrates."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.assembly import Machine, Trial
from norton_bench.identification.path_impedance import path_impedance
from norton_bench.procedures.waves import multisine
from tests.bench.linear_assembly import (
    DAMPING_NMS_RAD,
    DURATION_S,
    INERTIA_KGM2,
    LOAD,
    LOAD_KGM2,
    STIFFNESS_NM_RAD,
    TICK_S,
    TICKS,
    trial,
)

TRUE = (INERTIA_KGM2, DAMPING_NMS_RAD, STIFFNESS_NM_RAD)


@pytest.fixture(scope="module")
def pushed() -> list[Trial]:
    """With the load left alone, and pushed in two ways."""
    waves = [multisine(DURATION_S, TICK_S, low_hz=0.5, high_hz=8.0, seed=seed) for seed in (5, 6)]
    return [trial(push_nm, lambda _: STIFFNESS_NM_RAD) for push_nm in (np.zeros(TICKS), *0.02 * np.array(waves))]


def test_it_is_that_of_the_actuator(pushed: list[Trial]) -> None:
    about = path_impedance(LOAD, pushed, TICK_S)
    assert about is not None
    assert about.values == pytest.approx(TRUE, rel=0.01)
    assert about.linear
    assert about.explained > 0.999


def test_noise_of_the_torque_is_in_its_intervals(pushed: list[Trial]) -> None:
    """Of 20 records with noise, 95 % of 60 intervals hold the truth: by chance no fewer than 51 in 997 of 1000."""
    random, held = np.random.default_rng(3), 0
    for _ in range(20):
        noisy = [replace(each, torque_nm=each.torque_nm + 2e-3 * random.standard_normal(TICKS)) for each in pushed]
        about = path_impedance(LOAD, noisy, TICK_S)
        assert about is not None
        held += int(np.sum(np.abs(np.array(about.values) - TRUE) <= about.half))
    assert held >= 51


def test_an_uncertain_load_leaves_the_inertia_uncertain(pushed: list[Trial]) -> None:
    """3 % of the load's inertia are 9 % of the actuator's, which is a third of it."""
    network = replace(LOAD.network, covariance_names=("inertia",), covariance=(((0.03 * LOAD_KGM2) ** 2,),))
    load = Machine(network, 0.0, 0.0)
    about = path_impedance(load, [each.by(load, TICK_S) for each in pushed], TICK_S)
    assert about is not None
    assert about.half[0] == pytest.approx(1.96 * 0.09 * INERTIA_KGM2, rel=0.3)
    assert about.values == pytest.approx(TRUE, rel=0.05)


def test_friction_is_no_linear_impedance(pushed: list[Trial]) -> None:
    """A torque that has the sign of the velocity alone."""
    dry = []
    for each in pushed:
        velocity_rad_s = np.gradient(each.seen.load_position_rad, TICK_S)
        dry.append(replace(each, torque_nm=-0.02 * np.sign(velocity_rad_s)))
    about = path_impedance(LOAD, dry, TICK_S)
    assert about is not None
    assert not about.linear


def test_trials_that_do_not_differ_tell_nothing(pushed: list[Trial]) -> None:
    assert path_impedance(LOAD, pushed[:1], TICK_S) is None
    assert path_impedance(LOAD, [pushed[0], pushed[0]], TICK_S) is None
    stuck = [replace(each, seen=pushed[0].seen) for each in pushed]
    assert path_impedance(LOAD, stuck, TICK_S) is None
