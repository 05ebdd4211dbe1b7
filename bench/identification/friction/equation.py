"""One equation of motion in which friction is the unknown: a target, further linear columns, and friction's path."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bench.errors import ExperimentError
from bench.identification.friction.path import Path

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Of the record, for each held-out fold: short enough that every fold meets every slow condition.
BLOCKS_PER_FOLD = 4


@dataclass(frozen=True)
class Equation:
    """``target = coefficients @ others − friction``, in rows that may be coarser than the path.

    ``target`` and ``time_s`` (n,), ``others`` (k, n) named ``names``. ``process`` takes rows of the path's rate,
    shape (columns, path), through the filter and decimation that the target has passed: (columns, n). ``fold``
    (n,) says which held-out fold each row belongs to; the rows of −1 are never held out and always trained on.
    Raises ExperimentError where a number is missing or infinite.
    """

    target: FloatArray
    others: FloatArray
    names: tuple[str, ...]
    path: Path
    fold: IntArray
    time_s: FloatArray
    process: Callable[[FloatArray], FloatArray]

    def __post_init__(self) -> None:
        parts = {"target": self.target, "motion": self.path.position, "velocity": self.path.velocity}
        parts |= dict(zip(self.names, self.others, strict=True))
        for name, values in parts.items():
            if not np.isfinite(values).all():
                raise ExperimentError(f"the {name} holds missing or infinite values: cut them out of the record first")


def blocked_folds(count: int, folds: int = 5) -> IntArray:
    """Folds of contiguous blocks that take turns along a record of ``count`` rows, shape (count,)."""
    blocks = folds * BLOCKS_PER_FOLD
    return np.asarray(np.arange(count) * blocks // max(count, 1) % folds, dtype=np.int64)
