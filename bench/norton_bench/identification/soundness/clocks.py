"""Rows in the order in which they came, and where the clocks that stamped them jumped."""

import numpy as np

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.records import NO_DEVICE_TIME, Table

# A stamp this much before another is no matter of order: the clock was set back.
SET_BACK_NS = 100_000_000
# More steps back than this are a matter of order.
MOST_JUMPS = 10
# Two clocks that part by more than this, for good, have not both been left alone.
PARTED_NS = 2_000_000
BLOCK = 64
AROUND = 8
# A stream that overruns the others by a gap of its own, to within this, was set forward there.
OVERRUN_NS = 200_000_000
LIKE_GAP = 0.1
# Clocks that differ more than this in rate are not both in nanoseconds.
RATES_DIFFER = 0.02


def in_order(table: Table, stamp: str) -> Table:
    """Rows as they came, each once: by their number where they bear one, else by their stamp."""
    if "sequence" in (table.dtype.names or ()):
        if np.all(np.diff(table["sequence"]) > 0):
            return table
        order = np.argsort(table["sequence"], kind="stable")
        again = np.diff(table["sequence"][order]) == 0
        # Rows of one number are one row, if they were stamped at once; else the numbers are none.
        if np.all(np.diff(table[stamp][order])[again] == 0):
            once: Table = table[order[np.concatenate([[True], ~again])]]
            return once
    back = np.diff(table[stamp]) < 0
    if back.any() and (np.count_nonzero(back) > MOST_JUMPS or np.diff(table[stamp]).min() > -SET_BACK_NS):
        return np.asarray(table[np.argsort(table[stamp], kind="stable")])
    return table


def jumps(table: Table, stamp: str, others_end_ns: int) -> IntArray:
    """Rows, in order, before which a clock jumped: set back, set forward, or parted from the device's own."""
    stamps = table[stamp]
    steps = np.diff(stamps)
    found = np.flatnonzero(steps < -SET_BACK_NS) + 1
    overrun = int(stamps[-1]) - others_end_ns
    widest = int(np.argmax(steps)) if steps.size else 0
    if steps.size and overrun > OVERRUN_NS and abs(int(steps[widest]) - overrun) < LIKE_GAP * overrun:
        found = np.append(found, widest + 1)
    if has_device_clock(table):
        found = np.append(found, _partings((stamps - table["device_ns"]).astype(np.float64)))
    return np.unique(found)


def has_device_clock(table: Table) -> bool:
    """Whether every row bears the device's own time."""
    return "device_ns" in (table.dtype.names or ()) and bool(np.all(table["device_ns"] != NO_DEVICE_TIME))


def useless_device_clock(table: Table, stamp: str) -> bool:
    """Whether the device's clock stands still or runs at another rate than the host's."""
    reach = min(BLOCK, len(table) - 1)
    host, own = (table[name][reach:] - table[name][: len(table) - reach] for name in (stamp, "device_ns"))
    return bool(reach == BLOCK and abs(np.median(own / np.maximum(host, 1)) - 1.0) > RATES_DIFFER)


def longest(count: int, breaks: IntArray) -> slice:
    """The longest part of so many rows between breaks."""
    edges = np.concatenate([[0], breaks, [count]])
    part = int(np.argmax(np.diff(edges)))
    return slice(int(edges[part]), int(edges[part + 1]))


def _partings(difference: FloatArray) -> IntArray:
    """Where the difference of two clocks changes for good; late readings come and go."""
    blocks = len(difference) // BLOCK
    if blocks < 2 * AROUND:
        return np.empty(0, dtype=np.int64)
    middle = np.median(difference[: blocks * BLOCK].reshape(blocks, BLOCK), axis=1)
    around = np.lib.stride_tricks.sliding_window_view(middle, AROUND)
    level = np.median(around, axis=1)
    change = np.abs(level[AROUND:] - level[:-AROUND])
    found = []
    while change.size and change.max() > PARTED_NS:
        at = int(np.argmax(change))
        first, last = at * BLOCK, (at + 2 * AROUND) * BLOCK
        found.append(first + 1 + int(np.argmax(np.abs(np.diff(difference[first:last])))))
        change[max(at - 2 * AROUND, 0) : at + 2 * AROUND] = 0.0
    return np.array(sorted(found), dtype=np.int64)
