"""How well the streams arrived: expected and lost readings, repeats, gaps, ages."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from norton_bench.arrays import IntArray
from norton_bench.records import Measured, SegmentInfo, Table

# Longer than any stall that the loop lives through.
LEAST_PAUSE_NS = 60_000_000
_BLOCK = 64  # readings; long enough to average jitter out, short enough for the period to stay what it was


@dataclass(frozen=True)
class StreamQuality:
    """One stream. ``unchanged`` counts readings that repeat the one before: a shaft at rest, or a device asleep."""

    name: str
    readings: int
    rate_hz: float
    lost: int
    unchanged: int
    longest_gap_ms: float
    age_median_ms: float
    age_greatest_ms: float

    @property
    def expected(self) -> int:
        return self.readings + self.lost


def stream_qualities(measured: Measured) -> list[StreamQuality]:
    """One entry for every stream that has readings. Between steps nothing is recorded, and nothing lost."""
    ticks, pauses_ns = measured.ticks, _pauses_ns(measured.segments)
    streams = [
        ("actuator motion", measured.motion, ("position_rad", "velocity_rad_s"), ticks["motion_age_ns"]),
        ("load motion", measured.load_motion, ("position_rad", "velocity_rad_s"), ticks["load_motion_age_ns"]),
        ("port torque", measured.torque, ("torque_nm",), ticks["torque_age_ns"]),
        ("actuator current", measured.current, ("current_a",), np.empty(0, np.int64)),
        ("load current", measured.load_current, ("current_a",), np.empty(0, np.int64)),
        (
            "modulator motion",
            measured.modulator_motion,
            ("position_rad", "velocity_rad_s"),
            ticks["modulator_motion_age_ns"],
        ),
        ("modulator current", measured.modulator_current, ("current_a",), np.empty(0, np.int64)),
    ]
    return [_quality(name, table, values, ages, pauses_ns) for name, table, values, ages in streams if len(table) > 1]


def lost_readings(arrival_ns: IntArray, sequence: IntArray) -> int:
    """Readings that should have come and did not.

    Where sequence numbers jump, the jumps say it; otherwise whole periods that are missing from blocks of readings do.
    A reading that is merely late takes from one block what it gives to the next.
    """
    jumps = int(sequence[-1] - sequence[0] + 1 - len(sequence))
    if jumps > 0 or len(arrival_ns) <= 2 * _BLOCK:
        return max(jumps, 0)
    edges = arrival_ns[::_BLOCK].astype(np.float64)
    spans = np.diff(edges)
    period = float(np.median(spans)) / _BLOCK
    return max(0, int(np.sum(np.round(spans / period) - _BLOCK)))


def _pauses_ns(segments: tuple[SegmentInfo, ...]) -> IntArray:
    """The middle of every pause between one segment and the next."""
    pairs = list(pairwise(sorted(segments, key=lambda segment: segment.start_ns)))
    ends = [(a.end_ns, b.start_ns) for a, b in pairs if b.start_ns - a.end_ns > LEAST_PAUSE_NS]
    return np.array([(end_ns + start_ns) // 2 for end_ns, start_ns in ends], np.int64)


def _quality(name: str, table: Table, values: tuple[str, ...], ages_ns: IntArray, pauses_ns: IntArray) -> StreamQuality:
    runs = [run for run in np.split(table, np.searchsorted(table["arrival_ns"], pauses_ns)) if len(run) > 1]
    steps_ms = np.concatenate([np.diff(run["arrival_ns"]) for run in runs]) * 1e-6
    same = np.all([table[value][1:] == table[value][:-1] for value in values], axis=0)
    ages_ms = ages_ns[ages_ns >= 0] * 1e-6
    return StreamQuality(
        name=name,
        readings=len(table),
        rate_hz=1e3 / float(np.mean(steps_ms)) if np.any(steps_ms > 0) else float("nan"),
        lost=sum(lost_readings(run["arrival_ns"], run["sequence"]) for run in runs),
        unchanged=int(np.count_nonzero(same)),
        longest_gap_ms=float(steps_ms.max()),
        age_median_ms=float(np.median(ages_ms)) if ages_ms.size else float("nan"),
        age_greatest_ms=float(ages_ms.max()) if ages_ms.size else float("nan"),
    )
