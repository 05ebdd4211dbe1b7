"""The torque sensor's zero: a broken line of time, held on beyond its ends."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SensorZero:
    """``value_nm`` (knots,) at ``time_s`` (knots,), in the time of :class:`~bench.identification.signals.Signals`."""

    time_s: FloatArray
    value_nm: FloatArray

    @classmethod
    def constant(cls, value_nm: float) -> "SensorZero":
        """The same throughout."""
        return cls(np.zeros(1), np.array([value_nm]))

    def at(self, time_s: FloatArray) -> FloatArray:
        """At instants (n,)."""
        return np.interp(time_s, self.time_s, self.value_nm)

    def moved(self, by_nm: float) -> "SensorZero":
        """The same line, higher by so much."""
        return replace(self, value_nm=self.value_nm + by_nm)
