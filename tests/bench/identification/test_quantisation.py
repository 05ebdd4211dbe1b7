"""Encoder counts undone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.identification.counts import resolution_rad, unquantised

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
        assert resolution_rad(turns * 2 * np.pi) == pytest.approx(step, rel=1e-2)


def test_no_step_is_seen_where_there_is_none():
    rng = np.random.default_rng(0)
    assert resolution_rad(np.cumsum(rng.normal(0, 1e-3, 3000))) == 0.0
    assert resolution_rad(np.zeros(100)) == 0.0


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


@pytest.mark.parametrize("counts", [4096, 5000, 8192])
def test_counts_that_were_rounded_once_more_are_seen(counts):
    """A message that carries a fiftieth of a degree, as a VESC's: 0.349 mrad, and counts of 0.77 to 1.5 mrad."""
    count, rounding = 2 * np.pi / counts, np.radians(0.02)
    time_s = np.arange(0, 20, 1e-3)
    motion = 3.0 * np.sin(0.7 * time_s) + 0.3 * np.sin(9.0 * time_s)
    read = np.round(np.floor(motion / count) * count / rounding) * rounding
    assert resolution_rad(read) == pytest.approx(count + rounding, rel=0.05)
    assert np.max(np.abs(read + 0.5 * count - motion)) <= 0.5 * resolution_rad(read)


def test_a_reading_without_counts_has_no_step():
    rng = np.random.default_rng(2)
    assert resolution_rad(np.cumsum(rng.normal(size=5000)) * 1e-4) == 0.0
    assert resolution_rad(np.sin(np.arange(5000) * 1e-3) + 1e-5 * rng.normal(size=5000)) == 0.0
