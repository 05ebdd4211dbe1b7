"""The integration of a network and of what its terms do there and then, compiled; none of the simulator's."""

from math import copysign, cos, exp, sin

import numpy as np
from numba import njit

from norton_bench.arrays import FloatArray
from norton_bench.models import servo_steps
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

# What an integration calls at each of its stages: where it is called, it costs a quarter less than as a function.
INLINED = njit(cache=True, nogil=True, inline="always")


@INLINED
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


@INLINED
def gain(row: FloatArray, lagged: float, angle: float) -> float:
    """g, of the torque gain; ``lagged`` is the command behind the amplifier's lag."""
    value = 1.0
    if row[RIPPLE_PERIODS] != 0.0:
        phase = row[RIPPLE_PERIODS] * angle
        value += row[RIPPLE_COSINE] * cos(phase) + row[RIPPLE_SINE] * sin(phase)
    return float(value / (1.0 + row[SATURATION] * lagged * lagged))


@INLINED
def damping(row: FloatArray, velocity: float) -> float:
    """b, of the viscous damping."""
    return float(1.0 + row[DRAG] * abs(velocity))


@INLINED
def position_torque(waves: FloatArray, angle: float) -> float:
    """τ(θ) [N m] of ``waves`` (waves, 3)."""
    value = 0.0
    for k in range(waves.shape[0]):
        phase = waves[k, 0] * angle
        value += waves[k, 1] * cos(phase) + waves[k, 2] * sin(phase)
    return value


@INLINED
def driving(row: FloatArray, waves: FloatArray, motor_nm: float, torque_gain: float, angle: float) -> float:
    """What the motor and the angle drive the shaft with [N m]; ``motor_nm`` is the motor's torque without terms."""
    return float(gain(row, motor_nm / torque_gain, angle) * motor_nm + position_torque(waves, angle))


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


NEWTON_STEPS = 30
# A root is good enough when the mean velocity of a step is known to this [rad/s].
VELOCITY_TOLERANCE = 1e-10


@INLINED
def _slid(phi: float, displacement: float, s: float) -> tuple[float, float]:
    """The Dahl state after a displacement [rad], exactly, and what is left of a difference to where it ends."""
    left = exp(-s * abs(displacement))
    if displacement > 0.0:
        return 1.0 / s + (phi - 1.0 / s) * left, left
    if displacement < 0.0:
        return -1.0 / s + (phi + 1.0 / s) * left, left
    return phi, left


@INLINED
def dahl_flow(phi: float, displacement: float, s: float) -> float:
    """The Dahl state after a displacement [rad], exactly."""
    return _slid(phi, displacement, s)[0]


@njit(cache=True, nogil=True)
def mean_velocity(
    torque: float,
    velocity: float,
    phi: float,
    step_s: float,
    inertia: float,
    viscous: float,
    s: float,
    sigma_0: float,
    sigma_1: float,
) -> float:
    """The mean velocity of a step [rad/s]: the root of the momentum balance, by Newton held inside a bracket."""
    # Friction is bounded by its two asymptotes, which bracket the root.
    inertial = 2.0 * inertia / step_s
    friction_bound = sigma_0 / s + 2.0 * sigma_1 / (s * step_s)
    free = (inertial * velocity + torque) / (inertial + viscous)
    low = free - friction_bound / (inertial + viscous)
    high = free + friction_bound / (inertial + viscous)
    guess = min(max(velocity, low), high)
    for _ in range(NEWTON_STEPS):
        displacement = guess * step_s
        after, retained = _slid(phi, displacement, s)
        friction = 0.5 * sigma_0 * (phi + after) + sigma_1 * (after - phi) / step_s
        balance = inertial * (guess - velocity) + viscous * guess + friction - torque
        if balance > 0.0:
            high = guess
        else:
            low = guess
        side = 1.0 if displacement > 0.0 or (displacement == 0.0 and balance < 0.0) else -1.0
        compliance = (1.0 - side * s * phi) * retained
        slope = inertial + viscous + (0.5 * sigma_0 * step_s + sigma_1) * compliance
        step = balance / slope
        following = guess - step
        if abs(step) < VELOCITY_TOLERANCE:
            return following  # before the bracket is asked, an end of which the root itself has become
        if following <= low or following >= high:
            following = 0.5 * (low + high)
        guess = following
    return guess


