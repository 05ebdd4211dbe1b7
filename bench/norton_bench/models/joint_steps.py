"""The integration of a motor behind a joint, compiled: what the port feels of it, and how it moves the free port.

    Jm·q̈ = g·Km·Ka·lag(c) + τ(q) − b·B·q̇ − σ0·φ − σ1·φ̇ − τ_j,     J·ω̇ = τ_j − τ

q is the motor's angle, θ the port's. The joint holds τ_j = k·δ' + d·δ̇ with δ' what its deflection δ = q − θ exceeds the
play by; within the play it holds nothing. Steps are those of Runge and Kutta, of the fourth order. The friction state
follows the displacement since the step began, exactly: however fast the contact relaxes, it makes no step unstable.
"""

from math import ceil, exp, sqrt

import numpy as np
from numba import njit

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.models.network_steps import dahl_flow, damping, driving, strength
from norton_bench.models.terms import LIGHTEST_OUTPUT

# Of an integration: its steps times the fastest rate. The error of a frequency is a 120th of its fourth power, 2e-4.
RATE_STEP = 0.4
# torque gain, bandwidth, inertia, viscous damping, s = σ0/τc, σ0, σ1, as network_steps.free_motion has them
MotorValues = tuple[float, float, float, float, float, float, float]
# k [N m/rad], d [N m s/rad], J [kg m²], half of the play [rad]
JointValues = tuple[float, float, float, float]

# As network_steps.INLINED.
INLINED = njit(cache=True, nogil=True, error_model="numpy", inline="always")


@INLINED
def joint_torque(joint: JointValues, deflection: float, rate: float) -> float:
    """τ_j [N m] of a joint deflected by ``deflection`` [rad], which changes at ``rate`` [rad/s]."""
    stiffness, damper, _, half = joint
    if half > 0.0 and abs(deflection) <= half:
        return 0.0
    beyond = deflection - half if deflection > 0.0 else deflection + half
    return stiffness * beyond + damper * rate


@INLINED
def own_torque(
    motor: MotorValues,
    row: FloatArray,
    waves: FloatArray,
    drive: float,
    angle: float,
    velocity: float,
    way: float,
    phi: float,
    joint_nm: float,
    drifts: tuple[float, float],
) -> float:
    """What turns the rotor but for the joint [N m]: ``way`` [rad] after its contact was deflected by ``phi``.

    ``drive`` is Km·Ka·lag(c) without its factor; ``drifts`` are those of the contact's strength and of the damping.
    """
    torque_gain, _, _, viscous, s, sigma_0, sigma_1 = motor
    slope = s / (strength(row, velocity, angle, joint_nm) * drifts[0])
    deflected = dahl_flow(phi, way, slope)
    slip = velocity - slope * abs(velocity) * deflected
    held = sigma_0 * deflected + sigma_1 * slip
    damped = viscous * (damping(row, velocity) + drifts[1] - 1.0) * velocity
    return driving(row, waves, drive, torque_gain, angle) - damped - held


@INLINED
def contact_after(
    motor: MotorValues,
    row: FloatArray,
    way: float,
    phi: float,
    velocity: float,
    angle: float,
    joint_nm: float,
    drift: float,
) -> float:
    """The Dahl state after ``way`` [rad]."""
    return dahl_flow(phi, way, motor[4] / (strength(row, velocity, angle, joint_nm) * drift))  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def fastest_rate(motor: MotorValues, joint: JointValues) -> float:
    """Of the rotor on its contact and on its joint [1/s]."""
    _, _, inertia, viscous, _, sigma_0, sigma_1 = motor
    return sqrt((joint[0] + sigma_0) / inertia) + (joint[1] + viscous + sigma_1) / inertia


