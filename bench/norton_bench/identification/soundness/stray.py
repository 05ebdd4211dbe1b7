"""Single rows that cannot be: values far off on their own, and stamps that go back."""

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import BoolArray

# A reading that leaves both neighbours behind by so many times what readings usually change is no reading.
SPIKE = 20.0
USUAL = 0.8
FEWEST = 20


def rising(stamp_ns: npt.NDArray[np.int64]) -> BoolArray:
    """Stamps later than all before them; at least one."""
    latest = np.maximum.accumulate(stamp_ns)
    return np.concatenate([[True], stamp_ns[1:] > latest[:-1]])


def spikes(values: npt.NDArray[np.float64]) -> BoolArray:
    """Single values far from both neighbours, on the same side of them."""
    found = np.zeros(values.size, dtype=bool)
    if values.size < FEWEST:
        return found
    steps = np.diff(values)
    ways = np.abs(steps)
    place = int(USUAL * (ways.size - 1))
    # One value in its place: a quantile between two costs ten times as much, and live this is asked every 100 ms.
    usual = float(np.partition(ways, place)[place]) or _count(ways)
    far = np.minimum(ways[:-1], ways[1:]) > SPIKE * usual
    found[1:-1] = far & (steps[:-1] * steps[1:] < 0.0)
    return found


def _count(ways: npt.NDArray[np.float64]) -> float:
    """At rest one count is the usual change, if there are enough of them to call it usual."""
    changes = ways[ways > 0]
    return float(np.median(changes)) if changes.size >= FEWEST else 0.0
