"""The band of frequencies that a fit looks at: what the sensors tell, and what is worth telling."""

from collections.abc import Sequence

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.regression import Regression
from norton_bench.identification.shape import INERTIA
from norton_bench.identification.signals import Signals

# The full band is narrowed only where it is worth the time.
NARROWED_BELOW = 0.7
NARROWEST_CUTOFF = 0.02


def told(stretches: Sequence[Signals], band: Kernel) -> Kernel:
    """The part of a band that sensors slower than the loop can tell."""
    periods_s = [(stretch.position_period_s, stretch.torque_period_s) for stretch in stretches]
    tick_s = stretches[0].tick_s
    return _narrowed(band, FULL_BAND.cutoff * min(1.0, tick_s / max(np.max(periods_s), tick_s)))


def _narrowed(band: Kernel, cutoff: float) -> Kernel:
    """To ``cutoff``, where that is worth the time; the narrower, the longer."""
    cutoff = max(cutoff, NARROWEST_CUTOFF)
    return band if cutoff > NARROWED_BELOW * band.cutoff else Kernel(cutoff, band.half_width * band.cutoff / cutoff)


def worthwhile_band(regression: Regression, linear: FloatArray) -> Kernel:
    """The band in which the residual's noise is nearly white, so that least squares wastes no information.

    Above it the encoder's errors, which inertia makes grow with the square of the frequency, drown the torque sensor's:
    weighting by the innovation's spectrum would leave out the same. Never wider than FULL_BAND, nor than what a sensor
    slower than the loop can tell. ``linear`` are the unknowns as far as they are known; of a free motion, which is
    the target itself, all is worth while.
    """
    tick_s = regression.rows[0].signals.tick_s
    widest = told([rows.signals for rows in regression.rows], FULL_BAND)
    torque, position = 0.0, 0.0
    for rows in regression.rows:
        count = rows.usable.size
        torque += count * rows.signals.torque_noise
        position += count * rows.signals.position_noise
    inertia = 0.0 if regression.free_motion else abs(float(linear[INERTIA]))
    if torque > 0 and position > 0 and inertia > 0:
        corner_hz = (torque / position) ** 0.25 / (2 * np.pi * np.sqrt(inertia))
        return _narrowed(widest, corner_hz * tick_s)
    return widest
