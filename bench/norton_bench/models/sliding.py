"""A motor in steady sliding: what drives it, what resists, where it begins to slide, and how fast it ends.

What changes with the position is taken at its mean. All functions take a network, with its signs and directions.
"""

from collections.abc import Sequence
from math import hypot, inf
from typing import Protocol

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.models.terms import (
    ASYMMETRY,
    DRAG,
    LOAD,
    SATURATION,
    STRIBECK,
    STRIBECK_VELOCITY,
    NetworkTerm,
    waves_of,
)
from norton_drivers.servo import Servo


class SteadyMotor(Protocol):
    """What of a network steady sliding depends on (:class:`norton_bench.models.network.NortonNetwork`)."""

    @property
    def torque_gain(self) -> float: ...
    @property
    def viscous_damping_nms_rad(self) -> float: ...
    @property
    def coulomb_torque_nm(self) -> float: ...
    @property
    def terms(self) -> Sequence[NetworkTerm]: ...
    @property
    def row(self) -> FloatArray: ...
    @property
    def servo(self) -> Servo | None: ...


SPEEDS = 1001
BISECTIONS = 60  # halve an interval to the last digit of a number
SHOWN = 3.0


def drive_nm(network: SteadyMotor, command: npt.ArrayLike) -> FloatArray:
    """Torque of the motor itself [N m] under steady commands, of their shape: Km·Ka·c/(1 + κ·c²)."""
    asked = np.asarray(command, dtype=float)
    return np.asarray(network.torque_gain * asked / (1.0 + network.row[SATURATION] * asked**2))


