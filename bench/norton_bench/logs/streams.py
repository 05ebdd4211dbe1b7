"""Columns that were each sampled at times of their own, brought to the rows of one of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.errors import UsageError

# Intervals this much longer than the usual one are gaps; shorter ones are bridged.
GAP = 5.0
# What counts until the next message comes, however late; a command counts no longer than the gaps that are bridged.
STATES = ("goal", "enabled")
HELD = ("command", *STATES)
# What follows from the others, or changes slowly, may be missing in a row.
SPARSE = ("temperature", "supply", "normal", "enabled", "goal")
# Faster than the rows by this much, and single readings would alias: means are taken.
FASTER = 1.5

# A column is sampled apart if it has numbers in fewer of the rows than this, and its intervals are even in more.
MOSTLY = 0.5
EVEN_SHARE = 0.8


@dataclass(frozen=True)
class Stream:
    """A column by its name in the log: ``values`` at ``time_s``, both (n,)."""

    name: str
    time_s: FloatArray
    values: FloatArray

    @property
    def usual_s(self) -> float:
        """The usual interval; infinite for fewer than two instants."""
        steps = np.diff(self.time_s)
        return float(np.median(steps[steps > 0])) if np.any(steps > 0) else float("inf")

    def ordered(self) -> "Stream":
        """Without what is no number, by time, and with the last of those of one instant."""
        known = np.isfinite(self.values) & np.isfinite(self.time_s)
        order = np.argsort(self.time_s[known], kind="stable")
        time_s, values = self.time_s[known][order], self.values[known][order]
        last = np.diff(time_s, append=np.inf) > 0
        return Stream(self.name, time_s[last], values[last])


def filled_apart(time_s: FloatArray, columns: Mapping[str, FloatArray]) -> bool:
    """Whether the columns (n,) of a table were sampled apart: each has its own rows, and nothing in those of others.

    That is so where most rows lack the position, or what most of its rows lack, at even intervals; and where none of
    its rows has what may be missing in some.
    """
    lead = "position" if "position" in columns else "velocity"
    if lead not in columns:
        return False
    clock = np.isfinite(time_s)
    own = clock & np.isfinite(columns[lead])
    if not own.any():
        return False
    for what, values in columns.items():
        known = clock & np.isfinite(values)
        if what in SPARSE:
            if known.any() and not known[own].any():
                return True
            continue
        sparse = np.mean(known) < MOSTLY if what == lead else np.mean(known[own]) < MOSTLY
        if sparse and _even(time_s[known]):
            return True
    return False


def _even(time_s: FloatArray) -> bool:
    steps = np.diff(time_s)
    return bool(steps.size > 0 and np.mean(np.abs(steps - np.median(steps)) < 0.5 * np.median(steps)) > EVEN_SHARE)


def on_rows(
    place: str, streams: Mapping[str, Stream], gap_s: float | None
) -> tuple[FloatArray, dict[str, FloatArray], tuple[str, ...]]:
    """``time_s`` (n,) of the rows, the columns (n,), and what was done to those of other times.

    The rows are those of the position, or else of the velocity. Where a column has a gap, longer than ``gap_s``, or no
    value yet or any more, it is NaN. Raises UsageError for a time that is not of these rows.
    """
    lead = "position" if "position" in streams else "velocity"
    rows = streams[lead]
    time_s = _time(place, streams, lead)
    columns: dict[str, FloatArray] = {}
    remarks: list[str] = []
    for what, stream in streams.items():
        if what == "time":
            continue
        if np.array_equal(stream.time_s, rows.time_s):
            columns[what] = stream.values
            continue
        columns[what], how = _moved(what, stream.ordered(), rows, gap_s)
        remarks.append(
            f'{place}: {what} "{stream.name}" ({_rate(stream)}) has other times than {lead} "{rows.name}" '
            f"({_rate(rows)}): {how}."
        )
    return time_s, columns, tuple(remarks)


def _time(place: str, streams: Mapping[str, Stream], lead: str) -> FloatArray:
    if "time" not in streams:
        return streams[lead].time_s
    time = streams["time"]
    if not np.array_equal(time.time_s, streams[lead].time_s):
        raise UsageError(
            f'{place}: the time "{time.name}" is not of the messages of {lead} "{streams[lead].name}"; name a time of '
            "these, or leave [columns] time out"
        )
    return time.values


def _rate(stream: Stream) -> str:
    return f"{1 / stream.usual_s:.4g} Hz" if np.isfinite(stream.usual_s) else "one instant"


def _moved(what: str, stream: Stream, rows: Stream, gap_s: float | None) -> tuple[FloatArray, str]:
    """The column at the times of the rows, and in words how."""
    if not stream.time_s.size:
        return np.full(rows.time_s.size, np.nan), "it holds no number"
    longest_s = GAP * stream.usual_s if gap_s is None else max(gap_s, stream.usual_s)
    after = np.searchsorted(stream.time_s, rows.time_s, side="right")
    before = np.maximum(after - 1, 0)
    if what in HELD:
        late = rows.time_s - stream.time_s[before] > longest_s
        unknown = (after == 0) | (late & (what not in STATES))
        return np.where(unknown, np.nan, stream.values[before]), "every value is held until the next"
    unknown = _between(stream, rows.time_s, longest_s)
    if rows.usual_s > FASTER * stream.usual_s:
        return np.where(unknown, np.nan, _means(stream, rows)), "means over the intervals of the rows are taken"
    return np.where(unknown, np.nan, np.interp(rows.time_s, stream.time_s, stream.values)), "it is interpolated"


def _between(stream: Stream, time_s: FloatArray, longest_s: float) -> BoolArray:
    """Which instants lie outside the stream or in a gap of it, shape of ``time_s``."""
    after = np.searchsorted(stream.time_s, time_s, side="left")
    inside = (time_s >= stream.time_s[0]) & (time_s <= stream.time_s[-1])
    high = np.clip(after, 0, stream.time_s.size - 1)
    low = np.where(stream.time_s[high] == time_s, high, np.maximum(high - 1, 0))
    return np.asarray(~inside | (stream.time_s[high] - stream.time_s[low] > longest_s))


def _means(stream: Stream, rows: Stream) -> FloatArray:
    """Means of the line through all samples, over an interval of the rows around each."""
    steps = np.diff(stream.time_s)
    areas = np.concatenate([[0.0], np.cumsum(0.5 * (stream.values[1:] + stream.values[:-1]) * steps)])

    def area(time_s: FloatArray) -> FloatArray:
        """Below the line up to these instants: within an interval it is a parabola."""
        at = np.clip(np.searchsorted(stream.time_s, time_s, side="right") - 1, 0, steps.size - 1)
        since = time_s - stream.time_s[at]
        slope = (stream.values[at + 1] - stream.values[at]) / steps[at]
        return np.asarray(areas[at] + since * (stream.values[at] + 0.5 * slope * since))

    first = np.maximum(rows.time_s - 0.5 * rows.usual_s, stream.time_s[0])
    last = np.minimum(rows.time_s + 0.5 * rows.usual_s, stream.time_s[-1])
    return np.asarray((area(last) - area(first)) / np.maximum(last - first, 1e-12))
