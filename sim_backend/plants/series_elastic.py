"""A series-elastic actuator: a motor behind a damped spring, and a small body at the port (paper, section VI).

    Jm d²q/dt² = τ_drive − friction(q) − τ_spring,    τ_spring = k (q − θ) + d (dq/dt − ω),
    J dω/dt = τ_spring − friction(θ) − τ,

τ_drive = Km i, or that of the position loop, with which c is an angle.
"""

from typing import Literal

from pydantic import Field

from sim_backend.plants.assembled import Assembled, Motor, Servo, Spring, in_series_nm_rad, servo_columns
from sim_backend.plants.link import SERVO, TORQUE, Link, row_of


class SeriesElasticTruth(Assembled):
    """``motor`` as reflected to the spring's side, with ``servo`` where the command is an angle."""

    model: Literal["series_elastic"]
    motor: Motor
    spring: Spring
    servo: Servo | None = Field(default=None)

    @property
    def link(self) -> Link:
        row = row_of(
            drive=TORQUE if self.servo is None else SERVO,
            command_per_ampere=self.command_per_ampere,
            spring=self.spring.stiffness_nm_rad,
            damper=self.spring.damping_nm_s_rad,
            **servo_columns(self.servo),
        )
        return Link(row, self.motor, self.mounted * self.motor.torque_constant_nm_a)

    @property
    def torque_constant_nm_a(self) -> float:
        if self.servo is None:
            return self.motor.torque_constant_nm_a
        return self.stiffness_nm_rad / self.amplifier_gain

    @property
    def stiffness_nm_rad(self) -> float:
        """Of the port at rest: the spring's, with the position loop's behind it; friction at rest makes it stiffer."""
        spring_nm_rad = self.spring.stiffness_nm_rad
        return spring_nm_rad if self.servo is None else in_series_nm_rad(spring_nm_rad, self.servo.stiffness_nm_rad)

    def source_rad(self, command: float) -> float:
        """Where the free port rests under an angle commanded, but for friction: there."""
        return command

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts under an angle commanded, held at another, but for friction."""
        return self.stiffness_nm_rad * (self.source_rad(command) - angle_rad)
