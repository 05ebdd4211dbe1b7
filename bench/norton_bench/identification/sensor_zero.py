"""The torque sensor's zero: what it reads with nothing at the port, a broken line of time, held on beyond its ends."""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray


@dataclass(frozen=True)
class SensorZero:
    """``value_nm`` (knots,) at ``time_s`` (knots,), in time of :class:`~norton_bench.identification.signals.Signals`.

    In the sign of the port. ``covariance_nm2`` (knots, knots) is that of the values, empty where it is not known.
    """

    time_s: FloatArray
    value_nm: FloatArray
    covariance_nm2: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    @classmethod
    def constant(cls, value_nm: float) -> "SensorZero":
        """The same throughout."""
        return cls(np.zeros(1), np.array([value_nm]))

    def weights(self, time_s: npt.ArrayLike) -> FloatArray:
        """How much each knot counts at these instants, shape (n, knots)."""
        at_s = np.asarray(time_s, dtype=float)
        return np.stack([np.interp(at_s, self.time_s, one) for one in np.eye(self.time_s.size)], axis=-1)

    def at(self, time_s: npt.ArrayLike) -> FloatArray:
        """At instants (n,) [N m]."""
        return np.asarray(np.interp(np.asarray(time_s, dtype=float), self.time_s, self.value_nm))

    def moved(self, by_nm: float) -> "SensorZero":
        """The same line, higher by so much."""
        return replace(self, value_nm=self.value_nm + by_nm)
