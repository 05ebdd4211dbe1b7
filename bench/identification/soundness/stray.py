"""Single rows that cannot be: values far off on their own, and stamps that go back."""

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]

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
    changes = ways[ways > 0]
    # At rest one count is the usual change, if there are enough of them to call it usual.
    counts = float(np.median(changes)) if changes.size >= FEWEST else 0.0
    far = np.minimum(ways[:-1], ways[1:]) > SPIKE * (float(np.quantile(ways, USUAL)) or counts)
    found[1:-1] = far & (steps[:-1] * steps[1:] < 0.0)
    return found
