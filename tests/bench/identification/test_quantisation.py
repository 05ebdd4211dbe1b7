"""Encoder counts undone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.identification.quantisation import resolution_rad, unquantised

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


@pytest.mark.parametrize("spread", [0.02, 0.05, 0.2])
def test_a_shaft_at_rest_on_an_edge_does_not_travel(spread):
    rng = np.random.default_rng(3)
    readings = read(STEP * (5 + spread * rng.standard_normal(2000)))
    travelled = np.abs(np.diff(readings)).sum()
    assert np.abs(np.diff(unquantised(readings, STEP)))[100:-100].sum() < 0.1 * travelled
