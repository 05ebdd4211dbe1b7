"""Everything between the two ends of the law: a virtual body pulled by the port torque, for the load to follow.

M dv/dt + B (v − v_ref) + K (x − x_ref) = τ_port
"""

from dataclasses import dataclass, field

from norton_bench.sample import Target
from norton_bench.segments import Admittance


@dataclass
class VirtualBody:
    """Integrates the law (implicit in damping and stiffness: stable for any of them)."""

    admittance: Admittance
    tick_s: float
    position_rad: float = field(default=0.0, init=False)
    velocity_rad_s: float = field(default=0.0, init=False)

    def begin(self, position_rad: float, velocity_rad_s: float) -> None:
        self.position_rad, self.velocity_rad_s = position_rad, velocity_rad_s

    def step(self, torque_nm: float, reference: Target) -> Target:
        """Where the body is one tick on, under ``torque_nm``."""
        a, h = self.admittance, self.tick_s
        pull = (
            torque_nm
            - a.damping_nms_rad * (self.velocity_rad_s - reference.velocity_rad_s)
            - a.stiffness_nm_rad * (self.position_rad + h * self.velocity_rad_s - reference.position_rad)
        )
        acceleration = pull / (a.mass_kgm2 + h * a.damping_nms_rad + h * h * a.stiffness_nm_rad)
        self.velocity_rad_s += h * acceleration
        self.position_rad += h * self.velocity_rad_s
        return Target(self.position_rad, self.velocity_rad_s, acceleration)
