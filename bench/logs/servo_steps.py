"""The compiled simulation of a loaded servo: its own law, a motor on a voltage, gears whose friction grows with load.

    J a = K u − E v − (b v + s F) − τ₀ − τ_load        τ_load = J_load a + g sin(q − q₀)
    F = Fc + Fs w + |τ_load| (μ + μs w),  s = sgn v,  w = exp(−(v/vs)²)

K and E are Km/R and Km²/R of a motor on a voltage, its torque gain and nothing of one on a current, and nothing while
the drive is off. What supplies a switched drive sags while it is switched on: R is then the winding's resistance and,
for the share of time that the supply is connected, the source's. Friction depends on the load that passes through the
gears, its inertia included, so that it stands on both sides of the equation; for either direction and either sign of
the load the equation is linear and solved as it is. At rest friction holds up to its limit.

Kept apart because it is compiled: see bench/identification/loops.py.
"""

from math import ceil, exp, sin
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


class Servo(NamedTuple):
    """Motor, gears and friction in SI. ``resistance`` 0 is a motor on a current: ``constant`` is then its gain."""

    constant: float
    resistance: float
    source_resistance: float
    inertia: float
    viscous: float
    coulomb: float
    offset: float
    stiction: float
    load_coefficient: float
    load_stiction: float
    stribeck_velocity: float


class Load(NamedTuple):
    """What hangs at the port: its inertia, the amplitude of gravity's exertion, and where that is zero."""

    inertia: float
    gravity: float
    gravity_zero: float


class Loop(NamedTuple):
    """``command = proportional (goal − position) − derivative · velocity`` within ± ``limit``; else it is as logged.

    ``switched``: the command is the share of time that the supply is connected.
    """

    closed: bool
    proportional: float
    derivative: float
    limit: float
    switched: bool


class Inputs(NamedTuple):
    """What acts from outside, held from each instant in ``time_s`` to the next; arrays (n,)."""

    time_s: FloatArray
    goal: FloatArray
    command: FloatArray
    supply: FloatArray
    enabled: BoolArray


@njit(cache=True, nogil=True)
def electric(servo: Servo, loop: Loop, command: float, supply: float) -> tuple[float, float]:
    """The motor's exertion at rest, and what it loses per velocity."""
    if servo.resistance == 0.0:
        return servo.constant * command * supply, 0.0
    connected = min(abs(command), 1.0) if loop.switched else 0.0
    per_volt = servo.constant / (servo.resistance + servo.source_resistance * connected)
    return per_volt * command * supply, per_volt * servo.constant


@njit(cache=True, nogil=True)
def next_velocity(
    servo: Servo, load: Load, driving: float, braking: float, pull: float, velocity: float, dt_s: float
) -> float:
    """The velocity ``dt_s`` later; friction stops a motion and holds it, and does not turn it round.

    ``driving`` is the exertion at rest, without gravity's ``pull``; ``braking`` what is lost per velocity.
    """
    left = exp(-((velocity / servo.stribeck_velocity) ** 2))
    coefficient = servo.load_coefficient + servo.load_stiction * left
    constant = servo.coulomb + servo.stiction * left
    side = 1.0 if velocity > 0.0 else -1.0
    if velocity == 0.0:
        push = driving - pull
        if abs(push) <= constant + coefficient * abs(pull):
            return 0.0
        side = 1.0 if push > 0.0 else -1.0
    acceleration = 0.0
    sign = 1.0 if pull > 0.0 else -1.0
    for _ in range(2):
        share = side * sign * coefficient
        push = driving - braking * velocity - side * constant - pull * (1.0 + share)
        acceleration = push / (servo.inertia + dt_s * braking + load.inertia * (1.0 + share))
        if sign * (load.inertia * acceleration + pull) >= 0.0:
            break
        sign = -sign
    after = velocity + dt_s * acceleration
    return 0.0 if after * side < 0.0 else after


@njit(cache=True, nogil=True)
def simulate(
    servo: Servo, load: Load, loop: Loop, inputs: Inputs, position: float, velocity: float, longest_s: float
) -> FloatArray:
    """Position at every instant of the inputs, shape (n,), in steps of at most ``longest_s``."""
    count = inputs.time_s.size
    path = np.empty(count)
    path[0] = position
    q, v = position, velocity
    for k in range(count - 1):
        span = inputs.time_s[k + 1] - inputs.time_s[k]
        steps = max(ceil(span / longest_s - 1e-9), 1)
        h = span / steps
        for _ in range(steps):
            ahead = q + 0.5 * h * v
            command = inputs.command[k]
            if loop.closed:
                wished = loop.proportional * (inputs.goal[k] - ahead) - loop.derivative * v
                command = min(max(wished, -loop.limit), loop.limit)
            driving, braking = 0.0, 0.0
            if inputs.enabled[k]:
                driving, braking = electric(servo, loop, command, inputs.supply[k])
            pull = load.gravity * sin(ahead - load.gravity_zero)
            after = next_velocity(servo, load, driving - servo.offset, braking + servo.viscous, pull, v, h)
            q += 0.5 * h * (v + after)
            v = after
        path[k + 1] = q
    return path
