"""Values and intervals from repetitions alone: Student's t, at a level at which a whole table may be believed."""

import numpy as np
import numpy.typing as npt
from scipy.stats import t as t_distribution

from norton_bench.gallery.claim import Estimated

FloatArray = npt.NDArray[np.float64]

# One interval in a thousand misses by chance: of a gallery of some thirty rows, one gallery in thirty-five.
LEVEL = 0.999


def mean(values: npt.ArrayLike) -> Estimated:
    """Of independent repetitions (n,)."""
    repetitions = np.asarray(values, dtype=float)
    half = _student(repetitions.size - 1) * float(np.std(repetitions, ddof=1)) / np.sqrt(repetitions.size)
    return _around(float(np.mean(repetitions)), half)


def wider(found: Estimated, by: float) -> Estimated:
    """With a tolerance that no repetition shows."""
    low, high = found.interval
    return Estimated(found.value, (low - by, high + by))


class Line:
    """A straight line through independent points (n,), by least squares."""

    def __init__(self, x: npt.ArrayLike, y: npt.ArrayLike) -> None:
        self._x = np.asarray(x, dtype=float)
        values = np.asarray(y, dtype=float)
        self._middle = float(np.mean(self._x))
        self._spread = float(np.sum((self._x - self._middle) ** 2))
        self._slope = float(np.sum((self._x - self._middle) * values)) / self._spread
        self._mean = float(np.mean(values))
        self._freedom = values.size - 2
        left = values - self.at(self._x)
        self._scatter = float(np.sqrt(np.sum(left**2) / self._freedom))

    def at(self, x: npt.ArrayLike) -> FloatArray:
        return self._mean + self._slope * (np.asarray(x, dtype=float) - self._middle)

    @property
    def slope(self) -> Estimated:
        return _around(self._slope, _student(self._freedom) * self._scatter / np.sqrt(self._spread))

    def value(self, x: float) -> Estimated:
        """Of the line itself at ``x``."""
        return _around(float(self.at(x)), _student(self._freedom) * self._deviation(x))

    def zero(self) -> Estimated:
        """Where the line crosses zero: Fieller's interval, of all places where zero lies in the line's own interval."""
        zero = self._middle - self._mean / self._slope
        t = _student(self._freedom)
        g = (t * self._scatter / self._slope) ** 2 / self._spread
        if g >= 1.0:
            return Estimated(zero, (-np.inf, np.inf))
        centre = self._middle + (zero - self._middle) / (1 - g)
        half = t * self._scatter / abs(self._slope) / (1 - g)
        half *= np.sqrt((1 - g) / self._x.size + (zero - self._middle) ** 2 / self._spread)
        return Estimated(zero, (centre - float(half), centre + float(half)))

    def _deviation(self, x: float) -> float:
        return float(self._scatter * np.sqrt(1 / self._x.size + (x - self._middle) ** 2 / self._spread))


def _student(freedom: int) -> float:
    return float(t_distribution.ppf(0.5 + 0.5 * LEVEL, freedom))


def _around(value: float, half: float) -> Estimated:
    return Estimated(value, (value - float(half), value + float(half)))
