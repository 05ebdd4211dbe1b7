"""What actuators have in common whose motor drives the port through something that gives."""

import math
from abc import abstractmethod
from typing import Annotated, ClassVar, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field, model_validator

from norton_sim.integrator import ANGLE, mean_current
from norton_sim.plants.assembled import (
    HALF_GAP,
    HARDENING,
    MODULATOR_BANDWIDTH,
    MODULATOR_STOP,
    MODULATOR_TRAVEL,
    SERVO,
    SPRING,
    STIFFENING,
    TORQUE,
    Assembled,
    Backlash,
    GearedMotor,
    Link,
    Servo,
    Spring,
    row_of,
)
from norton_sim.tables import CubicStiffness, Number, Stiffening, Stiffness


class MotorBehind(Assembled):
    """``motor`` as reflected to the connection's side, with ``servo`` where the command is an angle."""

    motor: GearedMotor
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


LoadFriction = Annotated[Number, Field(ge=0, lt=1)]


# A motor behind gears with backlash and friction that grows with the load (paper, section VI).
#
# Jm d²q/dt² = τ_drive − B dq/dt − friction(q) − τ_mesh, J dω/dt = τ_mesh − friction(θ) − τ, τ_mesh = k (δ ∓ b/2) + d
# dδ/dt beyond half of the backlash b, else 0, δ = q − θ,
#
# and the motor's friction is bounded by τc + μ |k (δ ∓ b/2)|: it loses the share μ of what it transmits.
@njit(cache=True, nogil=True, inline="always")
def stretch(deviation: float, link: NDArray[np.float64]) -> float:
    """How far a connection is deflected beyond its backlash [rad], for a source ``deviation`` ahead of the port."""
    if deviation > link[HALF_GAP]:
        return float(deviation - link[HALF_GAP])
    if deviation < -link[HALF_GAP]:
        return float(deviation + link[HALF_GAP])
    return 0.0


class GearTrainTruth(MotorBehind):
    """``motor`` as reflected to the output; ``load_friction`` is μ. At rest its source is the backlash's middle."""

    model: Literal["gear_train"]
    backlash: Backlash
    load_friction: LoadFriction = 0.0

    @property
    def connection(self) -> Spring:
        return self.backlash

    @property
    def link(self) -> Link:
        return self._link(half_gap=self.backlash.width_rad / 2, load_friction=self.load_friction)

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts under an angle commanded, held at another, but for friction: nothing in the backlash."""
        deviation, half = command - angle_rad, self.backlash.width_rad / 2
        return self.stiffness_nm_rad * (deviation - min(max(deviation, -half), half))


class SeriesElasticTruth(MotorBehind):
    """A series-elastic actuator: a motor behind a damped spring, and a small body at the port (paper, section VI).

    Jm d²q/dt² = τ_drive − friction(q) − τ_spring, τ_spring = k (q − θ) + d (dq/dt − ω), J dω/dt = τ_spring −
    friction(θ) − τ,

    τ_drive = Km i, or that of the position loop, with which c is an angle.

    ``spring`` joins motor and port.
    """

    model: Literal["series_elastic"]
    spring: Spring

    @property
    def connection(self) -> Spring:
        return self.spring

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts under an angle commanded, held at another, but for friction."""
        return self.stiffness_nm_rad * (self.source_rad(command) - angle_rad)