@njit(cache=True, nogil=True, error_model="numpy")
def behind(
    position: FloatArray,
    drive: FloatArray,
    step_s: float,
    motor: MotorValues,
    joint: JointValues,
    row: FloatArray,
    waves: FloatArray,
    drifts: FloatArray,
    begins: IntArray,
    states: FloatArray,
    moved: float,
) -> FloatArray:
    """τ_j [N m] at every sample of the port's ``position`` (n,), shape (n,).

    ``drive`` (n,) is Km·Ka·lag(c) as means from each sample to the next. ``drifts`` (2, n) are the factors in time of
    the contact's strength and of the damping; (2, 1) where there are none. At the samples ``begins``, of which the
    first is 0, angle, velocity and Dahl state go into ``states`` (begins, 3), from whose first row all begins. With
    ``moved`` other than zero they come from there, the Dahl state ``moved`` further: what an unknown state does.
    """
    count, event, many = position.size, 0, drifts.shape[1] > 1
    output = np.empty(count)
    substeps = max(1, ceil(step_s * fastest_rate(motor, joint) / RATE_STEP))
    state, speed = states[0].copy(), _slope(position, 0, step_s)
    for k in range(count):
        if event < begins.size and begins[event] == k:
            if moved != 0.0:
                state[:] = states[event]
                state[2] += moved
            else:
                states[event] = state
            event += 1
        output[k] = joint_torque(joint, state[0] - position[k], state[1] - speed)
        if k == count - 1:
            break
        after, drift = _slope(position, k + 1, step_s), drifts[:, k if many else 0]
        for part in range(substeps):
            port = (position[k], position[k + 1] - position[k], speed, after)
            _carry_on(state, port, (part, substeps), step_s, drive[k], motor, joint, row, waves, (drift[0], drift[1]))
        speed = after
    return output


@INLINED
def _carry_on(
    state: FloatArray,
    port: tuple[float, float, float, float],
    share: tuple[int, int],
    step_s: float,
    push: float,
    motor: MotorValues,
    joint: JointValues,
    row: FloatArray,
    waves: FloatArray,
    drifts: tuple[float, float],
) -> None:
    """Angle, velocity and Dahl state of the motor after one of so many parts (``share``) of a step of the port."""
    angle, velocity, phi = state
    part, parts = share
    h = step_s / parts
    way, v, carried, total_way, total = 0.0, velocity, 0.0, 0.0, 0.0
    middle = velocity
    for stage in range(4):
        far = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        weight = 1.0 if stage in (0, 3) else 2.0
        at, rate = _between(port, step_s, (part + far) / parts)
        carried = joint_torque(joint, angle + way - at, v - rate)
        own = own_torque(motor, row, waves, push, angle + way, v, way, phi, carried, drifts)
        acceleration = (own - carried) / motor[2]
        total_way += weight * v
        total += weight * acceleration
        if stage == 1:
            middle = v
        onward = h if stage == 2 else 0.5 * h
        way, v = onward * v, velocity + onward * acceleration
    way = h / 6.0 * total_way
    state[2] = contact_after(motor, row, way, phi, middle, angle, carried, drifts[0])
    state[0] = angle + way
    state[1] = velocity + h / 6.0 * total


@INLINED
def _slope(position: FloatArray, k: int, step_s: float) -> float:
    """The velocity at a sample [rad/s], of a cubic through its neighbours."""
    last = position.size - 1
    if 2 <= k <= last - 2:
        near, far = position[k + 1] - position[k - 1], position[k + 2] - position[k - 2]
        return float((8.0 * near - far) / (12.0 * step_s))
    low, high = max(k - 1, 0), min(k + 1, last)
    return float((position[high] - position[low]) / (max(high - low, 1) * step_s))


@INLINED
def _between(port: tuple[float, float, float, float], step_s: float, share: float) -> tuple[float, float]:
    """Angle and velocity a ``share`` of a step after a sample: ``port`` is the angle there, the way to the next sample,
    and the velocities at both, of the cubic through them."""
    begin, way, speed, after = port
    a, b = speed * step_s - way, way - after * step_s
    rest = 1.0 - share
    angle = begin + share * way + share * rest * (a * rest + b * share)
    velocity = way + (1.0 - 2.0 * share) * (a * rest + b * share) + share * rest * (b - a)
    return angle, velocity / step_s


