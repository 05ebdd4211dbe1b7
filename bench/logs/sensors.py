"""Columns that do not tell what they should: constant, at the end of their range, or frozen on one value."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from bench.errors import UsageError
from bench.logs.log import Log

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

MEASURED = ("position", "velocity", "exertion", "command")
# A flat top is this many equal values at the extreme, met at speed: what turns round by itself slows down first.
FLAT_ROWS = 5
BEFORE_ROWS = 5
FLAT_LEAST = 0.001
# A parabola whose top fills one step of the sensor for FLAT_ROWS falls by 8 steps in the BEFORE_ROWS before it.
ABRUPT_STEPS = 16
# What comes from this far in one row was told to step.
STEP = 0.2
FROZEN_ROWS = 20
FROZEN_SHARE = 0.01
# A way this long, as a share of the range of the others, must have been gone while a column stood still.
ELSEWHERE = 0.05
NEAR_LIMIT = 0.01
LEAP = 0.02
# A column is held where this share of at least so many changes, of more than so many counts, keeps one rhythm.
HELD_REGULAR = 0.95
HELD_LEAST = 30
HELD_STEPS = 2


def check_constant(log: Log) -> None:
    """Raises UsageError for a column that never changes."""
    for name in MEASURED:
        values = log.columns.get(name)
        if values is not None and np.ptp(values) == 0:
            mend = "leave it out of the map if the actuator was idle" if name == "command" else "check the column"
            raise UsageError(f"{log.place}: {name} is constant ({values[0]:.6g}): it tells nothing; {mend}")


def untrustworthy(log: Log) -> tuple[BoolArray, tuple[str, ...]]:
    """Rows in which a sensor was at the end of its range or frozen, shape (n,), and a sentence for each such column."""
    wrong = np.zeros(len(log.time_s), dtype=bool)
    sentences = []
    for name in MEASURED:
        if name not in log.columns:
            continue
        values = log.columns[name]
        flat = _rows_of(_flat_tops(values), len(values)) & ~_limited(log, name)
        if np.count_nonzero(flat) >= FLAT_LEAST * len(values):
            wrong |= flat
            ends = ", ".join(f"{end:.4g}" for end in np.unique(values[flat]))
            sentences.append(
                f"{log.place}: {name} is saturated, flat at {ends} in {np.mean(flat):.1%} of the rows, left out."
            )
        frozen = _rows_of(_frozen(log, name), len(values)) & ~flat & ~_limited(log, name)
        if frozen.any():
            wrong |= frozen
            first = log.time_s[int(np.argmax(frozen))]
            sentences.append(
                f"{log.place}: {name} is frozen in {np.mean(frozen):.1%} of the rows (first at {first:.4g} s), "
                "left out."
            )
    return wrong, tuple(sentences)


def _limited(log: Log, name: str) -> BoolArray:
    """Where a command rightly stands still: at the limit that the device's law keeps to, or switched off."""
    rows = np.zeros(len(log.time_s), dtype=bool)
    if name != "command":
        return rows
    limit = log.given("loop", "limit")
    if limit is not None:
        rows |= np.abs(np.abs(log.columns[name]) - limit) < NEAR_LIMIT * limit
    if "enabled" in log.columns:
        rows |= log.columns["enabled"] < 0.5
    return rows


def _runs(values: FloatArray) -> tuple[IntArray, IntArray]:
    """First row and length of every run of equal values."""
    first = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    return first, np.diff(np.append(first, len(values)))


def _rows_of(runs: Iterable[tuple[int, int]], count: int) -> BoolArray:
    rows = np.zeros(count, dtype=bool)
    for first, length in runs:
        rows[first : first + length] = True
    return rows


def _flat_tops(values: FloatArray) -> list[tuple[int, int]]:
    """Runs at either extreme that were entered or left at speed."""
    first, length = _runs(values)
    top = np.isin(values[first], (values.min(), values.max())) & (length >= FLAT_ROWS)
    step = resolution(values)
    return [(int(a), int(n)) for a, n in zip(first[top], length[top], strict=True) if _abrupt(values, a, n, step)]


def resolution(values: FloatArray) -> float:
    """The smallest step between two values that occur."""
    return float(np.min(np.diff(np.unique(values))))


def _abrupt(values: FloatArray, first: int, length: int, step: float) -> bool:
    """Whether the values before or after a run came and went too fast for a turn."""
    before = values[max(first - BEFORE_ROWS, 0) : first + 1]
    after = values[first + length - 1 : first + length + BEFORE_ROWS][::-1]
    return any(_fast(side, step, float(np.ptp(values))) for side in (before, after))


def _fast(side: FloatArray, step: float, span: float) -> bool:
    """``side`` ends on the flat: how it got there."""
    if len(side) <= BEFORE_ROWS:
        return False
    way, last = abs(side[-1] - side[0]), abs(side[-1] - side[-2])
    return bool(way > ABRUPT_STEPS * step and last < STEP * span)


def _frozen(log: Log, name: str) -> list[tuple[int, int]]:
    """Long runs of one column during which another one moved on, and which it left with a leap.

    A command may well be held; one that else changes in every row is frozen where it does not.
    """
    values = log.columns[name]
    first, length = _runs(values)
    long = length >= max(FROZEN_ROWS, FROZEN_SHARE * len(values))
    if name == "command" and np.median(length) > 1:
        return []
    others = [log.columns[other] for other in MEASURED if other in log.columns and other != name]
    step, found = resolution(values), []
    for a, n in zip(first[long], length[long], strict=True):
        went_on = any(np.ptp(other[a : a + n]) > ELSEWHERE * np.ptp(other) for other in others)
        leap = abs(values[min(a + n, len(values) - 1)] - values[a])
        # A shaft may well rest at the end; not under a command that swings by half of its range.
        share = 0.5 if name == "position" else ELSEWHERE
        at_end = a + n == len(values) and any(np.ptp(other[a:]) > share * np.ptp(other) for other in others)
        if went_on and (at_end or leap > max(ABRUPT_STEPS * step, LEAP * np.ptp(values))):
            found.append((int(a), int(n)))
    return found


def held_rows(log: Log) -> tuple[int, int] | None:
    """Every how manieth row a sensor was read, and from which on, where the rows between only repeat it.

    None where every row is a reading of its own. Steps of one count are no repetition: the shaft was slow.
    """
    for name in ("position", "velocity", "exertion"):
        values = log.columns.get(name)
        if values is None:
            continue
        changes = np.flatnonzero(np.abs(np.diff(values)) > HELD_STEPS * resolution(values)) + 1
        if len(changes) < HELD_LEAST:
            continue
        every = int(np.median(np.diff(changes)))
        if every < 2:
            continue
        phases = np.bincount(changes % every, minlength=every)
        if phases.max() > HELD_REGULAR * len(changes):
            return every, int(np.argmax(phases))
    return None