def friction_nm(network: SteadyMotor, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Friction [N m] in steady sliding at velocities, of their shape; 0 at 0, where friction is any."""
    velocity, row = np.asarray(velocity_rad_s, dtype=float), network.row
    side = np.sign(velocity)
    strength = 1.0 + side * row[ASYMMETRY] + row[STRIBECK] * np.exp(-((velocity / row[STRIBECK_VELOCITY]) ** 2))
    return np.asarray(network.coulomb_torque_nm * strength * side)


def damping_nm(network: SteadyMotor, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Damping [N m] at velocities, of their shape."""
    velocity = np.asarray(velocity_rad_s, dtype=float)
    return np.asarray(network.viscous_damping_nms_rad * (1.0 + network.row[DRAG] * np.abs(velocity)) * velocity)


def resistance_nm(network: SteadyMotor, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Friction and damping [N m] in steady sliding at velocities, of their shape."""
    return friction_nm(network, velocity_rad_s) + damping_nm(network, velocity_rad_s)


def steepness_nms_rad(network: SteadyMotor) -> float:
    """How steeply torque falls with velocity [N m s/rad] near rest under a steady command, but for friction: by
    damping, and by what the loop of a servo takes off a velocity commanded."""
    takes_off = network.torque_gain if network.servo is not None and not network.servo.holds_position else 0.0
    return network.viscous_damping_nms_rad + takes_off


def left_of(network: SteadyMotor, command: npt.ArrayLike, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """What acts of steady commands, of their shape: all, or what the loop of a servo leaves at a velocity."""
    asked = np.asarray(command, dtype=float)
    return asked if network.servo is None else asked - network.servo.of_velocity * np.asarray(velocity_rad_s)


def port_torque_nm(network: SteadyMotor, command: npt.ArrayLike, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Torque at the port [N m] in steady sliding: τ = drive − resistance − μ·|τ|·sgn ω."""
    free = drive_nm(network, left_of(network, command, velocity_rad_s)) - resistance_nm(network, velocity_rad_s)
    load = network.coulomb_torque_nm * network.row[LOAD]
    # Solved for τ, which has the sign of ``free`` as long as μ is below 1.
    return np.asarray(free / (1.0 + load * np.sign(velocity_rad_s) * np.sign(free)))


def held_nm(network: SteadyMotor, side: float) -> float:
    """The friction [N m] that sliding towards ``side`` (±1) begins at, with no torque at the port."""
    row = network.row
    return float(network.coulomb_torque_nm * (1.0 + row[STRIBECK] + side * row[ASYMMETRY]))


def thresholds(network: SteadyMotor) -> tuple[float, float]:
    """The commands, lower and upper, that set a shaft at rest in motion; infinite where saturation never lets them."""
    lower, upper = (_breakaway(network, side) for side in (-1.0, 1.0))
    return lower, upper


def _breakaway(network: SteadyMotor, side: float) -> float:
    held = held_nm(network, side if network.torque_gain > 0.0 else -side)
    return float(side * command_for(held / abs(network.torque_gain), network.row[SATURATION]))


def command_for(ratio: npt.ArrayLike, saturation: npt.ArrayLike) -> FloatArray:
    """The smaller root c of ratio = c/(1 + κ·c²), of their shape; infinite where there is none."""
    asked = np.asarray(ratio, dtype=float)
    root = 1.0 - 4.0 * np.asarray(saturation) * asked**2
    return np.where(root < 0.0, inf, 2.0 * asked / (1.0 + np.sqrt(np.maximum(root, 0.0))))


def source_velocity(network: SteadyMotor, command: npt.ArrayLike) -> FloatArray:
    """As NortonNetwork.source_velocity."""
    row, torque = network.row, drive_nm(network, command)
    if network.servo is not None and network.servo.holds_position:
        return np.zeros_like(torque)
    side, size = np.sign(torque), np.abs(torque)
    beyond = np.maximum(size - network.coulomb_torque_nm * (1.0 + row[STRIBECK] + side * row[ASYMMETRY]), 0.0)
    looped = network.servo is not None
    if not (row[STRIBECK] or row[DRAG] or (looped and row[SATURATION])):
        return np.asarray(side * beyond / steepness_nms_rad(network))
    # A velocity commanded is not exceeded. Damping that falls with the velocity is greatest half way to where there is
    # none: beyond, nothing is steady.
    if looped:
        fastest = np.abs(np.asarray(command, dtype=float))
    else:
        fastest = size / network.viscous_damping_nms_rad if row[DRAG] >= 0.0 else -0.5 / row[DRAG]
    low, high = np.zeros_like(torque), np.broadcast_to(fastest, torque.shape)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        driving = np.abs(drive_nm(network, left_of(network, command, side * middle)))
        faster = driving > np.abs(resistance_nm(network, side * middle))
        low, high = np.where(faster, middle, low), np.where(faster, high, middle)
    # Never held up to the last step of the search: nothing holds it.
    steady = np.where(not looped and (row[DRAG] < 0.0) & (high >= fastest), inf, low)
    return np.asarray(side * np.where(beyond > 0.0, steady, 0.0))


def falling(network: SteadyMotor, fastest_rad_s: float) -> tuple[float, float, float] | None:
    """Where sliding resistance falls with the speed: from, to [rad/s] and the steepest slope there [N m s/rad].

    Of either direction, up to ``fastest_rad_s``; None where it rises everywhere.
    """
    row, speed = network.row, np.linspace(0.0, fastest_rad_s, SPEEDS)
    if row[STRIBECK]:
        speed = np.union1d(speed, np.linspace(0.0, 3.0 * abs(row[STRIBECK_VELOCITY]), SPEEDS))
    over = speed / row[STRIBECK_VELOCITY]
    slope = steepness_nms_rad(network) + network.viscous_damping_nms_rad * 2.0 * row[DRAG] * speed
    slope -= network.coulomb_torque_nm * row[STRIBECK] * 2.0 * over / row[STRIBECK_VELOCITY] * np.exp(-(over**2))
    falls = speed[slope < 0.0]
    return (float(falls[0]), float(falls[-1]), float(slope.min())) if falls.size else None


def greatest_friction_nm(network: SteadyMotor) -> float:
    """The most [N m] that friction and cogging may hold anywhere, in either direction, with no torque at the port."""
    waves = float(np.sum(np.hypot(*waves_of(network.terms)[:, 1:].T)))
    by_place = sum(hypot(*term.values) for term in network.terms if term.name == "friction_by_position")
    held = max(held_nm(network, side) for side in (-1.0, 1.0))
    return max(held, network.coulomb_torque_nm) + network.coulomb_torque_nm * by_place + waves


def command_shown(network: SteadyMotor) -> float:
    """The command that pictures and costs go to: SHOWN times the greater threshold.

    Where saturation never lets the shaft go, a threshold is what it would be without.
    """
    finite = [abs(each) for each in thresholds(network) if np.isfinite(each)]
    return SHOWN * max(finite, default=network.coulomb_torque_nm / abs(network.torque_gain))
