"""What of a part is believed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.identification.cleaning import clean_part
from tests.bench.identification.live import phases
from tests.bench.identification.live.phases import PART_NS


@pytest.fixture(scope="module")
def parts():
    measured = phases.exciting_for(20.0)
    start = int(measured.ticks["tick_ns"][0])
    return [measured.between(start + k * PART_NS, start + (k + 1) * PART_NS) for k in range(0, 200, 7)]


def test_good_parts_are_left_as_they_are(parts):
    for part in parts:
        kept = clean_part(part)
        for name in ("ticks", "motion", "torque"):
            assert np.array_equal(getattr(kept, name), getattr(part, name)), name


@given(st.integers(2, 97), st.sampled_from([np.nan, np.inf, 1e6, -1e6]), st.integers(0, 28))
@settings(max_examples=60, deadline=None)
def test_one_bad_reading_alone_is_left_out(parts, at, value, number):
    motion, torque = parts[number].motion.copy(), parts[number].torque.copy()
    motion["position_rad"][at], torque["torque_nm"][at] = value, value
    kept = clean_part(replace(parts[number], motion=motion, torque=torque))
    assert np.array_equal(kept.motion, np.delete(parts[number].motion, at))
    assert np.array_equal(kept.torque, np.delete(parts[number].torque, at))


def test_a_step_is_no_spike(parts):
    motion = parts[0].motion.copy()
    motion["position_rad"][50:] += 100.0
    assert len(clean_part(replace(parts[0], motion=motion)).motion) == len(motion)


def test_stray_stamps_are_left_out(parts):
    ticks, torque = parts[1].ticks.copy(), parts[1].torque.copy()
    ticks["tick_ns"][30] = ticks["tick_ns"][28]
    torque["arrival_ns"][40] -= 10**12
    kept = clean_part(replace(parts[1], ticks=ticks, torque=torque))
    assert np.array_equal(kept.ticks, np.delete(parts[1].ticks, 30))
    assert np.array_equal(kept.torque, np.delete(parts[1].torque, 40))


def test_a_part_of_nothing_is_a_part_of_nothing(parts):
    nothing = replace(parts[0], ticks=parts[0].ticks[:0])
    assert [
        len(table) for table in (clean_part(nothing).ticks, clean_part(nothing).motion, clean_part(nothing).torque)
    ] == [0, 0, 0]
