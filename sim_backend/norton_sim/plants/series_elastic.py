"""A series-elastic actuator: a motor behind a damped spring, and a small body at the port (paper, section VI).

    Jm d²q/dt² = τ_drive − friction(q) − τ_spring,    τ_spring = k (q − θ) + d (dq/dt − ω),
    J dω/dt = τ_spring − friction(θ) − τ,

τ_drive = Km i, or that of the position loop, with which c is an angle.
"""

from typing import Literal

from norton_sim.plants.assembled import Spring
from norton_sim.plants.motor_behind import MotorBehind


class SeriesElasticTruth(MotorBehind):
    """``spring`` joins motor and port."""

    model: Literal["series_elastic"]
    spring: Spring

    @property
    def connection(self) -> Spring:
        return self.spring

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts under an angle commanded, held at another, but for friction."""
        return self.stiffness_nm_rad * (self.source_rad(command) - angle_rad)
