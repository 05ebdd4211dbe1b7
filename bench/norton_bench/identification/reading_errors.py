"""Errors of one stream's readings, as the readings themselves tell them, and readings that are drawn with them."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.counts import NO_STEPS, Resolution
from norton_bench.identification.readings import (
    MEDIAN_OF_NORMAL,
    NOISE_FEWEST_BLOCKS,
    NOISE_ORDER,
    NOISE_VARIANCE,
    NORMAL_MEDIAN_SQUARE,
    NORMAL_OF_MEDIAN_DEVIATION,
)
from norton_bench.identification.signals import TimeSeries

# Noise is told from errors of the instants by readings in blocks of so many, fast ones and slow ones.
BLOCK = 100
# Least absolute deviations are found by weighted least squares, in so many rounds. A weight is one over the deviation,
# relative to the line, or over this where that is smaller.
LINE_ROUNDS, NEAR = 30, 1e-2


@dataclass(frozen=True)
class ReadingErrors:
    """Errors of one stream's readings, as measured: independent noise, the steps in which values come, and how far the
    instants at which they are taken scatter.

    ``variance_std`` is the standard error of the noise's variance.
    """

    noise: float
    steps: Resolution
    jitter_s: float
    variance_std: float = 0.0

    @classmethod
    def of(cls, stream: TimeSeries, steps: Resolution) -> "ReadingErrors":
        """The variance of a reading's error is a + b·rate²: b is that of its instant."""
        squares = np.diff(stream.value, NOISE_ORDER) ** 2 / NOISE_VARIANCE
        rate = np.gradient(stream.value, stream.time_s)[NOISE_ORDER // 2 : -(NOISE_ORDER // 2)]
        count = squares.size // BLOCK
        if count < NOISE_FEWEST_BLOCKS:
            return cls(0.0, steps, 0.0)
        blocks = squares[: count * BLOCK].reshape(count, BLOCK)
        # The median passes over shocks; for normal errors it is this much of the mean.
        power = np.median(blocks, axis=1) / NORMAL_MEDIAN_SQUARE
        speed = np.mean(rate[: count * BLOCK].reshape(count, BLOCK) ** 2, axis=1)
        constant, slope, constant_std = _line(speed, power)
        noise = float(np.sqrt(max(constant - steps.variance, 0.0)))
        return cls(noise, steps, float(np.sqrt(slope)), constant_std)

    @property
    def known_to(self) -> float:
        """The standard error of the variance of a reading at rest, over that variance."""
        variance = self.noise**2 + self.steps.variance
        return self.variance_std / variance if variance > 0.0 else 0.0

    def no_more_than(self, variance: float, rate: FloatArray) -> "ReadingErrors":
        """The same with noise and jitter so small that readings which change at ``rate`` (n,) have no greater variance,
        in the mean; the steps stay."""
        own, most = self.noise**2 + self.jitter_s**2 * float(np.mean(rate**2)), max(variance - self.steps.variance, 0.0)
        if own <= most:
            return self
        share = float(np.sqrt(most / own))
        return ReadingErrors(share * self.noise, self.steps, share * self.jitter_s, share**2 * self.variance_std)

    def drawn(self, values: FloatArray, rate: FloatArray, random: np.random.Generator) -> FloatArray:
        """Readings of ``values`` (n,), which change at ``rate`` (n,)."""
        read = values + self.jitter_s * rate * random.standard_normal(values.size)
        read += self.noise * random.standard_normal(values.size)
        return self.steps.read(read, self.steps.count * random.uniform()) if self.steps.count > 0.0 else read


NO_ERRORS = ReadingErrors(0.0, NO_STEPS, 0.0)


def _line(x: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Intercept and slope, neither negative, of values whose scatter goes with their size: shape (n,) each; and the
    standard error of the intercept.

    Least absolute deviations, relative to the line: while a shaft is shaken, its motion may pass for noise in some of
    the blocks, a hundred times as great as that of the others. Where no reading differs from the next, values tell
    nothing: counts hide all.
    """
    x, y = x[y > 0.0], y[y > 0.0]
    if not y.size:
        return 0.0, 0.0, 0.0
    constant, slope, mean_x, spread = float(np.median(y)), 0.0, 0.0, 0.0
    for _ in range(LINE_ROUNDS):
        line = np.maximum(constant + slope * x, 1e-30)
        weight = 1.0 / (line * np.maximum(np.abs(y - line), NEAR * line))
        mean_x, mean_y = float(np.average(x, weights=weight)), float(np.average(y, weights=weight))
        spread = float(np.average((x - mean_x) ** 2, weights=weight))
        slope = max(float(np.average((x - mean_x) * (y - mean_y), weights=weight)) / spread, 0.0) if spread > 0 else 0.0
        constant = mean_y - slope * mean_x
        if constant < 0.0:
            constant, slope = 0.0, float(np.sum(weight * x * y) / np.sum(weight * x * x))
    line = np.maximum(constant + slope * x, 1e-30)
    scatter = MEDIAN_OF_NORMAL * NORMAL_OF_MEDIAN_DEVIATION * float(np.median(np.abs(y / line - 1.0)))
    lever = 1.0 + (mean_x**2 / spread if slope > 0.0 and spread > 0.0 else 0.0)
    return constant, slope, scatter * float(np.sqrt(lever / np.sum(line**-2.0)))
