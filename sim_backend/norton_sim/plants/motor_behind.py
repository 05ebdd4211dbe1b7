"""What actuators have in common whose motor drives the port through something that gives."""

from abc import abstractmethod

from pydantic import Field

from norton_sim.plants.assembled import Assembled, Motor, Servo, Spring
from norton_sim.plants.link import SERVO, TORQUE, Link, row_of


class MotorBehind(Assembled):
    """``motor`` as reflected to the connection's side, with ``servo`` where the command is an angle."""

    motor: Motor
    servo: Servo | None = Field(default=None)

    @property
    @abstractmethod
    def connection(self) -> Spring:
        """What joins motor and port."""

    @property
    def link(self) -> Link:
        return self._link()

    @property
    def torque_constant_nm_a(self) -> float:
        if self.servo is None:
            return self.motor.torque_constant_nm_a
        return self.stiffness_nm_rad / self.amplifier_gain

    @property
    def stiffness_nm_rad(self) -> float:
        """Of the port at rest: the connection's, with the position loop's behind it; friction makes it stiffer."""
        joined_nm_rad = self.connection.stiffness_nm_rad
        if self.servo is None:
            return joined_nm_rad
        return joined_nm_rad * self.servo.stiffness_nm_rad / (joined_nm_rad + self.servo.stiffness_nm_rad)

    def source_rad(self, command: float) -> float:
        """Where the free port rests under an angle commanded, but for friction: there."""
        return command

    def _link(self, **more: float) -> Link:
        """With columns that only some have."""
        servo = self.servo
        row = row_of(
            drive=TORQUE if servo is None else SERVO,
            command_per_ampere=self.command_per_ampere,
            spring=self.connection.stiffness_nm_rad,
            damper=self.connection.damping_nm_s_rad,
            servo_stiffness=0.0 if servo is None else servo.stiffness_nm_rad,
            servo_damping=0.0 if servo is None else servo.damping_nm_s_rad,
            **more,
        )
        return Link(row, self.motor, self.mounted * self.motor.torque_constant_nm_a)
