"""Steady sliding of an identified motor with its terms; what changes with the position is taken at its mean.

The torque at the port is drive less resistance. Friction that grows with that torque is no function of the velocity
alone; ``resistance_nm`` has it where no torque is at the port, and ``port_torque_nm`` where it is.
"""

from math import hypot

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import ASYMMETRY, DRAG, LOAD, SATURATION, STRIBECK, STRIBECK_VELOCITY, waves_of

SPEEDS = 1001
SHOWN = 3.0


def drive_nm(network: NortonNetwork, command: npt.ArrayLike) -> FloatArray:
    """Torque of the motor itself [N m] under steady commands, of their shape: Km·Ka·c/(1 + κ·c²)."""
    asked = np.asarray(command, dtype=float)
    return np.asarray(network.torque_gain * asked / (1.0 + network.row[SATURATION] * asked**2))


def friction_nm(network: NortonNetwork, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Friction [N m] in steady sliding at velocities, of their shape; 0 at 0, where friction is any."""
    velocity, row = np.asarray(velocity_rad_s, dtype=float), network.row
    side = np.sign(velocity)
    strength = 1.0 + side * row[ASYMMETRY] + row[STRIBECK] * np.exp(-((velocity / row[STRIBECK_VELOCITY]) ** 2))
    return np.asarray(network.coulomb_torque_nm * strength * side)


def damping_nm(network: NortonNetwork, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Damping [N m] at velocities, of their shape."""
    velocity = np.asarray(velocity_rad_s, dtype=float)
    return np.asarray(network.viscous_damping_nms_rad * (1.0 + network.row[DRAG] * np.abs(velocity)) * velocity)


def resistance_nm(network: NortonNetwork, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Friction and damping [N m] in steady sliding at velocities, of their shape."""
    return friction_nm(network, velocity_rad_s) + damping_nm(network, velocity_rad_s)


def port_torque_nm(network: NortonNetwork, command: npt.ArrayLike, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Torque at the port [N m] in steady sliding: τ = drive − resistance − μ·|τ|·sgn ω."""
    free = drive_nm(network, command) - resistance_nm(network, velocity_rad_s)
    load = network.coulomb_torque_nm * network.row[LOAD]
    # Solved for τ, which has the sign of ``free`` as long as μ is below 1.
    return np.asarray(free / (1.0 + load * np.sign(velocity_rad_s) * np.sign(free)))


def held_nm(network: NortonNetwork, side: float) -> float:
    """The friction [N m] that sliding towards ``side`` (±1) begins at, with no torque at the port."""
    row = network.row
    return float(network.coulomb_torque_nm * (1.0 + row[STRIBECK] + side * row[ASYMMETRY]))


def falling(network: NortonNetwork, fastest_rad_s: float) -> tuple[float, float, float] | None:
    """Where sliding resistance falls with the speed: from, to [rad/s] and the steepest slope there [N m s/rad].

    Of either direction, up to ``fastest_rad_s``; None where it rises everywhere.
    """
    row, speed = network.row, np.linspace(0.0, fastest_rad_s, SPEEDS)
    if row[STRIBECK]:
        speed = np.union1d(speed, np.linspace(0.0, 3.0 * abs(row[STRIBECK_VELOCITY]), SPEEDS))
    over = speed / row[STRIBECK_VELOCITY]
    slope = network.viscous_damping_nms_rad * (1.0 + 2.0 * row[DRAG] * speed)
    slope -= network.coulomb_torque_nm * row[STRIBECK] * 2.0 * over / row[STRIBECK_VELOCITY] * np.exp(-(over**2))
    falls = speed[slope < 0.0]
    return (float(falls[0]), float(falls[-1]), float(slope.min())) if falls.size else None


def greatest_friction_nm(network: NortonNetwork) -> float:
    """The most [N m] that friction and cogging may hold anywhere, in either direction, with no torque at the port."""
    waves = float(np.sum(np.hypot(*waves_of(network.terms)[:, 1:].T)))
    by_place = sum(hypot(*term.values) for term in network.terms if term.name == "friction_by_position")
    held = max(held_nm(network, side) for side in (-1.0, 1.0))
    return max(held, network.coulomb_torque_nm) + network.coulomb_torque_nm * by_place + waves


def command_shown(network: NortonNetwork) -> float:
    """The command that pictures and costs go to: SHOWN times the greater threshold.

    Where saturation never lets the shaft go, a threshold is what it would be without.
    """
    thresholds = [abs(each) for each in network.thresholds if np.isfinite(each)]
    return SHOWN * max(thresholds, default=network.coulomb_torque_nm / abs(network.torque_gain))
