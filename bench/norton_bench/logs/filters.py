"""Zero-phase low-pass, derivatives, and the one decimation that both sides of an equation pass."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import signal
from scipy.interpolate import make_interp_spline

from norton_bench.arrays import FloatArray

# Where the map says nothing: the low-pass of the position, and the rows' rate, as shares of the sampling rate.
CUTOFF = 0.1
ROWS = 0.1
HIGHEST_CUTOFF = 0.4
SLOWEST_ROWS_HZ = 100.0
# Before decimation: 8th order Chebyshev, 0.05 dB of ripple up to this share of the new Nyquist frequency.
PASS = 0.8
# Filters have settled after this many rows, or periods of the cutoff.
SETTLED_ROWS = 5
SETTLED_PERIODS = 2


@dataclass(frozen=True)
class Filters:
    """What stands between samples every ``dt_s`` and the rows of the equation, ``factor`` samples apart.

    ``margin`` samples around anything that is not to be used are spoilt by the filters' memory.
    """

    dt_s: float
    cutoff_hz: float
    factor: int

    @classmethod
    def of(cls, dt_s: float, cutoff_hz: float | None, rows_hz: float | None) -> "Filters":
        """A cutoff that the samples are too coarse for is as good as none: it is held below half of their rate."""
        rate_hz = 1 / dt_s
        cutoff = min(CUTOFF * rate_hz if cutoff_hz is None else cutoff_hz, HIGHEST_CUTOFF * rate_hz)
        rows = max(ROWS * rate_hz, min(SLOWEST_ROWS_HZ, rate_hz)) if rows_hz is None else rows_hz
        return cls(dt_s, cutoff, max(1, round(rate_hz / rows)))

    @property
    def margin(self) -> int:
        settled = SETTLED_PERIODS / (self.cutoff_hz * self.dt_s)
        return int(np.ceil(max(SETTLED_ROWS * self.factor if self.factor > 1 else 0, settled)))

    def smooth(self, values: FloatArray) -> FloatArray:
        """4th order Butterworth, forwards and backwards."""
        sos = signal.butter(4, self.cutoff_hz, fs=1 / self.dt_s, output="sos")
        return np.asarray(signal.sosfiltfilt(sos, values))

    def anti_alias(self, values: FloatArray) -> FloatArray:
        """Rows of shape (columns, n) as they are before every ``factor``-th is taken."""
        if self.factor == 1:
            return values
        return np.asarray(signal.sosfiltfilt(_chebyshev(self.factor), values, axis=-1))


@cache
def _chebyshev(factor: int) -> FloatArray:
    return np.asarray(signal.cheby1(8, 0.05, PASS / factor, output="sos"))


def slope(values: FloatArray, dt_s: float) -> FloatArray:
    """The derivative of the spline of fifth order through all samples, shape (n,).

    Central differences lose sin(ωT)/(ωT) of every frequency, which shows as inertia: 2 % of it for EMPS at 200 Hz.
    """
    time_s = dt_s * np.arange(len(values))
    return np.asarray(make_interp_spline(time_s, values, k=5).derivative()(time_s))


def integral(values: FloatArray, dt_s: float) -> FloatArray:
    """From zero, by trapezoids, shape (n,)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * dt_s)])
