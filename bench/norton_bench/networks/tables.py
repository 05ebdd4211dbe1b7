"""Measured maps as functions of one or two arguments: linear between the nodes, constant beyond them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """``nodes``: one or two rising grids; ``values``: as many, or a row for each node of the first grid.

    Raises ValueError, in a sentence, for grids that do not rise or values that do not fit them.
    """

    nodes: tuple[tuple[float, ...], ...]
    values: tuple[float, ...] | tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        shape = tuple(len(grid) for grid in self.nodes)
        if len(shape) not in {1, 2} or min(shape, default=0) < 2:
            raise ValueError("a table needs one or two grids of at least two nodes each")
        if not all(np.all(np.diff(grid) > 0.0) for grid in self.nodes):
            raise ValueError("the nodes of a table must rise; sort them and leave out what is there twice")
        try:
            fits = np.shape(np.asarray(self.values, dtype=float)) == shape
        except ValueError:
            fits = False
        if not fits or not np.isfinite(np.asarray(self.values, dtype=float)).all():
            raise ValueError(f"the values of a table must be finite numbers, {' by '.join(map(str, shape))} of them")

    def __call__(self, *arguments: npt.ArrayLike) -> FloatArray:
        """The value at one or two arguments, numbers or arrays of one shape."""
        if len(self.nodes) == 1:
            return np.asarray(np.interp(np.asarray(arguments[0], dtype=float), self.nodes[0], np.asarray(self.values)))
        values = np.asarray(self.values)
        (i, p), (j, q) = (_place(np.asarray(grid), each) for grid, each in zip(self.nodes, arguments, strict=True))
        low = (1 - q) * values[i, j] + q * values[i, j + 1]
        high = (1 - q) * values[i + 1, j] + q * values[i + 1, j + 1]
        return np.asarray((1 - p) * low + p * high)


def _place(grid: FloatArray, argument: npt.ArrayLike) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """The node below, and the part of the way to the next."""
    held = np.clip(np.asarray(argument, dtype=float), grid[0], grid[-1])
    below = np.clip(np.searchsorted(grid, held, side="right") - 1, 0, grid.size - 2)
    return below, (held - grid[below]) / (grid[below + 1] - grid[below])
