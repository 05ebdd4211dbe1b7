"""Filters that differentiate and shift, against polynomials and sines."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.identification import loops
from norton_bench.identification.kernels import FULL_BAND, TABLE_PER_UNIT, Kernel
from norton_bench.identification.signals import INTERPOLATION


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


@pytest.mark.parametrize("window", [0.3, 2.0, 5.0])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_a_kernel_that_averages_besides_has_the_averages_gain_too(window, derivative):
    averaging = FULL_BAND.averaging(window)
    offsets = np.arange(-12, 12.01, 0.25)
    for frequency in (0.01, 0.05, 0.1):
        wave = np.exp(2j * np.pi * frequency * offsets)
        plain = FULL_BAND.taps(offsets, derivative) @ wave
        assert averaging.taps(offsets, derivative) @ wave == pytest.approx(
            plain * np.sinc(frequency * window), rel=5e-3
        )
    assert averaging.energy(derivative) < FULL_BAND.energy(derivative)


def test_a_kernel_that_averages_over_nothing_is_the_same():
    assert FULL_BAND.averaging(0.0) is FULL_BAND


def test_resampling_keeps_what_is_below_a_quarter_of_the_rate():
    times = np.arange(400) * 1e-3 + 0.0003
    grid = 0.05 + np.arange(1000) * 0.25e-3
    for frequency in (10.0, 100.0, 200.0):
        values = 1e3 + np.sin(2 * np.pi * frequency * times)
        found = loops.resample(times, values, 1e-3, grid, INTERPOLATION.table(), TABLE_PER_UNIT)
        assert np.max(np.abs(found - 1e3 - np.sin(2 * np.pi * frequency * grid))) < 2e-3


def test_two_streams_are_resampled_as_each_alone():
    random, grid = np.random.default_rng(1), np.arange(1600) * 0.25e-3
    times = np.sort(np.arange(400) * 1e-3 + 1e-4 * random.standard_normal(400))
    values, others = random.standard_normal((2, 400))
    how = (1e-3, grid, INTERPOLATION.table(), TABLE_PER_UNIT)
    both = loops.resample_both(times, values, others, *how)
    assert np.array_equal(both, [loops.resample(times, each, *how) for each in (values, others)], equal_nan=True)


@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
def test_every_derivative_of_a_cubic_is_exact(derivative: int):
    kernel, shift = Kernel(0.18, 8.0), 0.3
    offsets = np.arange(-36, 37) / 4 - shift
    cubic = np.polynomial.Polynomial([4.0, -3.0, 2.0, 0.5])
    taps = kernel.taps(offsets, derivative, exact_to=3)
    wanted = cubic.deriv(derivative)(shift) if derivative else cubic(shift)
    assert taps @ cubic(offsets + shift) == pytest.approx(wanted, rel=1e-9)


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


def test_a_released_drives_current_ends_at_once():
    sent, command, bandwidth = np.array([0.0, 1.0e-3, 2.0e-3]), np.array([1.0, 0.0, 2.0]), 700.0
    grid = np.array([0.9e-3, 1.5e-3, 3e-3])
    expected = [1.0, 0.0, 2 - 2 * np.exp(-0.7)]
    assert loops.lag_of_held(sent, command, bandwidth, grid, True) == pytest.approx(expected)
    means = loops.mean_lag_of_held(sent, command, bandwidth, 0.25e-3, 0.5e-3, 6, True)
    assert means[:4] == pytest.approx([1.0, 1.0, 0.0, 0.0])
    assert means[4] == pytest.approx(2 - 2 * (1 - np.exp(-0.35)) / 0.35)


@given(st.floats(100, 3000), st.floats(-1e-4, 1e-4))
@settings(max_examples=30)
def test_means_of_the_lag_are_those_of_the_lag(bandwidth: float, phase: float):
    sent, command = np.arange(20) * 1e-3 + phase, np.sign(np.sin(np.arange(20.0)))
    means = loops.mean_lag_of_held(sent, command, bandwidth, 1e-3, 2.5e-4, 60)
    fine = 1e-3 + (np.arange(60 * 200) + 0.5) / 200 * 2.5e-4 - 1.25e-4
    lag = loops.lag_of_held(sent, command, bandwidth, np.concatenate([[1e-3 - 1.25e-4], fine]))[1:]
    assert means == pytest.approx(lag.reshape(60, 200).mean(axis=1), abs=1e-5)


def test_taps_of_means_see_kinks_where_they_are():
    """A lag beginning anywhere between samples, filtered: sampling it would move its kink."""
    kernel, bandwidth = Kernel(0.18, 8.0), 900.0
    offsets = np.arange(-32, 33) / 4
    fine = (np.arange(65 * 100) + 0.5) / 400 - 8.125
    for start in (0.0, 0.06, 0.125, 0.19):
        sent, command = np.array([-1.0, start]) * 1e-3, np.array([0.0, 1.0])
        means = loops.mean_lag_of_held(sent, command, bandwidth, -8e-3, 2.5e-4, 65)
        lag = np.where(fine > start, 1 - np.exp(-bandwidth * 1e-3 * np.maximum(fine - start, 0)), 0.0)
        exact = kernel.taps(fine, 0) @ lag
        assert kernel.taps(offsets, 0, of_means=True) @ means == pytest.approx(exact, abs=1e-5)


@given(st.floats(5, 60), st.floats(0, 6), st.floats(100, 2000), st.floats(-1, 1))
@settings(max_examples=30)
def test_friction_along_a_smooth_path_turning_points_included(speed: float, phase: float, s: float, start: float):
    """Cell by cell, against the exact flow along the same path sampled 400 times as finely."""

    def path(at: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return 0.004 * np.sin(speed * at + phase) + 0.001 * np.sin(3.1 * speed * at)

    cell_s = 2.5e-4
    coarse, fine = path(np.arange(400) * cell_s), path(np.arange(400 * 400) / 400 * cell_s)
    exact = loops.friction_bank(fine, fine[0], np.array([s]), np.array([start]))[0]
    pair = loops.friction_path(coarse, s, np.empty(0, np.int64))
    cells = exact[200:-200].reshape(-1, 400).mean(axis=1)
    # The first cell has no neighbour to bend by; its error is remembered, and fades.
    assert (pair[0] + start * pair[1])[1:-1] == pytest.approx(cells[: len(coarse) - 2], abs=3e-3)


def test_what_friction_holds_stays_between_its_bounds():
    rough = np.cumsum(np.random.default_rng(5).standard_normal(5000)) * 1e-4
    share, left = loops.friction_path(rough, 800.0, np.empty(0, np.int64))
    assert np.max(np.abs(share)) <= 1.0
    assert np.all((left >= 0.0) & (left <= 1.0))


def test_what_friction_remembers_begins_anew():
    position = np.linspace(0.0, 0.1, 101)
    left = loops.friction_path(position, 50.0, np.array([40]))[1]
    assert left[39] == pytest.approx(np.exp(-50 * position[39]), rel=1e-3)
    assert left[60] == pytest.approx(np.exp(-50 * (position[60] - position[40])), rel=1e-3)


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
