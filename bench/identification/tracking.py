"""Following the linear parameters as they drift: a Kalman filter fed with square roots of information.

A block of data says ``R p = z`` with unit noise, R being a square root of its information. Directions that it does not
excite are left out, so that a parameter is neither moved nor thought better known by data that say nothing of it.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from filterpy.kalman import KalmanFilter

FloatArray = npt.NDArray[np.float64]

# A direction counts as excited when a block alone would tell it this well, relative to the present values.
EXCITED_WITHIN = 1.0
# What parameters may drift in a second, relative to themselves.
DRIFT_PER_S = 1e-4
UNKNOWN = 1e3


@dataclass
class Tracker:
    """Tracks p in scaled units: each parameter over ``scale``, its value when tracking began."""

    scale: FloatArray
    _filter: KalmanFilter = field(init=False)

    def __post_init__(self) -> None:
        size = self.scale.size
        self._filter = KalmanFilter(dim_x=size, dim_z=size)
        self._filter.x = np.ones(size)
        self._filter.P = np.eye(size) * UNKNOWN**2
        self._filter.F = np.eye(size)
        self._filter.R = np.eye(size)

    @property
    def values(self) -> FloatArray:
        return np.asarray(self._filter.x * self.scale)

    @property
    def covariance(self) -> FloatArray:
        return np.asarray(self._filter.P * np.outer(self.scale, self.scale))

    def update(self, information: FloatArray, score: FloatArray, duration_s: float) -> None:
        """One block: normal equations ``information · p = score`` already divided by the noise's variance."""
        scaled = information * np.outer(self.scale, self.scale)
        value, vector = np.linalg.eigh(0.5 * (scaled + scaled.T))
        excited = value > 1.0 / EXCITED_WITHIN**2
        if not excited.any():
            return
        root = np.sqrt(value[excited])[:, None] * vector[:, excited].T
        z = (vector[:, excited].T @ (score * self.scale)) / np.sqrt(value[excited])
        # Drift is let in only along what this block can correct.
        along = vector[:, excited] @ vector[:, excited].T
        self._filter.predict(Q=DRIFT_PER_S**2 * duration_s * along)
        self._filter.update(z, R=np.eye(z.size), H=root)
        self._filter.P = 0.5 * (self._filter.P + self._filter.P.T)