@njit(cache=True, nogil=True, error_model="numpy")
def free_motion(
    command: FloatArray,
    port: FloatArray,
    tick_s: float,
    motor: MotorValues,
    joint: JointValues,
    row: FloatArray,
    waves: FloatArray,
    start: FloatArray,
) -> FloatArray:
    """The port's position, velocity and acceleration at every tick, shape (3, n), while it exerts ``port`` (n,).

    Command and port torque are held from tick to tick. ``start`` is the port's position and velocity, the motor's
    torque and Dahl state before the first command acts; the motor is as fast as the port, and as far ahead as the
    joint needs to hold what the port exerts.
    """
    torque_gain, bandwidth, inertia, _, s, _, _ = motor
    output_inertia = max(joint[2], LIGHTEST_OUTPUT * inertia)
    rate = fastest_rate(motor, joint) + sqrt(joint[0] / output_inertia) + joint[1] / output_inertia
    substeps = max(1, ceil(tick_s * rate / RATE_STEP))
    h = tick_s / substeps
    decay = exp(-bandwidth * h)
    mean_decay = (1.0 - decay) / (bandwidth * h)
    x, v, lagged, phi = start
    motion = np.empty((3, command.size))
    if command.size:
        most = strength(row, v, x, port[0]) / s
        phi = min(max(phi, -most), most)
        x_motor = x + port[0] / joint[0] + np.sign(port[0]) * joint[3]
        state = np.array([x, v, x_motor, v, phi])
    for k in range(command.size):
        asked = torque_gain * command[k]
        motion[0, k], motion[1, k] = state[0], state[1]
        carried = joint_torque(joint, state[2] - state[0], state[3] - state[1])
        motion[2, k] = (carried - port[k]) / output_inertia
        for _ in range(substeps):
            push = asked + (lagged - asked) * mean_decay
            _swing(state, push, port[k], h, output_inertia, motor, joint, row, waves)
            lagged = asked + (lagged - asked) * decay
    return motion


@njit(cache=True, nogil=True, error_model="numpy")
def _swing(
    state: FloatArray,
    push: float,
    port_nm: float,
    h: float,
    output_inertia: float,
    motor: MotorValues,
    joint: JointValues,
    row: FloatArray,
    waves: FloatArray,
) -> None:
    """The port's angle and velocity, the motor's, and its Dahl state, a step later."""
    x, v, q, w, phi = state
    # Of the four stages: angles' rates, then the velocities'; the first column is that before the first stage.
    rates, carried = np.zeros((4, 5)), 0.0
    for stage in range(4):
        share = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
        way = share * rates[1, stage]
        x_at, v_at, w_at = x + share * rates[0, stage], v + share * rates[2, stage], w + share * rates[3, stage]
        carried = joint_torque(joint, q + way - x_at, w_at - v_at)
        own = own_torque(motor, row, waves, push, q + way, w_at, way, phi, carried, (1.0, 1.0))
        rates[0, stage + 1], rates[1, stage + 1] = v_at, w_at
        rates[2, stage + 1], rates[3, stage + 1] = (carried - port_nm) / output_inertia, (own - carried) / motor[2]
    way = h * _weighed(rates[1])
    state[4] = contact_after(motor, row, way, phi, rates[1, 2], q, carried, 1.0)
    state[0] = x + h * _weighed(rates[0])
    state[1] = v + h * _weighed(rates[2])
    state[2] = q + way
    state[3] = w + h * _weighed(rates[3])


@njit(cache=True, nogil=True, error_model="numpy")
def _weighed(rates: FloatArray) -> float:
    """The mean of the four stages of a step, which stand from 1 on."""
    return float((rates[1] + 2.0 * rates[2] + 2.0 * rates[3] + rates[4]) / 6.0)
