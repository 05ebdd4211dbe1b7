"""Band-limited kernels: one low-pass that filters, differentiates, resamples and shifts.

Every kernel is a windowed sinc (Kaiser, with smooth ends), known as a function of continuous time, so that a signal is
filtered, differentiated, resampled and shifted by a fraction of a sample in one and the same sum.
"""

from dataclasses import dataclass
from functools import cache
from math import factorial

import numpy as np
import scipy

from norton_bench.arrays import FloatArray

TABLE_PER_UNIT = 512
KAISER_BETA = 4.0
# The window ends at zero with its first two derivatives: else a shift that carries the end over a sample would show as
# a jump of whatever is differentiated.
EDGE_POWER = 3


@dataclass(frozen=True)
class Kernel:
    """A low-pass with its first two derivatives, over ``|u| <= half_width`` in units of a sample; -6 dB at ``cutoff``
    cycles a sample. ``window`` samples are averaged over besides; ``half_width`` has half of them in it."""

    cutoff: float
    half_width: float
    window: float = 0.0

    def averaging(self, window: float) -> "Kernel":
        """The same, of a signal that is averaged over ``window`` samples, half of them later."""
        return self if window <= 0.0 else Kernel(self.cutoff, self.half_width + 0.5 * window, window)

    def spline(self) -> "scipy.interpolate.BSpline":
        return _spline(self.cutoff, self.half_width - 0.5 * self.window, self.window)

    def energy(self, derivative: int) -> float:
        """∫ K² of the kernel's derivative: what it makes of white noise of density 1, in units of a sample."""
        return _energy(self, derivative)

    def spectrum(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies [cycles a sample] up to half of the rate, evenly spaced, and the power that passes: (n,) each."""
        return _spectrum(self)

    def table(self) -> FloatArray:
        """The kernel at TABLE_PER_UNIT points a sample, from 0 to ``half_width``."""
        return _table(self)

    def taps(self, offsets: FloatArray, derivative: int, *, of_means: bool = False, exact_to: int = 0) -> FloatArray:
        """Weights at ``offsets`` (samples, equally spaced) that give a signal's ``derivative`` at offset 0.

        Exact on polynomials up to the derivative's order, or up to ``exact_to``: constants, ramps and parabolas come
        out as they should, however large a position has grown. ``of_means`` is for values that are means over cells
        around the offsets, as kinks and jumps need it: what the mean takes off high frequencies is given back.
        """
        inside = np.abs(offsets) <= self.half_width
        at = np.clip(-offsets, -self.half_width, self.half_width)
        raw = self.spline()(at, nu=derivative)
        if of_means:
            raw = raw - (offsets[1] - offsets[0]) ** 2 / 24 * self.spline()(at, nu=derivative + 2)
        weights = np.where(inside, raw, 0.0) * (offsets[1] - offsets[0])
        window = np.where(inside, np.maximum(1 - (offsets / self.half_width) ** 2, 0.0), 0.0)
        powers = np.stack([offsets**order for order in range(max(derivative, exact_to) + 1)])
        wanted = np.zeros(len(powers))
        wanted[derivative] = float(factorial(derivative))
        # The smallest change that makes the moments exact.
        correction = np.linalg.solve((powers * window) @ powers.T, wanted - powers @ weights)
        return np.asarray(weights + window * (correction @ powers))


SPECTRUM_POINTS = 512

# The band of the final and of the live fit, in cycles a tick.
FULL_BAND = Kernel(cutoff=0.18, half_width=8.0)


@cache
def _table(kernel: Kernel) -> FloatArray:
    u = np.arange(round(kernel.half_width * TABLE_PER_UNIT) + 2) / TABLE_PER_UNIT
    return np.where(u <= kernel.half_width, kernel.spline()(np.minimum(u, kernel.half_width)), 0.0)


@cache
def _spectrum(kernel: Kernel) -> tuple[FloatArray, FloatArray]:
    reach = round(kernel.half_width)
    passed = np.fft.rfft(kernel.spline()(np.arange(-reach, reach + 1)), SPECTRUM_POINTS)
    frequency = np.asarray(np.fft.rfftfreq(SPECTRUM_POINTS), dtype=np.float64)
    return frequency, np.asarray(np.abs(passed) ** 2, dtype=np.float64)


@cache
def _energy(kernel: Kernel, derivative: int) -> float:
    u = np.linspace(-kernel.half_width, kernel.half_width, round(2 * kernel.half_width * TABLE_PER_UNIT) + 1)
    return float(np.sum(kernel.spline()(u, nu=derivative) ** 2) * (u[1] - u[0]))


@cache
def _spline(cutoff: float, half_width: float, window: float) -> "scipy.interpolate.BSpline":
    u = _knots(half_width)
    inside = np.maximum(1 - (u / half_width) ** 2, 0.0)
    weight = np.i0(KAISER_BETA * np.sqrt(inside)) / np.i0(KAISER_BETA) * inside**EDGE_POWER
    spline = scipy.interpolate.make_interp_spline(u, 2 * cutoff * np.sinc(2 * cutoff * u) * weight, k=5)
    if not window:
        return spline
    integral = spline.antiderivative()
    wide = _knots(half_width + 0.5 * window)
    ends = (np.clip(wide + side * window, -half_width, half_width) for side in (0.5, -0.5))
    later, earlier = (integral(end) for end in ends)
    return scipy.interpolate.make_interp_spline(wide, (later - earlier) / window, k=5)


def _knots(half_width: float) -> FloatArray:
    return np.linspace(-half_width, half_width, round(2 * half_width * 64) + 1)
