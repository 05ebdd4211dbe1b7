"""What the torque that was left at the port does to a free velocity: how much, and how well that is known.

A motion source is defined where the port's torque is zero. What torque there was is read by the sensor; its zero
drifts, and is taken from the fit of the whole recording. Near a level, torque falls with velocity by the slope that the
imposed grid has measured there, on the same side of rest; where there was no grid, by the fitted damping.
"""

from dataclasses import dataclass

import numpy as np

from norton_bench.identification.model_free.impedance_table import ImpedanceTable
from norton_bench.identification.results import FitResult
from norton_bench.identification.sensor_zero import SensorZero
from norton_bench.models.parameters import Status

# A slope is one to divide by where it is so many of its deviations above zero: the quotient's error is then a fifth of
# its size at most, and as good as linear.
KNOWN_DEVIATIONS = 5.0


@dataclass(frozen=True)
class PortTorque:
    """The sensor's zero and the slopes. ``origin_ns`` is where the zero's time begins."""

    origin_ns: int
    zero: SensorZero
    table: ImpedanceTable | None
    damping_nms_rad: float
    damping_std_nms_rad: float

    @classmethod
    def of(cls, fit: FitResult, table: ImpedanceTable | None, origin_ns: int) -> "PortTorque | None":
        """None where the fit tells nothing of the sensor's zero."""
        damping = fit.estimate("viscous_damping")
        if fit.torque_zero is None or not fit.converged or damping.status is not Status.VALID:
            return None
        return cls(origin_ns, fit.torque_zero, table, damping.value, damping.std)

    def slope(self, command: float, velocity_rad_s: float) -> tuple[float, float]:
        """Fall of torque with velocity near this level [N m s/rad] and its deviation; NaN where it cannot be told."""
        found = (self.damping_nms_rad, self.damping_std_nms_rad)
        if self.table is not None:
            measured = self.table.fall(command, velocity_rad_s)
            found = measured if np.isfinite(measured).all() else found
        value, deviation = found
        return found if value > KNOWN_DEVIATIONS * deviation else (float("nan"), float("nan"))
