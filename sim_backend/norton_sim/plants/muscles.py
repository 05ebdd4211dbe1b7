"""Muscles: a pneumatic one against a spring (paper, section IV.C.2), and the neuromuscular arm of section V."""

import math
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field

from norton_sim.integrator import CURRENT_TARGET, POWERED
from norton_sim.plants.assembled import (
    COMMAND_PER_AMPERE,
    MOVEMENT,
    MOVING_SPRING,
    MUSCLE,
    REACH,
    SPRING,
    Assembled,
    Link,
    row_of,
)
from norton_sim.tables import Damping, Seconds, Stiffness


# A pneumatic muscle against a spring (paper, section IV.C.2): I dω/dt = (π − θ)² c − K θ − B ω − friction − τ.
#
# The command c [N m/rad] is the muscle's pressure; it cannot push (c ≥ 0), and is slack beyond θ = π.
@njit(cache=True, nogil=True, inline="always")
def pull(angle: float, command: float, link: NDArray[np.float64]) -> float:
    """What muscle and spring turn the port's body with [N m]."""
    length = max(math.pi - angle, 0.0)
    return float(length * length * max(command, 0.0) - link[SPRING] * angle)


class PneumaticMuscleTruth(Assembled):
    """``spring`` is K, ``output`` the inertia I with its friction."""

    model: Literal["pneumatic_muscle"]
    spring_nm_rad: Stiffness = Field(alias="spring", gt=0, examples=["0.2 N*m/rad"])

    @property
    def link(self) -> Link:
        return Link(row_of(drive=MUSCLE, command_per_ampere=self.command_per_ampere, spring=self.spring_nm_rad))

    @property
    def torque_constant_nm_a(self) -> float:
        return math.pi**2 / self.amplifier_gain

    def source_rad(self, command: float) -> float:
        """Where the free port rests: 0 = (π − θ_N)² c − K θ_N, the root between 0 and π."""
        if command <= 0.0:
            return 0.0
        half = math.pi + self.spring_nm_rad / (2 * command)
        return half - math.sqrt(half * half - math.pi**2)

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts, held at an angle: K (θ_N (π − θ)² / (π − θ_N)² − θ), less friction."""
        return (math.pi - angle_rad) ** 2 * command - self.spring_nm_rad * angle_rad


# What an arm remembers of its reach: the six coefficients of its path over the time since it began, then these.
BEGAN, TARGET = 6, 7  # s; rad
REACH_COLUMNS = 8


# A neuromuscular arm (paper, section V): a motion source that reaches with least jerk, and a spring-damper around it.
#
# J dω/dt = k(t) (x_N − θ) + d (v_N − ω) − friction(θ) − τ.
#
# The command is where the hand is to be [rad]. Each time it changes, a reach begins from where the source is and how
# it moves: the path of least jerk that is there, at rest, after ``movement`` (Flash and Hogan, J. Neurosci. 5(7),
# 1985). While it is on its way the arm is stiffer: k(t) = stiffness + moving_stiffness · 16 p² (1 − p)², p from 0 to
# 1 over the reach. Where nothing has power any more the arm stays where it was going.
@njit(cache=True, nogil=True)
def place(reach: NDArray[np.float64], now_s: float, movement_s: float) -> tuple[float, float, float]:
    """Position [rad], velocity [rad/s] and acceleration [rad/s²] of the source."""
    t = now_s - reach[BEGAN]
    if t >= movement_s:
        return float(reach[TARGET]), 0.0, 0.0
    position, velocity, acceleration = 0.0, 0.0, 0.0
    for power in range(5, -1, -1):
        acceleration = acceleration * t + 2.0 * velocity
        velocity = velocity * t + position
        position = position * t + reach[power]
    return position, velocity, acceleration


@njit(cache=True, nogil=True)
def begin_reach(reach: NDArray[np.float64], target: float, now_s: float, movement_s: float) -> None:
    """From now on head for ``target``: the polynomial of least jerk from the present motion to rest there."""
    x, v, a = place(reach, now_s, movement_s)
    duration = movement_s
    away = target - x
    reach[0], reach[1], reach[2] = x, v, a / 2
    reach[3] = (20 * away - 12 * v * duration - 3 * a * duration**2) / (2 * duration**3)
    reach[4] = (-30 * away + 16 * v * duration + 3 * a * duration**2) / (2 * duration**4)
    reach[5] = (12 * away - 6 * v * duration - a * duration**2) / (2 * duration**5)
    reach[BEGAN], reach[TARGET] = now_s, target


@njit(cache=True, nogil=True, inline="always")
def follow_command(
    reach: NDArray[np.float64], actuator: NDArray[np.float64], link: NDArray[np.float64], now_s: float
) -> None:
    """Begin a reach where the command, as the ``actuator``'s row of the state has it, is another than before."""
    if actuator[POWERED] != 0.0:
        target = link[COMMAND_PER_AMPERE] * actuator[CURRENT_TARGET]
        if target != reach[TARGET]:
            begin_reach(reach, target, now_s, link[MOVEMENT])


@njit(cache=True, nogil=True, inline="always")
def stiffness(reach: NDArray[np.float64], now_s: float, link: NDArray[np.float64]) -> float:
    """The connection's stiffness now [N m/rad]."""
    p = (now_s - reach[BEGAN]) / link[MOVEMENT] if link[MOVEMENT] > 0.0 else 1.0
    if p >= 1.0:
        return float(link[SPRING])
    return float(link[SPRING] + link[MOVING_SPRING] * 16.0 * p * p * (1.0 - p) * (1.0 - p))


class ArmTruth(Assembled):
    """``output`` is the skeleton."""

    model: Literal["arm"]
    stiffness_nm_rad: Stiffness = Field(alias="stiffness", gt=0, examples=["2 N*m/rad"])
    moving_stiffness_nm_rad: Stiffness = Field(alias="moving_stiffness", default=0.0, ge=0)
    damping_nm_s_rad: Damping = Field(alias="damping", ge=0, examples=["0.05 N*m*s/rad"])
    movement_s: Seconds = Field(alias="movement", gt=0, examples=["500 ms"])

    @property
    def link(self) -> Link:
        row = row_of(
            drive=REACH,
            command_per_ampere=self.command_per_ampere,
            spring=self.stiffness_nm_rad,
            damper=self.damping_nm_s_rad,
            movement=self.movement_s,
            moving_spring=self.moving_stiffness_nm_rad,
        )
        return Link(row)

    @property
    def torque_constant_nm_a(self) -> float:
        return self.stiffness_nm_rad / self.amplifier_gain

    def source_rad(self, command: float) -> float:
        """Where the free port comes to rest."""
        return command

    def exertion_nm(self, command: float, angle_rad: float) -> float:
        """What the port exerts once the arm is there, held at another angle."""
        return self.stiffness_nm_rad * (command - angle_rad)
