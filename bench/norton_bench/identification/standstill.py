"""Values that stand still where a sensor should not: flat at the end of its range, frozen, or repeated."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import BoolArray, FloatArray, IntArray

# A flat top is this many equal values at the extreme, met at speed: what turns round by itself slows down first.
FLAT_ROWS = 5
BEFORE_ROWS = 5
# A parabola whose top fills one step of the sensor for FLAT_ROWS falls by 8 steps in the BEFORE_ROWS before it.
ABRUPT_STEPS = 16
# What slows down to rest goes at most 12/20 of the way in two rows that it went in the two before, even if it rests a
# whole row after them; what is cut off at speed goes nearly as far.
SLOWED = 0.65
# What comes from this far in one row was told to step.
STEP = 0.2
FROZEN_ROWS = 20
# A way this long, as a share of the range of the others, must have been gone while a column stood still.
ELSEWHERE = 0.05
LEAP = 0.02
# A column is held where this share of at least so many changes, of more than so many counts, keeps one rhythm.
HELD_REGULAR = 0.95
HELD_LEAST = 30
HELD_STEPS = 2


def runs(values: FloatArray) -> tuple[IntArray, IntArray]:
    """First row and length of every run of equal values."""
    first = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    return first, np.diff(np.append(first, len(values)))


def rows_of(found: Iterable[tuple[int, int]], count: int) -> BoolArray:
    """The rows of runs, given as first row and length: shape (count,)."""
    rows = np.zeros(count, dtype=bool)
    for first, length in found:
        rows[first : first + length] = True
    return rows


def resolution(values: FloatArray) -> float:
    """The smallest step between two values that occur; at least two must."""
    return float(np.min(np.diff(np.unique(values))))


def flat_tops(values: FloatArray) -> list[tuple[int, int]]:
    """Runs at either extreme that were entered or left at speed: first row and length of each."""
    first, length = runs(values)
    top = np.isin(values[first], (values.min(), values.max())) & (length >= FLAT_ROWS)
    if not top.any():
        return []
    step = resolution(values)
    return [(int(a), int(n)) for a, n in zip(first[top], length[top], strict=True) if _abrupt(values, a, n, step)]


def frozen(
    values: FloatArray,
    others: Callable[[], Sequence[FloatArray]],
    *,
    least: float,
    share_at_end: float = ELSEWHERE,
) -> list[tuple[int, int]]:
    """Runs of at least so many rows during which another column moved on, and which ``values`` left with a leap.

    At the end of a record nothing is left: another column must then have moved by ``share_at_end`` of its range.
    ``others`` are asked for only where they matter.
    """
    first, length = runs(values)
    ends = first + length
    leap = np.abs(values[np.minimum(ends, len(values) - 1)] - values[first])
    at_end = ends == len(values)
    result = np.flatnonzero((length >= least) & (at_end | (leap > LEAP * np.ptp(values))))
    if not result.size or len(first) < 2:
        return []
    result = result[at_end[result] | (leap[result] > ABRUPT_STEPS * resolution(values))]
    columns = others() if result.size else ()
    spans = [(int(first[k]), int(length[k]), share_at_end if at_end[k] else ELSEWHERE) for k in result]
    return [
        (a, n) for a, n, share in spans if any(np.ptp(other[a : a + n]) > share * np.ptp(other) for other in columns)
    ]


def held(values: FloatArray) -> tuple[int, int] | None:
    """Every how manieth row was read, and from which on, where the rows between only repeat it.

    None where every row is a reading of its own. Steps of one count are no repetition: the shaft was slow.
    """
    if np.ptp(values) == 0:
        return None
    changed = np.flatnonzero(np.diff(values))
    if 2 * len(changed) > len(values) + 2:
        return None
    steps = np.abs(np.diff(values))[changed]
    changes = changed[steps > HELD_STEPS * resolution(values)] + 1
    if len(changes) < HELD_LEAST:
        return None
    every = int(np.median(np.diff(changes)))
    if every < 2:
        return None
    phases = np.bincount(changes % every, minlength=every)
    return (every, int(np.argmax(phases))) if phases.max() > HELD_REGULAR * len(changes) else None


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
    first, then = abs(side[2] - side[0]), abs(side[4] - side[2])
    return bool(way > ABRUPT_STEPS * step and then > SLOWED * first and last < STEP * span)


# A reading that leaves both neighbours behind by so many times what readings usually change is no reading.
SPIKE = 20.0
USUAL = 0.8
FEWEST = 20


# Single rows that cannot be: values far off on their own, and stamps that go back.
def rising(stamp_ns: npt.NDArray[np.int64]) -> BoolArray:
    """Stamps later than all before them; at least one."""
    latest = np.maximum.accumulate(stamp_ns)
    return np.concatenate([[True], stamp_ns[1:] > latest[:-1]])


def spikes(values: npt.NDArray[np.float64]) -> BoolArray:
    """Single values far from both neighbours, on the same side of them."""
    result = np.zeros(values.size, dtype=bool)
    if values.size < FEWEST:
        return result
    steps = np.diff(values)
    ways = np.abs(steps)
    place = int(USUAL * (ways.size - 1))
    # One value in its place: a quantile between two costs ten times as much, and live this is asked every 100 ms.
    usual = float(np.partition(ways, place)[place]) or _count(ways)
    far = np.minimum(ways[:-1], ways[1:]) > SPIKE * usual
    result[1:-1] = far & (steps[:-1] * steps[1:] < 0.0)
    return result


def _count(ways: npt.NDArray[np.float64]) -> float:
    """At rest one count is the usual change, if there are enough of them to call it usual."""
    changes = ways[ways > 0]
    return float(np.median(changes)) if changes.size >= FEWEST else 0.0
