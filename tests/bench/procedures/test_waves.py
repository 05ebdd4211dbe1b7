"""Excitations begin and end at rest, keep their peak, and their motions are exact derivatives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.procedures.waves import (
    Motion,
    growth,
    multisine,
    multisine_motion,
    ramp,
    sine_motion,
    staircase,
    sweep,
    velocity_steps,
)

TICK_S = 1e-3


def fine_derivative(values: np.ndarray) -> np.ndarray:
    """Fourth-order central differences; the first and last two samples are left out."""
    return (-values[4:] + 8 * values[3:-1] - 8 * values[1:-3] + values[:-4]) / (12 * TICK_S)


@pytest.mark.parametrize(
    "motion",
    [
        multisine_motion(4.0, TICK_S, low_hz=0.3, high_hz=20.0, seed=1),
        sine_motion(5e-3, 4.0, 4, TICK_S),
    ],
)
def test_velocity_and_acceleration_are_derivatives(motion: Motion) -> None:
    velocity = fine_derivative(motion.position_rad)
    acceleration = fine_derivative(motion.velocity_rad_s)
    assert np.allclose(velocity, motion.velocity_rad_s[2:-2], atol=2e-4 * np.ptp(velocity))
    assert np.allclose(acceleration, motion.acceleration_rad_s2[2:-2], atol=2e-3 * np.ptp(acceleration))


@given(st.integers(0, 1000), st.floats(-1.0, 1.0))
def test_a_multisine_starts_at_rest_and_peaks_at_one(seed: int, slope: float) -> None:
    wave = multisine(2.0, TICK_S, low_hz=0.5, high_hz=100.0, seed=seed, slope=slope)
    assert wave[0] == 0.0
    assert abs(wave[-1]) < 1e-3
    assert np.max(np.abs(wave)) == pytest.approx(1.0)


def test_other_seeds_are_other_experiments() -> None:
    first, second = (multisine(2.0, TICK_S, low_hz=0.5, high_hz=100.0, seed=seed) for seed in (1, 2))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.5


def test_velocity_steps_dwell_where_asked_and_end_at_rest() -> None:
    motion = velocity_steps(np.array([5.0, -5.0]), 0.1, 0.3, TICK_S)
    assert np.mean(motion.velocity_rad_s == 5.0) > 0.2
    assert motion.velocity_rad_s[-1] == 0.0
    assert motion.position_rad[0] == 0.0


@given(st.floats(1e-3, 1.0), st.floats(0.02, 0.5), st.sampled_from([-1.0, 1.0]))
def test_a_sweep_goes_all_of_its_way_and_no_faster_than_told(
    distance_rad: float, speed_rad_s: float, way: float
) -> None:
    motion = sweep(way * distance_rad, speed_rad_s, TICK_S)
    assert motion.position_rad[-1] == pytest.approx(way * distance_rad, abs=2 * speed_rad_s * TICK_S)
    assert np.max(np.abs(motion.velocity_rad_s)) <= speed_rad_s * (1 + 1e-9)
    assert abs(motion.velocity_rad_s[-1]) < 1e-12


def test_growth_grows_by_the_same_factor_and_ends_at_the_limit() -> None:
    wave = growth(-0.5, 2.0, TICK_S)
    assert wave[-1] == pytest.approx(-0.5)
    assert np.ptp(wave[1:] / wave[:-1]) < 1e-9


def test_ramp_and_staircase() -> None:
    assert ramp(0.2, -0.4, 0.1, TICK_S)[-1] == pytest.approx(-0.4)
    assert list(staircase(np.array([1.0, 2.0]), 2e-3, TICK_S)) == [1.0, 1.0, 2.0, 2.0]
