"""Normal equations over parts of the rows, compiled: they are summed for every shape that is tried."""

import numpy as np
from numba import njit

from norton_bench.arrays import FloatArray, IntArray


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _dot(a: FloatArray, b: FloatArray, first: int, end: int) -> float:
    total = 0.0
    for k in range(first, end):
        total += a[k] * b[k]
    return total


@njit(cache=True, nogil=True)
def part_sums(columns: FloatArray, target: FloatArray, part: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Over the rows of each part (numbered from 0, others left out): columns by columns, by target, target by target.

    ``columns`` (columns, n) and ``target`` (n,); shapes (parts, columns, columns), (parts, columns) and (parts,).
    """
    count = part.max() + 1
    size = columns.shape[0]
    gram = np.zeros((count, size, size))
    moment = np.zeros((count, size))
    power = np.zeros(count)
    first = 0
    while first < part.size:
        end = first + 1
        while end < part.size and part[end] == part[first]:
            end += 1
        which = part[first]
        if which >= 0:
            for i in range(size):
                for j in range(i + 1):
                    gram[which, i, j] += _dot(columns[i], columns[j], first, end)
                moment[which, i] += _dot(columns[i], target, first, end)
            power[which] += _dot(target, target, first, end)
        first = end
    for i in range(size):
        for j in range(i):
            gram[:, j, i] = gram[:, i, j]
    return gram, moment, power