@njit(cache=True, nogil=True)
def _acceleration(
    motor_parameters: tuple[float, float, float, float, float, float, float],
    row: FloatArray,
    waves: FloatArray,
    state: tuple[float, float, float, float],
    port_nm: float,
) -> float:
    torque_gain, _, inertia, viscous, s, sigma_0, sigma_1 = motor_parameters
    position, velocity, motor, phi = state
    exerted = driving(row, waves, motor, torque_gain, position) - port_nm
    slope = s / strength(row, velocity, position, port_nm)
    friction = sigma_0 * phi + sigma_1 * (velocity - slope * abs(velocity) * phi)
    return float((exerted - friction - viscous * damping(row, velocity) * velocity) / inertia)


@njit(cache=True, nogil=True)
def free_motion(
    command: FloatArray,
    port: FloatArray,
    tick_s: float,
    substeps: int,
    motor_parameters: tuple[float, float, float, float, float, float, float],
    row: FloatArray,
    waves: FloatArray,
    start: FloatArray,
    loop: servo_steps.Loop,
    servo: bool,
) -> FloatArray:
    """Position, velocity and acceleration at every tick, shape (3, n), while the shaft exerts ``port`` (n,).

    Command and port torque are held from tick to tick. ``motor_parameters`` are gain, bandwidth, inertia, viscous
    damping, s = σ0/τc, σ0 and σ1. ``row`` and ``waves`` are those of the network's terms, whose factors and torque hold
    through a step. ``start`` is position, velocity, motor torque and Dahl state before the first command acts. A
    ``servo`` has its ``loop``.
    """
    torque_gain, bandwidth, inertia, viscous, s, sigma_0, sigma_1 = motor_parameters
    step_s = tick_s / substeps
    decay = exp(-bandwidth * step_s)
    mean_decay = (1.0 - decay) / (bandwidth * step_s)
    position, velocity, motor, phi = start
    history, newest = servo_steps.moving_evenly(int((loop[2] + loop[3]) / step_s) + 3, position, velocity * step_s), 0
    motion = np.empty((3, command.size))
    if command.size:  # no contact holds more than its strength
        phi = copysign(min(abs(phi), strength(row, velocity, position, port[0]) / s), phi)
    for k in range(command.size):
        asked = torque_gain * command[k]
        motion[0, k], motion[1, k] = position, velocity
        motion[2, k] = _acceleration(motor_parameters, row, waves, (position, velocity, motor, phi), port[k])
        for _ in range(substeps):
            if servo:
                error = servo_steps.asked_in_step(command[k], history, newest, position, velocity, step_s, loop)
                asked = torque_gain * error
            exerted = driving(row, waves, asked + (motor - asked) * mean_decay, torque_gain, position) - port[k]
            slope = s / strength(row, velocity, position, port[k])
            drag = viscous * damping(row, velocity)
            mean = mean_velocity(exerted, velocity, phi, step_s, inertia, drag, slope, sigma_0, sigma_1)
            phi = dahl_flow(phi, mean * step_s, slope)
            position += mean * step_s
            velocity = 2.0 * mean - velocity
            motor = asked + (motor - asked) * decay
            newest = (newest + 1) % history.size
            history[newest] = position
    return motion


@njit(cache=True, nogil=True)
def lagged(command: FloatArray, decay: float, start: float) -> FloatArray:
    """A first-order lag of a held command, exactly, at the ticks at which each command is given."""
    output = np.empty(command.size)
    state = start
    for k in range(command.size):
        output[k] = state
        state = command[k] + (state - command[k]) * decay
    return output


@njit(cache=True, nogil=True)
def dahl_path(position: FloatArray, s: float, strengths: FloatArray, start: float) -> FloatArray:
    """The Dahl state [rad] along sampled positions taken as monotone between samples; ``strengths`` (n,) is γ."""
    state = np.empty(position.size)
    phi = start
    state[0] = phi
    for k in range(1, position.size):
        phi = dahl_flow(phi, position[k] - position[k - 1], s / strengths[k])
        state[k] = phi
    return state
