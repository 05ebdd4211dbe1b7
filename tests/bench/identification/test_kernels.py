"""Filters that differentiate and shift, against polynomials and sines."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.identification import loops
from bench.identification.kernels import TABLE_PER_UNIT, Kernel
from bench.identification.separable import FULL_BAND
from bench.identification.signals import INTERPOLATION


@given(st.floats(-3.0, 3.0), st.floats(-1e3, 1e3), st.floats(-50, 50), st.floats(-5, 5), st.sampled_from([0, 1, 2]))
@settings(max_examples=50)
def test_polynomials_come_out_exactly(shift, a, b, c, derivative):
    offsets = np.arange(-12, 12.01, 0.25) - shift
    taps = FULL_BAND.taps(offsets, derivative)
    u = np.array([a, b, c])[: derivative + 1]
    expected = [a, b, 2 * c][derivative]
    values = sum(coefficient * offsets**power for power, coefficient in enumerate(u))
    assert float(taps @ values) == pytest.approx(expected, abs=1e-6 * (1 + abs(a)))


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_a_derivative_has_the_low_passs_own_gain(derivative):
    offsets = np.arange(-8, 8.01, 0.25)
    for frequency in (0.01, 0.05, 0.1):
        wave = np.exp(2j * np.pi * frequency * offsets)
        plain = FULL_BAND.taps(offsets, 0) @ wave
        differentiated = FULL_BAND.taps(offsets, derivative) @ wave
        assert differentiated == pytest.approx(plain * (2j * np.pi * frequency) ** derivative, rel=2e-3)


def test_resampling_keeps_what_is_below_a_quarter_of_the_rate():
    times = np.arange(400) * 1e-3 + 0.0003
    grid = 0.05 + np.arange(1000) * 0.25e-3
    for frequency in (10.0, 100.0, 200.0):
        values = 1e3 + np.sin(2 * np.pi * frequency * times)
        found = loops.resample(times, values, 1e-3, grid, INTERPOLATION.table(), TABLE_PER_UNIT)
        assert np.max(np.abs(found - 1e3 - np.sin(2 * np.pi * frequency * grid))) < 2e-3


def test_the_low_pass_stops_what_would_fold():
    kernel = Kernel(0.18, 8.0)
    offsets = np.arange(-8, 8.01, 1.0)
    assert abs(kernel.taps(offsets, 0) @ np.exp(2j * np.pi * 0.45 * offsets)) < 1e-3


def test_the_lag_is_exact_between_ticks():
    sent, command, bandwidth = np.array([0.0, 1.0e-3, 2.5e-3]), np.array([1.0, 3.0, -2.0]), 700.0
    grid = np.array([0.0, 0.5e-3, 1.7e-3, 3.1e-3])
    found = loops.lag_of_held(sent, command, bandwidth, grid)
    at_25 = 3 - 2 * np.exp(-700 * 1.5e-3)
    expected = [1.0, 1.0, 3 - 2 * np.exp(-700 * 0.7e-3), -2 + (at_25 + 2) * np.exp(-700 * 0.6e-3)]
    assert found == pytest.approx(expected)


@given(st.lists(st.floats(-0.01, 0.01), min_size=2, max_size=50), st.floats(10, 1e4), st.floats(-1, 1))
@settings(max_examples=50)
def test_any_initial_friction_is_one_path_plus_a_share_of_the_other(displacements, s, start):
    position = np.cumsum([0.0, *displacements])
    bank = loops.friction_bank(position, position[0], np.array([s]), np.array([start]))[0]
    path = loops.friction_path(position, s)
    assert bank == pytest.approx(path[0] + start * path[1], abs=1e-12)


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize("crossing", [-0.5, -0.25, 0.0, 0.25])
def test_a_shift_across_a_sample_is_no_jump(derivative: int, crossing: float) -> None:
    """The kernel's end then passes over a sample; what it makes of rough signals must not notice."""
    kernel = Kernel(0.18, 8.0)
    offsets = np.arange(-40, 41) / 4
    rough = np.sign(np.random.default_rng(0).standard_normal((81, 200)))
    shifts = crossing + 1e-3 * np.arange(-4, 5)
    filtered = np.stack([kernel.taps(offsets - shift, derivative) @ rough for shift in shifts])
    change = np.linalg.norm(np.diff(filtered, axis=0), axis=1)
    assert np.max(change) < 1.02 * np.min(change)
