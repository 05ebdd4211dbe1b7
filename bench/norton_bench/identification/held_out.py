"""Choosing between models by what each errs on data that it has not seen."""

from collections.abc import Sequence

import numpy as np

from norton_bench.arrays import FloatArray

# A richer model has to leave this much less, relative.
LEAST_GAIN = 0.01


def held_out_rms(mean_squares: Sequence[float]) -> tuple[float, float]:
    """The error over all folds and its standard error, from each fold's mean square (folds,)."""
    rms = float(np.sqrt(np.mean(mean_squares)))
    return rms, _standard_error(np.array(mean_squares)) / (2 * rms) if rms > 0 else 0.0


def simplest_as_good(mean_squares: Sequence[Sequence[float]], unknowns: Sequence[int]) -> int:
    """Which model to use, from the mean squares of each on the same folds, (models, folds), and their sizes.

    The simplest that is not worse than the best by more than one standard error of the difference between them. It is
    taken fold by fold: folds differ far more than models do. A gain too small to matter is none, however sure it is:
    no model is quite what a machine does.
    """
    squares = np.array(mean_squares)
    means = squares.mean(axis=1)
    best = int(np.argmin(means))
    matters = (LEAST_GAIN**2 + 2 * LEAST_GAIN) * float(means[best])

    def as_good(model: int) -> bool:
        excess = squares[model] - squares[best]
        return bool(np.mean(excess) <= max(_standard_error(excess), matters))

    return min(filter(as_good, range(len(squares))), key=lambda model: (unknowns[model], means[model]))


def _standard_error(values: FloatArray) -> float:
    """Of the mean of independent values."""
    return float(np.std(values, ddof=1) / np.sqrt(values.size))
