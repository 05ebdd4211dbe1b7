"""A solution's normal equations by block of rows: whether an unknown is the same throughout the record."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification.regression import INERTIA, LINEAR, VISCOUS
from norton_bench.identification.separable import Solution

BLOCK_ROWS = 500
# A change that fewer blocks tell has no deviation that their scatter could give.
TELLING_BLOCKS = 6.0


@dataclass(frozen=True)
class Blocks:
    """Normal equations of each block of rows about the fit: ``gram`` (blocks, p, p), ``score`` (blocks, p).

    Readings' errors in the columns are taken off, as the fit does it: a stretch in which the shaft hardly accelerates
    would else seem to have less inertia than one in which it does.
    """

    gram: FloatArray
    score: FloatArray
    scale: FloatArray  # of the columns, (p,)
    time_s: FloatArray  # at which each block begins, (blocks,)

    @classmethod
    def of(cls, solution: Solution) -> "Blocks":
        """Of whole blocks; what is left at the end is too little for one."""
        jacobian, residual = solution.jacobian, solution.innovation
        count = len(residual) // BLOCK_ROWS
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0.0] = 1.0  # a free shaft has no torque to go with the inertia
        rows = (jacobian[: count * BLOCK_ROWS] / scale).reshape(count, BLOCK_ROWS, -1)
        left = residual[: count * BLOCK_ROWS].reshape(count, BLOCK_ROWS, 1)
        across = rows.transpose(0, 2, 1)
        gram, score = np.matmul(across, rows), np.matmul(across, left)[:, :, 0]
        at = np.arange(len(solution.contamination))
        in_block = solution.contamination * BLOCK_ROWS / len(residual)
        gram[:, at, at] -= in_block / scale[at] ** 2
        linearly = slice(len(solution.linear))
        score[:, linearly] += in_block[linearly] * solution.linear / scale[linearly]
        return cls(gram, score, scale, solution.regression.time_s()[: count * BLOCK_ROWS : BLOCK_ROWS])

    def only(self, chosen: npt.NDArray[np.bool_]) -> "Blocks":
        """Some of them, (blocks,)."""
        return replace(self, gram=self.gram[chosen], score=self.score[chosen], time_s=self.time_s[chosen])

    def told(self, column: int) -> FloatArray:
        """The share of what is told of one unknown, the others being unknown too, before each block: (blocks,)."""
        gram = self.gram.sum(axis=0)
        others = np.delete(np.arange(len(gram)), column)
        alone = np.zeros(len(gram))
        alone[column] = 1.0
        alone[others] = (
            -np.linalg.pinv(gram[np.ix_(others, others)], rcond=1e-10, hermitian=True) @ gram[others, column]
        )
        sizes = np.maximum(np.einsum("i,bij,j->b", alone, self.gram, alone), 0.0)
        return np.asarray((np.cumsum(sizes) - sizes) / max(sizes.sum(), 1e-300))

    def change(self, column: int, course: FloatArray, split: int) -> tuple[float, float]:
        """How far one unknown goes along ``course`` (blocks,), the others being the same throughout; its deviation.

        That is one more column: the unknown's own, times its course, less what all the columns explain of it. Where few
        blocks tell it, before ``split`` or after, their scatter is no deviation, and nothing is said.
        """
        gram = self.gram.sum(axis=0)
        moved = np.einsum("b,bi->i", course, self.gram[:, :, column])
        explained = np.linalg.pinv(gram, rcond=1e-10, hermitian=True) @ moved
        weights = np.zeros((len(self.gram), len(gram))) - explained
        weights[:, column] += course
        size = np.einsum("bi,bij,bj->b", weights, self.gram, weights)
        score = np.sum(weights * self.score, axis=1)
        if min(_as_many(size[:split]), _as_many(size[split:])) < TELLING_BLOCKS:
            return 0.0, float("inf")
        step = float(score.sum() / max(size.sum(), 1e-300))
        deviation = float(np.sqrt(np.sum((score - step * size) ** 2)) / max(size.sum(), 1e-300))
        return step / self.scale[column], deviation / self.scale[column]


def loud(solution: Solution) -> npt.NDArray[np.bool_]:
    """In which blocks the machine's torque is more than the noise of the readings; in all where none was measured.

    Where feedback holds the torque at zero, what is left of it is mostly the sensor's noise, which moves the shaft a
    little later: a delay between motion and torque that no clock has.
    """
    count = len(solution.innovation) // BLOCK_ROWS
    if solution.free_motion:
        return np.ones(count, dtype=bool)
    own = slice(len(LINEAR))
    carried = np.array([1.0, solution.linear[INERTIA] ** 2, solution.linear[VISCOUS] ** 2])
    noise = np.concatenate([np.full(rows.usable.size, rows.noise() @ carried) for rows in solution.regression.rows])
    beyond = (solution.linear[own] @ solution.regression.columns(solution.shape)[0][own]) ** 2 - noise
    return np.asarray(beyond[: count * BLOCK_ROWS].reshape(count, BLOCK_ROWS).mean(axis=1) > 0.0)


def _as_many(weights: FloatArray) -> float:
    """How many equal weights would tell as much as these."""
    return float(weights.sum() ** 2 / max(np.sum(weights**2), 1e-300))
