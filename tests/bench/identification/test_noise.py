"""Noise told from readings alone."""

import numpy as np
import pytest

from norton_bench.identification.counts import Resolution
from norton_bench.identification.readings import noise_deviation
from norton_bench.identification.signals import TimeSeries, _density_of_counts


@pytest.mark.parametrize("true", [1e-3, 0.1])
def test_white_noise_on_a_smooth_signal(true):
    rng = np.random.default_rng(3)
    time = np.arange(20_000) * 1e-3
    values = np.sin(60 * time) + 5 * time + true * rng.standard_normal(time.size)
    assert noise_deviation(values, np.ones(time.size, dtype=bool)) == pytest.approx(true, rel=0.05)


def test_counts_that_pass_by_are_uniform_noise():
    time = np.arange(20_000) * 1e-3
    counts = np.floor((10 * time + np.sin(8 * time)) / 4.8e-5) * 4.8e-5
    assert noise_deviation(counts, np.ones(time.size, dtype=bool)) == pytest.approx(4.8e-5 / np.sqrt(12), rel=0.05)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_counts_that_pass_slowly_have_the_variance_of_a_step_and_not_of_their_differences(noise):
    """About half a count a reading: neighbouring errors alternate, and their differences are nearly four times that."""
    rng, step, period_s = np.random.default_rng(6), 1.5e-3, 2.5e-3
    time_s = np.arange(20_000) * period_s
    path = step * 0.5 * np.arange(time_s.size) + 3.3 * step * np.sin(0.7 * time_s)
    read = step * np.round((path + 0.3 * step + noise * step * rng.standard_normal(time_s.size)) / step) - 0.3 * step
    usable = np.ones(time_s.size, dtype=bool)
    assert noise > 0.0 or noise_deviation(read, usable) ** 2 > 2.0 * step**2 / 12
    density = _density_of_counts(TimeSeries(time_s, read, period_s, Resolution(step)), path, time_s, usable)
    assert density == pytest.approx((1 / 12 + noise**2) * step**2 * period_s, rel=0.3)


def test_what_is_left_in_the_path_of_a_fine_encoder_is_noise():
    rng, step, period_s = np.random.default_rng(7), 1e-5, 1e-3
    time_s = np.arange(20_000) * period_s
    path = np.sin(3.0 * time_s) + 1e-3 * rng.standard_normal(time_s.size)
    read = step * np.round(path / step)
    density = _density_of_counts(
        TimeSeries(time_s, read, period_s, Resolution(step)), path, time_s, np.ones(time_s.size, dtype=bool)
    )
    assert density == pytest.approx(1e-6 * period_s, rel=0.1)


def test_shocks_and_what_is_not_chosen_do_not_count():
    rng = np.random.default_rng(4)
    values = 1e-3 * rng.standard_normal(20_000)
    values[::1900] += 1.0
    values[:5000] += rng.standard_normal(5000)
    chosen = np.arange(values.size) >= 5000
    assert noise_deviation(values, chosen) == pytest.approx(1e-3, rel=0.1)


def test_errors_that_come_with_the_speed_count_by_their_mean_square():
    """Read at instants that jitter by 30 microseconds: nothing at rest, much at speed."""
    rng = np.random.default_rng(5)
    time = np.arange(40_000) * 1e-3
    position = 40 / 2 * np.sin(2 * time)
    jittered = 40 / 2 * np.sin(2 * (time + 3e-5 * rng.standard_normal(time.size)))
    expected = np.std(jittered - position)
    moving = np.abs(np.cos(2 * time)) ** 8  # at speed for a part of the time only
    values = position + (jittered - position) * moving
    told = np.sqrt(np.mean(((jittered - position) * moving) ** 2))
    assert told < 0.7 * expected
    assert noise_deviation(values, np.ones(time.size, dtype=bool)) == pytest.approx(told, rel=0.1)


def test_too_few_readings_tell_nothing():
    assert noise_deviation(np.arange(100.0), np.ones(100, dtype=bool)) == 0.0
    assert noise_deviation(np.arange(5.0), np.ones(5, dtype=bool)) == 0.0
