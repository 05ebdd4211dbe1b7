"""Encoder counts undone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.identification.counts import NO_STEPS, Resolution, resolution_of, unquantised

STEP = 2 * np.pi / 131072


def read(angle, step=STEP):
    return np.floor(angle / step) * step


@given(st.integers(0, 1000), st.floats(1e-6, 1e-2))
@settings(max_examples=25)
def test_the_step_is_found(seed, step):
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.normal(0, 3 * step, 3000))
    turns = (read(angle, step) / (2 * np.pi)).astype(np.float32).astype(float)
    # A float32 in turns must resolve the step itself.
    if step / (2 * np.pi) > 20 * np.spacing(np.float32(np.max(np.abs(turns)))):
        assert resolution_of(turns * 2 * np.pi).width == pytest.approx(step, rel=1e-2)


def test_no_step_is_seen_where_there_is_none():
    rng = np.random.default_rng(0)
    assert resolution_of(np.cumsum(rng.normal(0, 1e-3, 3000))) == NO_STEPS
    assert resolution_of(np.zeros(100)) == NO_STEPS


@given(st.integers(0, 1000))
@settings(max_examples=25)
def test_the_result_stays_within_the_counts(seed):
    rng = np.random.default_rng(seed)
    readings = read(np.cumsum(rng.normal(0, 20 * STEP, 500)))
    assert np.max(np.abs(unquantised(readings, STEP) - readings)) <= STEP / 2 * (1 + 1e-9)


def test_slow_motion_is_known_better_than_a_count():
    time_s = np.arange(4000) * 1e-3
    angle = 1e-3 * np.sin(2 * np.pi * 2 * time_s)
    readings = read(angle)
    smooth = unquantised(readings, STEP) - STEP / 2
    error, plain = np.std(smooth - angle + STEP), np.std(readings - angle)
    assert error < 0.6 * plain


def test_turns_amid_coarse_counts_are_smoothed_as_far_as_chance_explains():
    """Each count errs by 0.29 steps; a low-pass of 0.07 cycles a reading, which follows this motion, leaves 0.1."""
    time_s = np.arange(8000) * 1e-3
    step, errors = 7.7e-4, []
    for phase in range(4):
        angle = 0.05 * np.sin(2 * np.pi * 0.7 * time_s + phase) + 0.02 * np.sin(2 * np.pi * 1.9 * time_s + 2 * phase)
        readings = read(angle, step) + step / 2
        errors.append(np.std(unquantised(readings, step) - angle) / step)
    assert np.mean(errors) < 0.125


@pytest.mark.parametrize("spread", [0.02, 0.05, 0.2])
def test_a_shaft_at_rest_on_an_edge_does_not_travel(spread):
    rng = np.random.default_rng(3)
    readings = read(STEP * (5 + spread * rng.standard_normal(2000)))
    travelled = np.abs(np.diff(readings)).sum()
    assert np.abs(np.diff(unquantised(readings, STEP)))[100:-100].sum() < 0.1 * travelled


ROUNDING = np.radians(0.02)  # a message that carries a fiftieth of a degree, as a VESC's


@pytest.mark.parametrize("counts", [4096, 5000, 8192])
def test_counts_that_were_rounded_once_more_are_seen(counts):
    """Counts of 0.77 to 1.5 mrad."""
    count = 2 * np.pi / counts
    time_s = np.arange(0, 20, 1e-3)
    motion = 3.0 * np.sin(0.7 * time_s) + 0.3 * np.sin(9.0 * time_s)
    read = np.round(np.floor(motion / count) * count / ROUNDING) * ROUNDING
    assert resolution_of(read).width == pytest.approx(count + ROUNDING, rel=0.05)
    assert np.max(np.abs(read + 0.5 * count - motion)) <= 0.5 * resolution_of(read).width


def driven(seed, seconds=60):
    """A shaft that is turned and shaken, as in a session: sums of sines, slow turning, rests."""
    rng, time_s = np.random.default_rng(seed), np.arange(0, seconds, 1e-3)
    shaken = sum(
        rng.uniform(0.5, 6.0) / frequency * np.sin(2 * np.pi * frequency * time_s + rng.uniform(0, 6))
        for frequency in rng.uniform(0.3, 20.0, 6)
    )
    fast = np.where(time_s < seconds / 2, rng.uniform(0.1, 2.0) * time_s + shaken, 0.1 * time_s + 0.01 * shaken)
    return np.where((time_s > 0.7 * seconds) & (time_s < 0.8 * seconds), 0.3, fast)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("counts", [16384, 15000, 12000, 10000])
def test_counts_that_messages_round_to_as_coarse_steps_are_seen(counts, seed):
    """16384 counts are 0.383 mrad, messages 0.349: every difference is of whole steps, and one step in 11 is never
    read."""
    count = 2 * np.pi / counts
    read = Resolution(count, ROUNDING).read(driven(seed), zero=1e-4 * seed)
    seen = resolution_of(read)
    assert (seen.count, seen.rounding) == pytest.approx((count, ROUNDING), rel=1e-3)
    assert np.max(np.abs(read - driven(seed))) <= 0.5 * seen.width * (1 + 1e-9)


def at_one_speed(seed):
    """So fast that steps are left out, regularly: 1.1 to 1.9 of them a reading."""
    return (1.1 + 0.2 * seed) * ROUNDING * np.arange(20_000)


def cogged(seed):
    """At some angles more often than at others, again and again over a turn."""
    return driven(seed) + 2e-3 * np.sin((24 + 12 * seed) * driven(seed))


def shaky(seed):
    """Slowly, with noise of a step: it leaps over any of them."""
    return driven(seed) + ROUNDING * np.random.default_rng(seed).standard_normal(60_000)


def sent_twice(seed):
    return np.repeat(at_one_speed(seed), 2)


@pytest.mark.parametrize("moved", [driven, cogged, shaky, at_one_speed, sent_twice])
@pytest.mark.parametrize("seed", range(5))
def test_none_are_seen_behind_steps_that_are_the_counts(seed, moved):
    motion = moved(seed)
    read = Resolution(ROUNDING).read(motion)
    assert resolution_of(read) == Resolution(pytest.approx(ROUNDING, rel=1e-6))


@given(st.floats(1.0, 3.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 1000))
@settings(max_examples=50)
def test_a_reading_lies_within_the_width_of_its_steps(ratio, rounded, zero, seed):
    steps = Resolution(ratio * STEP, rounded * STEP)
    values = np.random.default_rng(seed).uniform(-1.0, 1.0, 2000)
    errors = steps.read(values, zero * STEP) - values
    assert np.max(np.abs(errors)) <= 0.5 * steps.width * (1 + 1e-9)


def test_a_reading_that_is_no_number_hides_no_counts():
    read = Resolution(2 * np.pi / 16384, ROUNDING).read(driven(1))
    read[1000] = np.nan
    assert resolution_of(read).count == pytest.approx(2 * np.pi / 16384, rel=1e-4)


def test_the_variance_of_errors_is_that_of_both_steps():
    steps, values = Resolution(STEP, 0.91 * STEP), np.random.default_rng(1).uniform(-1.0, 1.0, 100_000)
    assert np.var(steps.read(values) - values) == pytest.approx(steps.variance, rel=0.02)
    assert NO_STEPS.read(values) is values


def test_a_reading_without_counts_has_no_step():
    rng = np.random.default_rng(2)
    assert resolution_of(np.cumsum(rng.normal(size=5000)) * 1e-4) == NO_STEPS
    assert resolution_of(np.sin(np.arange(5000) * 1e-3) + 1e-5 * rng.normal(size=5000)) == NO_STEPS
