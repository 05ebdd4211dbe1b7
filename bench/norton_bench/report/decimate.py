"""Fewer points, same picture."""

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray

POINTS = 2000


def envelope(time_s: FloatArray, values: FloatArray, points: int = POINTS) -> tuple[FloatArray, FloatArray]:
    """At most ``points`` of the given ones: least and greatest of each stretch, in order, so that no spike is lost.

    A stretch without a finite value becomes one NaN, so that gaps stay gaps.
    """
    stretches = points // 2
    if len(values) <= points:
        return time_s, values
    edges = np.linspace(0, len(values), stretches + 1).astype(int)
    chosen: list[int] = []
    for first, last in pairwise(edges):
        piece = values[first:last]
        if np.isnan(piece).all():
            chosen.append(int(first))
        else:
            chosen += sorted({int(first + np.nanargmin(piece)), int(first + np.nanargmax(piece))})
    return time_s[chosen], values[chosen]


def thinned(count: int, points: int = POINTS) -> npt.NDArray[np.intp]:
    """Indices of at most ``points`` of ``count`` things, evenly spread: for clouds, where order means nothing."""
    return np.unique(np.linspace(0, count - 1, min(points, count)).astype(np.intp)) if count else np.empty(0, np.intp)
