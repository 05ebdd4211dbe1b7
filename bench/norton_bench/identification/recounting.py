"""What an encoder's counts do to the friction on average, found by counting the motion again.

Friction follows every turning back, so errors of its path do not cancel: counts that are left in it make the shaft
travel too far, smoothing that takes them out cuts its turns. One reading of the motion tells neither. But the smoothed
path is a motion too, and known: counted once more by encoders whose counts lie elsewhere, and smoothed as before, it
gives a friction that differs from its own about as its own, on average, differs from the true one (a bootstrap of the
bias: of the right sign, and mostly within half of its size).
"""

from collections.abc import Iterator

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.quantisation import REACH, unquantised
from norton_bench.identification.signals import FINE, Signals, Stream

DRAWS = 2
# The zero of such an encoder wanders at about this rate, now faster, now slower, so that what is slow meets all phases
# of the counts, and no motion that repeats itself always the same; for friction that is no motion.
WANDERS_COUNTS_S = 10.0
SWAYS_COUNTS = 3.0
NO_RESTS = np.empty(0, dtype=np.int64)


def friction_error(signals: Signals, s_per_rad: float) -> FloatArray | None:
    """How much too great the friction's share h is along ``path_rad``, shape (n · FINE,); None without counts."""
    if signals.smoothed is None or signals.count_rad == 0.0 or signals.smoothed.value.size <= 2 * REACH:
        return None
    smoothed = signals.smoothed
    own, *again = (
        loops.friction_path(path, s_per_rad, NO_RESTS)[0]
        for path in (smoothed.value, *_counted_again(smoothed, signals.count_rad))
    )
    fine_s = signals.time_s[0] + np.arange(signals.path_rad.size) * (signals.tick_s / FINE)
    return np.asarray(np.interp(fine_s, smoothed.time_s, np.mean(again, axis=0) - own))


def _counted_again(smoothed: Stream, count_rad: float) -> Iterator[FloatArray]:
    wander = WANDERS_COUNTS_S * smoothed.time_s + SWAYS_COUNTS * np.sin(smoothed.time_s)
    for draw in range(DRAWS):
        zero_rad = count_rad * (wander + draw / DRAWS)
        read_rad = np.round((smoothed.value + zero_rad) / count_rad) * count_rad
        yield unquantised(read_rad, count_rad) - zero_rad
