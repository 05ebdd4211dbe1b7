"""Following parameters as they drift: a Kalman filter fed with square roots of information.

A block of data says ``H p = z`` with unit noise, H being a square root of its information. Directions that it does not
excite are left out, and so is drift along them: a parameter is neither moved, nor thought better or worse known, by
data that say nothing of it. What the noise was thought to be is checked against the innovations: where they are
greater, all that follows counts for less.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from filterpy.kalman import KalmanFilter

FloatArray = npt.NDArray[np.float64]

# A direction counts as excited when a block alone tells it within this share of the parameters' scales ...
EXCITED_WITHIN = 0.3
# ... and carries at least so many times the information that noise alone would feign.
OVER_NOISE = 4.0
# Innovations so many times as great as they should be are no drift: the block is garbage, or the machine another one.
BEYOND_DRIFT = 30.0
MEMORY_BLOCKS = 20.0


@dataclass
class Tracker:
    """Tracks p, in units of its own that make all of it about one; ``drift_per_s`` in the same, a random walk's."""

    values: FloatArray
    covariance: FloatArray
    drift_per_s: FloatArray
    inflation: float = 1.0  # of the noise's variance, from the innovations so far
    _filter: KalmanFilter = field(init=False)

    def __post_init__(self) -> None:
        size = self.values.size
        self._filter = KalmanFilter(dim_x=size, dim_z=size)
        self._filter.F = np.eye(size)
        self._filter.x, self._filter.P = self.values.copy(), self.covariance.copy()

    def update(
        self, information: FloatArray, score: FloatArray, duration_s: float, feigned: FloatArray | None = None
    ) -> bool:
        """One block: normal equations ``information · (p - values) = score``, divided by the noise's variance.

        ``feigned`` is what of the information comes from noise in the regressors. Returns whether the block was
        believed; False leaves everything as it was.
        """
        said = _excited(information, score, feigned)
        if not said.z.size:
            return True
        # Drift is let in only along what this block can correct.
        unit = said.root / np.linalg.norm(said.root, axis=1, keepdims=True)
        along = unit.T @ unit
        drift = along @ np.diag(self.drift_per_s**2 * duration_s) @ along
        noise = self.inflation * np.eye(said.z.size)
        expected = said.root @ (self.covariance + drift) @ said.root.T + noise
        surprise = float(said.z @ np.linalg.solve(expected, said.z)) / said.z.size
        if not surprise < BEYOND_DRIFT**2:
            return False
        self._filter.predict(Q=drift)
        before = self._filter.P.copy()
        self._filter.update(said.z + said.root @ self.values, R=noise, H=said.root)
        # What noise feigns is not touched by way of its correlations either (Schmidt's "considered" parameters). With
        # a gain that is not the optimal one the covariance is Joseph's.
        gain = self._filter.K - said.feigned @ (said.feigned.T @ self._filter.K)
        left = np.eye(self.values.size) - gain @ said.root
        covariance = left @ before @ left.T + gain @ noise @ gain.T
        self.values, self.covariance = self.values + gain @ said.z, 0.5 * (covariance + covariance.T)
        self._filter.x, self._filter.P = self.values.copy(), self.covariance.copy()
        self.inflation = max(1.0, self.inflation * (1.0 + (surprise - 1.0) / MEMORY_BLOCKS))
        return True

    def hold(self, low: FloatArray, high: FloatArray) -> None:
        """Keep the values within limits, shapes (n,)."""
        self.values = np.clip(self.values, low, high)
        self._filter.x = self.values.copy()


@dataclass(frozen=True)
class _Said:
    """``root · p = z`` with unit noise, shapes (k, n) and (k,), of what is excited; directions only feigned, (n, m)."""

    root: FloatArray
    z: FloatArray
    feigned: FloatArray


def _excited(information: FloatArray, score: FloatArray, feigned: FloatArray | None) -> _Said:
    """The square root of what is excited; nothing of what is not finite."""
    size = score.size
    if not (np.all(np.isfinite(information)) and np.all(np.isfinite(score))):
        return _Said(np.empty((0, size)), np.empty(0), np.empty((size, 0)))
    value, vector = np.linalg.eigh(0.5 * (information + information.T))
    noise = np.zeros(size) if feigned is None else np.einsum("ik,ij,jk->k", vector, feigned, vector)
    real = value > OVER_NOISE * noise
    excited = real & (value > 1.0 / EXCITED_WITHIN**2)
    chosen = vector[:, excited].T
    scale = np.sqrt(value[excited])
    return _Said(scale[:, None] * chosen, chosen @ score / scale, vector[:, ~real])
