"""What the terms of :mod:`norton_bench.models.terms` do there and then, compiled: three factors and a torque."""

from math import cos, exp, sin

import numpy as np
from numba import njit

from norton_bench.arrays import FloatArray
from norton_bench.models.terms import (
    ASYMMETRY,
    DRAG,
    FRICTION_COSINE,
    FRICTION_PERIODS,
    FRICTION_SINE,
    LEAST_STRENGTH,
    LOAD,
    RIPPLE_COSINE,
    RIPPLE_PERIODS,
    RIPPLE_SINE,
    SATURATION,
    STRIBECK,
    STRIBECK_VELOCITY,
)


@njit(cache=True, nogil=True)
def strength(row: FloatArray, velocity: float, angle: float, port_nm: float) -> float:
    """γ, of the Coulomb torque."""
    value = 1.0
    if row[STRIBECK] != 0.0:
        value += row[STRIBECK] * exp(-((velocity / row[STRIBECK_VELOCITY]) ** 2))
    if velocity > 0.0:
        value += row[ASYMMETRY]
    elif velocity < 0.0:
        value -= row[ASYMMETRY]
    value += row[LOAD] * abs(port_nm)
    if row[FRICTION_PERIODS] != 0.0:
        phase = row[FRICTION_PERIODS] * angle
        value += row[FRICTION_COSINE] * cos(phase) + row[FRICTION_SINE] * sin(phase)
    return float(max(value, LEAST_STRENGTH))


@njit(cache=True, nogil=True)
def gain(row: FloatArray, lagged: float, angle: float) -> float:
    """g, of the torque gain; ``lagged`` is the command behind the amplifier's lag."""
    value = 1.0
    if row[RIPPLE_PERIODS] != 0.0:
        phase = row[RIPPLE_PERIODS] * angle
        value += row[RIPPLE_COSINE] * cos(phase) + row[RIPPLE_SINE] * sin(phase)
    return float(value / (1.0 + row[SATURATION] * lagged * lagged))


@njit(cache=True, nogil=True)
def damping(row: FloatArray, velocity: float) -> float:
    """b, of the viscous damping."""
    return float(1.0 + row[DRAG] * abs(velocity))


@njit(cache=True, nogil=True)
def position_torque(waves: FloatArray, angle: float) -> float:
    """τ(θ) [N m] of ``waves`` (waves, 3)."""
    value = 0.0
    for k in range(waves.shape[0]):
        phase = waves[k, 0] * angle
        value += waves[k, 1] * cos(phase) + waves[k, 2] * sin(phase)
    return value


@njit(cache=True, nogil=True)
def strengths(row: FloatArray, velocity: FloatArray, angle: FloatArray, port_nm: FloatArray) -> FloatArray:
    """γ at every sample, shape (n,)."""
    values = np.empty(velocity.size)
    for k in range(velocity.size):
        values[k] = strength(row, velocity[k], angle[k], port_nm[k])
    return values


@njit(cache=True, nogil=True)
def gains(row: FloatArray, lagged: FloatArray, angle: FloatArray) -> FloatArray:
    """g at every sample, shape (n,)."""
    values = np.empty(lagged.size)
    for k in range(lagged.size):
        values[k] = gain(row, lagged[k], angle[k])
    return values
