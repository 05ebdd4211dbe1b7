"""One equation of motion in which friction is the unknown: a target, further linear columns, and friction's path."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.friction.path import Path

# Of blocks: enough that every fold meets every slow condition.
ROUNDS = 6


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
    """Folds of contiguous blocks along a record of ``count`` rows, shape (count,).

    Every fold has one block in each round, in an order that changes from round to round: blocks in a fixed order would
    fall in step with an experiment that repeats itself.
    """
    random = np.random.default_rng(0)
    order = np.concatenate([random.permutation(folds) for _ in range(ROUNDS)])
    return np.asarray(order[np.arange(count) * order.size // max(count, 1)], dtype=np.int64)
