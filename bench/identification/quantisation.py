"""Undoing an encoder's counts: a smooth motion that agrees with every reading.

A count only says that the shaft is somewhere within one step. Taken literally, a shaft at rest on the edge of two
counts seems to travel back and forth, and its friction to slide. The motion is found by turns: smooth it, then put it
back inside the steps that were read (projection onto two convex sets); whatever the smoothing does, the
result is never further from the truth than one step.
"""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from bench.identification.kernels import Kernel

FloatArray = npt.NDArray[np.float64]

# In cycles a reading. Faster motion than this shows only where it exceeds one step. Narrower, or more often, and small
# loops are flattened (friction seems softer); wider, and counts remain as travel (it seems stiffer).
SMOOTH = Kernel(cutoff=0.02, half_width=24.0)
ROUNDS = 1
# A shaft that moves less than so many counts within so many readings is as good as stuck.
MOVING_COUNTS = 8
MOVING_WITHIN = 31
SMALLEST_STEP_RAD = 1e-9
# Differences up to this many steps tell the step; at least this share of them must be whole multiples of it.
TELLING_STEPS = 12
WHOLE_SHARE = 0.9
WHOLE_WITHIN = 0.25


def resolution_rad(position_rad: FloatArray) -> float:
    """The step in which positions come [rad]; 0 where none can be seen."""
    steps = np.abs(np.diff(position_rad))
    steps = np.sort(steps[steps > SMALLEST_STEP_RAD])
    if steps.size < 20:
        return 0.0
    # Rounding to a float32 makes equal steps differ a little: the smallest group, not the smallest number.
    step = float(np.median(steps[steps < 1.5 * steps[steps.size // 200]]))
    small = steps[steps < TELLING_STEPS * step]
    for _ in range(3):
        multiple = np.maximum(np.round(small / step), 1)
        step = float((small @ multiple) / (multiple @ multiple))
    whole = np.abs(small / step - np.round(small / step)) < WHOLE_WITHIN
    return step if small.size >= 20 and np.mean(whole) >= WHOLE_SHARE else 0.0


def moving(path_rad: FloatArray, step_rad: float) -> npt.NDArray[np.bool_]:
    """Where the path leaves the counts behind, shape (n,): elsewhere they do not tell what friction holds."""
    if step_rad == 0.0:
        return np.ones(path_rad.size, dtype=bool)
    travelled = maximum_filter1d(path_rad, MOVING_WITHIN) - minimum_filter1d(path_rad, MOVING_WITHIN)
    return np.asarray(travelled > MOVING_COUNTS * step_rad)


def unquantised(position_rad: FloatArray, step_rad: float) -> FloatArray:
    """A smooth motion within ± half a step of the readings, shape (n,)."""
    from bench.identification import loops  # noqa: PLC0415  (compiled: slow to import)

    if step_rad == 0.0 or position_rad.size < 2 * SMOOTH.half_width:
        return position_rad
    reach = int(SMOOTH.half_width)
    taps = SMOOTH.taps(np.arange(-reach, reach + 1, dtype=float), 0)
    return np.asarray(loops.smooth_within(position_rad, 0.5 * step_rad, taps, ROUNDS))