# A variable-stiffness actuator: a motor behind a spring that a second drive makes stiffer (section VI).
#
# Jm d²q/dt² = τ_drive − friction(q) − τ_spring, J dω/dt = τ_spring − friction(θ) − τ, τ_spring = k (q − θ) + k3 (q −
# θ)³ + d (dq/dt − ω), k = k0 + k1 p,
#
# with p the angle of the stiffness motor. It goes where its drive's command says, dp/dt = b (p_wanted − p), between
# two stops: p = 0, where the spring is softest, and where it is stiffest. Without power it goes back to p = 0.
@njit(cache=True, nogil=True)
def modulate(state: NDArray[np.float64], link: NDArray[np.float64], h: float) -> float:
    """Let the stiffness motor, whose row ``state`` is, go on for ``h``; returns the mean stiffness meanwhile."""
    before = state[ANGLE]
    wanted = link[MODULATOR_TRAVEL] * mean_current(state, h)
    after = before - (wanted - before) * math.expm1(-link[MODULATOR_BANDWIDTH] * h)
    state[ANGLE] = min(max(after, 0.0), link[MODULATOR_STOP])
    return float(link[SPRING] + link[STIFFENING] * (before + state[ANGLE]) / 2)


@njit(cache=True, nogil=True, inline="always")
def pulled(stiffness: float, deflection: float, link: NDArray[np.float64]) -> float:
    """What a spring that hardens exerts [N m]."""
    return float((stiffness + link[HARDENING] * deflection * deflection) * deflection)


class VariableSpring(Spring):
    """``stiffness`` is k0, ``stiffening`` k1, ``hardening`` k3; ``stiffest`` is k at the upper stop."""

    stiffening_nm_rad2: Stiffening = Field(alias="stiffening", gt=0, examples=["4 N*m/rad^2"])
    stiffest_nm_rad: Stiffness = Field(alias="stiffest", gt=0, examples=["6 N*m/rad"])
    hardening_nm_rad3: CubicStiffness = Field(alias="hardening", default=0.0, ge=0)

    @model_validator(mode="after")
    def _stiffens(self) -> "VariableSpring":
        if self.stiffest_nm_rad <= self.stiffness_nm_rad:
            raise ValueError(f"stiffest must be above stiffness = {self.stiffness_nm_rad:g} N*m/rad; raise it")
        return self

    @property
    def stop_rad(self) -> float:
        """Where the stiffness motor meets its upper stop."""
        return (self.stiffest_nm_rad - self.stiffness_nm_rad) / self.stiffening_nm_rad2


class VariableStiffnessTruth(MotorBehind):
    """``spring`` joins motor and port. Angles of the stiffness motor are its encoder's [rad]."""

    model: Literal["variable_stiffness"]
    spring: VariableSpring
    modulated: ClassVar[bool] = True

    @property
    def connection(self) -> Spring:
        return self.spring

    @property
    def link(self) -> Link:
        spring = self.spring
        return self._link(
            stiffening=spring.stiffening_nm_rad2, modulator_stop=spring.stop_rad, hardening=spring.hardening_nm_rad3
        )

    def spring_nm_rad(self, modulator_rad: float) -> float:
        """k, with the stiffness motor there."""
        return self.spring.stiffness_nm_rad + self.spring.stiffening_nm_rad2 * min(
            max(modulator_rad, 0.0), self.spring.stop_rad
        )

    def port_stiffness_nm_rad(self, modulator_rad: float) -> float:
        """Of the port at its source, at rest: the spring's, with the position loop's behind it."""
        spring_nm_rad = self.spring_nm_rad(modulator_rad)
        return spring_nm_rad if self.servo is None else 1 / (1 / spring_nm_rad + 1 / self.servo.stiffness_nm_rad)

    def exertion_nm(self, command: float, angle_rad: float, modulator_rad: float = 0.0) -> float:
        """What the port exerts under an angle commanded, held at another, but for friction. There must be a servo."""
        assert self.servo is not None
        servo_nm_rad, away_rad = self.servo.stiffness_nm_rad, command - angle_rad
        spring_nm_rad, hardening = self.spring_nm_rad(modulator_rad), self.spring.hardening_nm_rad3
        roots = np.roots([hardening, 0.0, spring_nm_rad + servo_nm_rad, -servo_nm_rad * away_rad])
        deflection_rad = float(roots[np.argmin(np.abs(roots.imag))].real)
        return servo_nm_rad * (away_rad - deflection_rad)
