"""The unknowns of the regression: the linear ones by their places, and those in which it is not linear."""

from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.models import network_steps
from norton_bench.models.terms import DAMPING_DRIFT, DRAG, FRICTION_DRIFT, GAIN_DRIFT, Factor, NetworkTerm, row_of

LINEAR = ("torque_gain", "inertia", "viscous_damping", "coulomb_torque", "presliding_damping")
GAIN, INERTIA, VISCOUS, COULOMB, DAMPING = range(5)
BANDWIDTH, COMMAND_DELAY, MOTION_DELAY = 0, 2, 3  # of (log β, log s, d_c, d_m)
MOTOR_VALUES = 9  # of a solution: the motor's seven parameters and two delays; those of terms follow
# Steps of the differences that stand for derivatives: relative, and of delays.
SMALL = 0.01
SMALL_S = 2e-5


@dataclass(frozen=True)
class Shape:
    """The unknowns in which the regression is not linear. ``s`` is σ0/τc [1/rad]; positive delays mean later."""

    bandwidth_rad_s: float
    s_per_rad: float
    command_delay_s: float
    motion_delay_s: float
    terms: tuple[NetworkTerm, ...] = ()  # their values are relative: over those of the table's ``over``

    def as_array(self) -> FloatArray:
        """(log β, log s, d_c, d_m), then the parameters of the terms."""
        terms = [
            np.log(value) if parameter.logarithmic else value
            for each in self.terms
            for parameter, value in zip(each.term.parameters, each.values, strict=True)
        ]
        return np.array(
            [np.log(self.bandwidth_rad_s), np.log(self.s_per_rad), self.command_delay_s, self.motion_delay_s, *terms]
        )

    @classmethod
    def of(cls, array: FloatArray) -> "Shape":
        """Without terms, from the first four of them."""
        return cls(1.0, 1.0, 0.0, 0.0).at(array)

    def at(self, array: FloatArray) -> "Shape":
        """The same terms with other values, in the order of :meth:`as_array`."""
        rest, terms = iter(array[4:].tolist()), list[NetworkTerm]()
        for each in self.terms:
            values = (float(np.exp(next(rest))) if one.logarithmic else next(rest) for one in each.term.parameters)
            terms.append(replace(each, values=tuple(values)))
        bandwidth, s = np.exp(array[:2]).tolist()
        return Shape(bandwidth, s, float(array[2]), float(array[3]), tuple(terms))

    @property
    def row(self) -> FloatArray:
        """What the terms' factors are computed from."""
        return row_of(self.terms)

    def changes(self, factor: Factor) -> bool:
        """Whether one of the terms does."""
        return any(each.term.factor is factor for each in self.terms)

    # The factors of the terms at instants (n,), with what changes in time from the middle of the session on.

    def gain(self, lag: FloatArray, angle_rad: FloatArray, time_s: FloatArray) -> FloatArray:
        """g, where the command behind its ``lag`` acts."""
        return np.asarray(network_steps.gains(self.row, lag, angle_rad) * self.drifted(GAIN_DRIFT, time_s))

    def damping(self, velocity_rad_s: FloatArray, time_s: FloatArray) -> FloatArray:
        """b."""
        return np.asarray(self.drifted(DAMPING_DRIFT, time_s) + self.row[DRAG] * np.abs(velocity_rad_s))

    def strength(
        self, velocity_rad_s: FloatArray, angle_rad: FloatArray, port_nm: FloatArray, time_s: FloatArray
    ) -> FloatArray:
        """γ, while ``port_nm`` acts at the port."""
        strengths = network_steps.strengths(self.row, velocity_rad_s, angle_rad, port_nm)
        return np.asarray(strengths * self.drifted(FRICTION_DRIFT, time_s))

    def drifted(self, column: int, time_s: FloatArray) -> FloatArray:
        """What changes with time; ``column`` is that of its first parameter."""
        return np.asarray(1.0 + self.row[column] * time_s + self.row[column + 1] * time_s**2)


# Only its delays matter, and they are nil.
STILL = Shape(1.0, 1.0, 0.0, 0.0)
