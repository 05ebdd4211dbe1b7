"""Parameters that move while the record is taken: a Kalman filter over its blocks, about the fit of all of it.

A fit takes every parameter for constant. Where one of them goes with time by more than the scatter of the blocks
explains, it is given a random walk, at the rate with which the blocks are likeliest, and the filter follows it. All
others are estimated along with it, as constants.
"""

from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.regression import COULOMB, DAMPING, GAIN, VISCOUS
from norton_bench.identification.separable import Solution
from norton_bench.identification.soundness.blocks import Blocks

# Oil warms and wears, and magnets with it; a rotor does not grow heavier.
MAY_MOVE = (GAIN, VISCOUS, COULOMB, DAMPING)
# A trend of so many deviations is no accident: a chance of 1 in 15 000 for each that is looked at.
SIGNIFICANT = 4.0
# Random walks in question: a share of the value in the square root of a second.
RATES = (1e-3, 3e-3, 1e-2, 3e-2)
# What is known beforehand, in deviations of the fit: as good as nothing.
VAGUE = 1e3
# Directions of a block with less information than this, relative to the fit's, say nothing.
SAYS_NOTHING = 1e-6
# The scatter of the scores about constants holds the drift too: once that is followed, the noise is what is left.
ROUNDS = 2


@dataclass(frozen=True)
class Drift:
    """What became of the unknowns at the end of the record: ``change`` (p,) from the solution's own, linear ones first,
    with its ``covariance`` (p, p); ``moved`` are those that walked."""

    moved: tuple[int, ...]
    change: FloatArray
    covariance: FloatArray


def drift_of(solution: Solution) -> Drift | None:
    """None where nothing moves, or the record is too short to tell."""
    blocks = Blocks.of(solution)
    moved = tuple(column for column in MAY_MOVE if _trends(blocks, column)) if blocks.time_s.size else ()
    if not moved:
        return None
    record = _Record.of(blocks)
    for _ in range(ROUNDS):
        end = _followed(record, moved, solution.linear)
        record = record.with_noise(end.surprise)
    unit = record.unit
    return Drift(moved, np.asarray(end.values * unit), np.asarray(end.covariance * np.outer(unit, unit)))


def _followed(record: "_Record", moved: tuple[int, ...], linear: FloatArray) -> "_End":
    """With the likeliest rates, found for one after the other."""
    walks = np.zeros(len(record.unit))
    for column in moved:
        size = abs(float(linear[column])) / record.unit[column]
        rates = [_with(walks, column, rate * size) for rate in RATES]
        walks = max(rates, key=lambda each: record.filtered(each).likelihood)
    return record.filtered(walks)


def _with(walks: FloatArray, column: int, rate: float) -> FloatArray:
    other = walks.copy()
    other[column] = rate
    return other


def _trends(blocks: Blocks, column: int) -> bool:
    time_s = blocks.time_s - np.mean(blocks.time_s)
    trend, deviation = blocks.change(column, time_s / max(float(np.ptp(time_s)), 1e-300), time_s.size // 2)
    return abs(trend) > SIGNIFICANT * deviation


@dataclass(frozen=True)
class _End:
    """A filter after the last block, values in the record's unit. ``surprise`` is the median over the blocks of the
    innovations' mean square, in their own variances."""

    values: FloatArray
    covariance: FloatArray
    likelihood: float
    surprise: float


@dataclass(frozen=True)
class _Record:
    """Blocks as measurements ``root · p = z`` with unit noise, p in ``unit`` (p,): deviations of the fit of all."""

    roots: tuple[FloatArray, ...]
    z: tuple[FloatArray, ...]
    steps_s: FloatArray  # from each block to the next
    unit: FloatArray

    @classmethod
    def of(cls, blocks: Blocks) -> "_Record":
        inverse = np.linalg.pinv(blocks.gram.sum(axis=0), rcond=1e-12, hermitian=True)
        # The scores' own scatter is the noise: colour within a block is in it.
        variance = float(np.einsum("bi,ij,bj->", blocks.score, inverse, blocks.score)) / len(inverse)
        own = np.sqrt(np.maximum(np.diag(inverse) * variance, 1e-300))
        roots, z = [], []
        for gram, score in zip(blocks.gram, blocks.score, strict=True):
            value, vector = np.linalg.eigh(gram * np.outer(own, own) / variance)
            says = value > SAYS_NOTHING
            root = np.sqrt(value[says])[:, None] * vector[:, says].T
            roots.append(root)
            z.append((root / value[says, None]) @ (score * own / variance))
        return cls(tuple(roots), tuple(z), np.diff(blocks.time_s, prepend=blocks.time_s[0]), own / blocks.scale)

    def with_noise(self, factor: float) -> "_Record":
        """As if the noise's variance were greater by this factor; in a unit that is then the same share of it."""
        return replace(
            self,
            roots=tuple(root / np.sqrt(factor) for root in self.roots),
            z=tuple(z / np.sqrt(factor) for z in self.z),
        )

    def filtered(self, walks: FloatArray) -> "_End":
        """The filter after the last block; ``walks`` (p,) in units a root second."""
        from filterpy.kalman import KalmanFilter  # noqa: PLC0415  (half a second, and most sessions need none)

        size, likelihood, surprises = len(self.unit), 0.0, list[float]()
        follower = KalmanFilter(dim_x=size, dim_z=size)
        follower.x, follower.P, follower.F = np.zeros(size), VAGUE**2 * np.eye(size), np.eye(size)
        for root, z, step_s in zip(self.roots, self.z, self.steps_s, strict=True):
            follower.predict(Q=np.diag(walks**2 * step_s))
            if z.size:
                follower.update(z, R=np.eye(z.size), H=root)
                likelihood += float(follower.log_likelihood)
                surprises.append(float(follower.y @ np.linalg.solve(follower.S, follower.y)) / z.size)
        return _End(follower.x, follower.P, likelihood, float(np.median(surprises)))
