"""How well the streams arrived: expected and lost readings, repeats, gaps, ages."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from norton_bench.arrays import IntArray
from norton_bench.records import STREAMS, Measured, SegmentInfo, Stream, Table

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
    pauses_ns = _pauses_ns(measured.segments)
    return [_quality(stream, measured, pauses_ns) for stream in STREAMS if len(getattr(measured, stream.name)) > 1]


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


def _quality(stream: Stream, measured: Measured, pauses_ns: IntArray) -> StreamQuality:
    table: Table = getattr(measured, stream.name)
    ages_ns = measured.ticks[stream.age] if stream.age else np.empty(0, np.int64)
    runs = [run for run in np.split(table, np.searchsorted(table["arrival_ns"], pauses_ns)) if len(run) > 1]
    steps_ms = np.concatenate([np.diff(run["arrival_ns"]) for run in runs]) * 1e-6
    values = [table[quantity.column] for quantity in stream.kind.quantities]
    same = np.all([each[1:] == each[:-1] for each in values], axis=0)
    ages_ms = ages_ns[ages_ns >= 0] * 1e-6
    return StreamQuality(
        name=stream.label,
        readings=len(table),
        rate_hz=1e3 / float(np.mean(steps_ms)) if np.any(steps_ms > 0) else float("nan"),
        lost=sum(lost_readings(run["arrival_ns"], run["sequence"]) for run in runs),
        unchanged=int(np.count_nonzero(same)),
        longest_gap_ms=float(steps_ms.max()),
        age_median_ms=float(np.median(ages_ms)) if ages_ms.size else float("nan"),
        age_greatest_ms=float(ages_ms.max()) if ages_ms.size else float("nan"),
    )
