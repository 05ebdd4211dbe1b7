import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.records import MOTION, TICK, TORQUE, Measured, SegmentInfo
from norton_bench.report.streams import lost_readings, stream_qualities
from norton_bench.segments import Use


@given(st.integers(0, 2**32 - 1), st.integers(0, 40), st.booleans())
def test_lost_readings_are_counted_through_jitter(seed: int, lost: int, numbered: bool) -> None:
    """Whether the device numbers its readings or only the host does."""
    rng = np.random.default_rng(seed)
    sent = np.arange(5000)
    kept = np.delete(sent, rng.choice(np.arange(100, 4900), lost, replace=False))
    arrival_ns = np.sort(kept * 1_000_000 + rng.integers(0, 300_000, len(kept))) + 10**12
    sequence = kept if numbered else np.arange(len(kept))
    assert lost_readings(arrival_ns, sequence) == lost


def test_a_late_reading_is_not_a_lost_one() -> None:
    arrival_ns = np.arange(2000) * 1_000_000
    arrival_ns[640:645] = arrival_ns[645]  # five arrive together after a stall, across the edge of a block
    assert lost_readings(arrival_ns, np.arange(2000)) == 0


def test_what_is_said_of_a_stream() -> None:
    motion = np.zeros(1001, MOTION)
    motion["arrival_ns"] = np.arange(1001) * 2_000_000
    motion["sequence"] = np.arange(1001)
    motion["position_rad"] = np.arange(1001)
    motion["position_rad"][500:511] = 500
    ticks = np.zeros(4, TICK)
    ticks["motion_age_ns"] = [-1, 100_000, 300_000, 200_000]
    (quality,) = stream_qualities(Measured(ticks=ticks, motion=motion, torque=np.zeros(1, TORQUE)))
    assert (quality.name, quality.readings, quality.expected, quality.unchanged) == ("actuator motion", 1001, 1001, 10)
    assert quality.rate_hz == pytest.approx(500.0)
    assert quality.longest_gap_ms == pytest.approx(2.0)
    assert (quality.age_median_ms, quality.age_greatest_ms) == (pytest.approx(0.2), pytest.approx(0.3))


def test_a_pause_between_two_steps_loses_nothing() -> None:
    motion = np.zeros(2000, MOTION)
    motion["sequence"] = np.arange(2000) + 227 * (np.arange(2000) >= 1000)
    motion["arrival_ns"] = motion["sequence"] * 1_000_000
    motion["position_rad"] = np.arange(2000)
    ms = 1_000_000
    steps = (
        SegmentInfo(0, "tare", "rest", Use.TARE, "undriven", 0, 1000 * ms),
        SegmentInfo(1, "free", "search", Use.IDENTIFY, "undriven", 1227 * ms, 2227 * ms),
    )
    (paused,) = stream_qualities(Measured(motion=motion, segments=steps))
    (unexplained,) = stream_qualities(Measured(motion=motion))
    assert (paused.lost, paused.longest_gap_ms) == (0, pytest.approx(1.0))
    assert paused.rate_hz == pytest.approx(1000.0)
    assert unexplained.lost == 227
