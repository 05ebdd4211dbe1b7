"""The integrator of the plants that are more than a motor: a driven source, a connection, the port's body, the load.

    source ── connection ── port's body ── torque sensor ── load machine

Bodies, their friction, the amplifiers, the load and the sensor are those of :mod:`norton_sim.integrator`, and so is
the scheme: half a drift, a kick, half a drift. What a connection exerts stands in the plant's own file of
:mod:`norton_sim.plants`. Row 2 of state and parameters is the source's; a source that reaches is where its path says,
whatever pulls at it. All damping is taken by the trapezoidal rule at once, over three bodies in a row.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from norton_sim.integrator import (
    ACTUATOR,
    ANGLE,
    COULOMB,
    ENCODER_PERIOD_NS,
    INVERSE_INERTIA,
    LOAD,
    POWERED,
    VELOCITY,
    drift,
    mean_current,
    motor_torque,
    own_damping,
    track,
)
from norton_sim.plants.assembled import (
    COMMAND_PER_AMPERE,
    DAMPER,
    DRIVE,
    HALF_GAP,
    HARDENING,
    LOAD_FRICTION,
    MOVEMENT,
    MUSCLE,
    REACH,
    SERVO,
    SERVO_DAMPING,
    SERVO_STIFFNESS,
    SPRING,
    STIFFENING,
)
from norton_sim.plants.motor_behind import modulate, pulled, stretch
from norton_sim.plants.muscles import follow_command, place, pull, stiffness

SOURCE, MODULATOR = 2, 3


@njit(cache=True, nogil=True)
def advance(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    joint: tuple[float, float],
    link: NDArray[np.float64],
    reach: NDArray[np.float64],
    substep_s: float,
    now_ns: int,
    to_ns: int,
) -> None:
    """Move ``state`` from ``now_ns`` to ``to_ns`` in place.

    Shapes: ``state`` (3, STATE_COLUMNS), ``machines`` (3, MACHINE_COLUMNS), ``link`` (LINK_COLUMNS,), ``reach``
    (REACH_COLUMNS,); with a modulator both have a fourth row. ``joint`` is the torque sensor's stiffness [N m/rad] and
    damping [N m s/rad]. Substeps and encoders as in :func:`norton_sim.integrator.advance`.
    """
    if link[DRIVE] == REACH:
        follow_command(reach, state[ACTUATOR], link, now_ns * 1e-9)
    while now_ns < to_ns:
        sample_ns = (now_ns // ENCODER_PERIOD_NS + 1) * ENCODER_PERIOD_NS
        stop_ns = min(sample_ns, to_ns)
        _integrate(state, machines, joint, link, reach, substep_s, now_ns * 1e-9, (stop_ns - now_ns) * 1e-9)
        if stop_ns == sample_ns:
            track(state[ACTUATOR], machines[ACTUATOR])
            track(state[LOAD], machines[LOAD])
            if link[STIFFENING] != 0.0:
                track(state[MODULATOR], machines[MODULATOR])
        now_ns = stop_ns


@njit(cache=True, nogil=True)
def _integrate(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    joint: tuple[float, float],
    link: NDArray[np.float64],
    reach: NDArray[np.float64],
    substep_s: float,
    now_s: float,
    duration_s: float,
) -> None:
    """Equal substeps over ``duration_s``."""
    count = math.ceil(duration_s / substep_s)
    h = duration_s / count
    bound = _drift(state, machines, link, reach, h / 2, now_s + h / 2)
    for step in range(count):
        middle_s = now_s + (step + 0.5) * h
        _kick(state, machines, joint, link, reach, bound, middle_s, h)
        whole = step < count - 1
        length = h if whole else h / 2
        bound = _drift(state, machines, link, reach, length, middle_s + length)


@njit(cache=True, nogil=True, inline="always")
def _drift(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    link: NDArray[np.float64],
    reach: NDArray[np.float64],
    h: float,
    end_s: float,
) -> float:
    """Angles and friction over ``h`` at constant velocity; returns the bound of the source's friction [N m]."""
    ahead = state[SOURCE, ANGLE] - state[ACTUATOR, ANGLE]
    ahead += (state[SOURCE, VELOCITY] - state[ACTUATOR, VELOCITY]) * h / 2
    carried = link[SPRING] * stretch(ahead, link)
    bound = machines[SOURCE, COULOMB] + link[LOAD_FRICTION] * abs(carried)
    drift(state[ACTUATOR], machines[ACTUATOR], machines[ACTUATOR, COULOMB], h)
    drift(state[LOAD], machines[LOAD], machines[LOAD, COULOMB], h)
    if link[DRIVE] == REACH:
        state[SOURCE, ANGLE], state[SOURCE, VELOCITY], _ = place(reach, end_s, link[MOVEMENT])
    else:
        drift(state[SOURCE], machines[SOURCE], bound, h)
    return float(bound)


@njit(cache=True, nogil=True, inline="always")
def _kick(
    state: NDArray[np.float64],
    machines: NDArray[np.float64],
    joint: tuple[float, float],
    link: NDArray[np.float64],
    reach: NDArray[np.float64],
    bound: float,
    now_s: float,
    h: float,
) -> None:
    """Velocities over ``h`` at constant angles: (1 + A) ω⁺ = (1 − A) ω + h W τ, with A = h/2 · W C."""
    current = mean_current(state[ACTUATOR], h)
    command = link[COMMAND_PER_AMPERE] * current
    spring = stiffness(reach, now_s, link) if link[STIFFENING] == 0.0 else modulate(state[MODULATOR], link, h)
    exertion, damper = _connection(state, link, spring, command)
    powered = link[DRIVE] == SERVO and state[ACTUATOR, POWERED] != 0.0
    drive = link[SERVO_STIFFNESS] * (command - state[SOURCE, ANGLE]) if powered else 0.0
    servo_damping = link[SERVO_DAMPING] if powered else 0.0
    sensor = joint[0] * (state[ACTUATOR, ANGLE] - state[LOAD, ANGLE])

    source_torque = motor_torque(state[SOURCE], machines[SOURCE], current) + drive - exertion
    port_torque = motor_torque(state[ACTUATOR], machines[ACTUATOR], 0.0) + exertion - sensor
    load_torque = motor_torque(state[LOAD], machines[LOAD], mean_current(state[LOAD], h)) + sensor
    source_damping = own_damping(state[SOURCE], machines[SOURCE], bound) + servo_damping
    port_damping = own_damping(state[ACTUATOR], machines[ACTUATOR], machines[ACTUATOR, COULOMB])
    load_damping = own_damping(state[LOAD], machines[LOAD], machines[LOAD, COULOMB])

    source_gain = h * machines[SOURCE, INVERSE_INERTIA]
    port_gain = h * machines[ACTUATOR, INVERSE_INERTIA]
    load_gain = h * machines[LOAD, INVERSE_INERTIA]
    _solve(
        state,
        (source_gain, port_gain, load_gain),
        (source_torque, port_torque, load_torque),
        (source_damping, port_damping, load_damping),
        damper,
        joint[1],
    )


@njit(cache=True, nogil=True, inline="always")
def _solve(
    state: NDArray[np.float64],
    gains: tuple[float, float, float],
    torques: tuple[float, float, float],
    dampings: tuple[float, float, float],
    damper: float,
    joint_damping: float,
) -> None:
    """The velocities of source, port and load after the kick; ``gains`` are h over each inertia."""
    source_gain, port_gain, load_gain = gains
    source_torque, port_torque, load_torque = torques
    source_damping, port_damping, load_damping = dampings
    source, port, load = state[SOURCE, VELOCITY], state[ACTUATOR, VELOCITY], state[LOAD, VELOCITY]
    # How fast each is slowed down now; half of it acts before the kick, half after.
    source_slowed = source_damping * source + damper * (source - port)
    port_slowed = port_damping * port + damper * (port - source) + joint_damping * (port - load)
    load_slowed = load_damping * load + joint_damping * (load - port)
    right_1 = source + source_gain * (source_torque - source_slowed / 2)
    right_2 = port + port_gain * (port_torque - port_slowed / 2)
    right_3 = load + load_gain * (load_torque - load_slowed / 2)
    d1 = 1.0 + source_gain / 2 * (source_damping + damper)
    d2 = 1.0 + port_gain / 2 * (port_damping + damper + joint_damping)
    d3 = 1.0 + load_gain / 2 * (load_damping + joint_damping)
    # A row of three bodies: what lies beside the diagonal is taken out from both ends.
    from_source, from_load = port_gain / 2 * damper / d1, port_gain / 2 * joint_damping / d3
    d2 -= from_source * source_gain / 2 * damper + from_load * load_gain / 2 * joint_damping
    port = (right_2 + from_source * right_1 + from_load * right_3) / d2
    state[ACTUATOR, VELOCITY] = port
    state[SOURCE, VELOCITY] = (right_1 + source_gain / 2 * damper * port) / d1
    state[LOAD, VELOCITY] = (right_3 + load_gain / 2 * joint_damping * port) / d3


@njit(cache=True, nogil=True, inline="always")
def _connection(
    state: NDArray[np.float64], link: NDArray[np.float64], spring: float, command: float
) -> tuple[float, float]:
    """What the port's body is turned with at these angles [N m], and what damps it against the source [N m s/rad]."""
    if link[DRIVE] == MUSCLE:
        return pull(state[ACTUATOR, ANGLE], command, link), 0.0
    deflection = stretch(state[SOURCE, ANGLE] - state[ACTUATOR, ANGLE], link)
    holds = link[HALF_GAP] == 0.0 or deflection != 0.0
    exertion = spring * deflection if link[HARDENING] == 0.0 else pulled(spring, deflection, link)
    return exertion, link[DAMPER] if holds else 0.0
