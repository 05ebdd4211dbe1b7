"""The compiled simulation of a log's motion: a motor in its own loop or driven openly, gears, friction, and a load.

    J a = K u − E v − F − τ₀ − τ_cogging(q) − τ_port − τ_load        τ_load = J_load a + w + g sin(q − q₀)
    F = b v + s [Fc + Fs e + T(v) + |τ_load| (μ + μs e)]              s = sgn v,  e = exp(−(v/vs)²)

K and E are Km/R and Km²/R of a motor on a voltage, its torque gain and nothing of one on a current, and nothing while
the drive is off. What supplies a switched drive sags while it is switched on: R is then the winding's resistance and,
for the share of time that the supply is connected, the source's. T is any friction of velocity, as a table for either
direction. Friction may depend on the load that passes through the gears, its inertia included, so that it stands on
both sides of the equation; for either direction and either sign of the load the equation is linear and solved as it
is. At rest friction holds up to its limit.

Kept apart because it is compiled: see bench/norton_bench/identification/loops.py.
"""

from math import ceil, cos, exp, sin
from typing import NamedTuple

import numpy as np
from numba import njit

from norton_bench.arrays import BoolArray, FloatArray


class Motor(NamedTuple):
    """In SI. ``resistance`` 0 is a motor on a current: ``constant`` is then its gain."""

    constant: float
    resistance: float = 0.0
    source_resistance: float = 0.0


class Friction(NamedTuple):
    """In SI."""

    viscous: float = 0.0
    coulomb: float = 0.0
    stiction: float = 0.0
    load_coefficient: float = 0.0
    load_stiction: float = 0.0
    stribeck_velocity: float = 1.0


class Table(NamedTuple):
    """Further friction at ``speeds`` (k,), which rise from next to zero: ``braking`` (2, k) is what acts against
    positive and against negative motion, both positive where they brake."""

    speeds: FloatArray = np.empty(0)
    braking: FloatArray = np.empty((2, 0))


class Axis(NamedTuple):
    """What moves behind the port. ``cogging`` is (sine, cosine) of its wave number times the position."""

    inertia: float
    motor: Motor
    friction: Friction = Friction()
    table: Table = Table()
    offset: float = 0.0
    cogging: tuple[float, float] = (0.0, 0.0)
    cogging_wave_number: float = 0.0


class Load(NamedTuple):
    """What hangs at the port: its inertia, the amplitude of gravity's exertion, where that is zero, and what a slide
    has to lift anywhere."""

    inertia: float
    gravity: float = 0.0
    gravity_zero: float = 0.0
    weight: float = 0.0


class Loop(NamedTuple):
    """``command = proportional (goal − position) − derivative · velocity`` within ± ``limit``; else it is as logged.

    ``sampled``: the law reads at each instant of the inputs and holds its command to the next; else it acts at once.
    ``switched``: the command is the share of time that the supply is connected.
    """

    closed: bool
    proportional: float
    derivative: float
    limit: float
    sampled: bool = False
    switched: bool = False


class Inputs(NamedTuple):
    """What acts from outside, held from each instant in ``time_s`` to the next; arrays (n,). ``supply`` multiplies the
    command; ``port`` is what the port takes beside the load."""

    time_s: FloatArray
    goal: FloatArray
    command: FloatArray
    supply: FloatArray
    enabled: BoolArray
    port: FloatArray

    def part(self, rows: slice) -> "Inputs":
        """Some of the instants."""
        return Inputs(
            self.time_s[rows],
            self.goal[rows],
            self.command[rows],
            self.supply[rows],
            self.enabled[rows],
            self.port[rows],
        )


class Acting(NamedTuple):
    """Within one step: the exertion at rest without what ``pull`` says of the load, what is lost per velocity, the side
    to which it moves or would, and ``further`` friction against that."""

    driving: float
    braking: float
    pull: float
    side: float
    further: float


@njit(cache=True, nogil=True)
def commanded(loop: Loop, goal: float, position: float, velocity: float) -> float:
    """The law's command."""
    wished = loop.proportional * (goal - position) - loop.derivative * velocity
    return min(max(wished, -loop.limit), loop.limit)


@njit(cache=True, nogil=True)
def electric(motor: Motor, loop: Loop, command: float, supply: float) -> tuple[float, float]:
    """The motor's exertion at rest, and what it loses per velocity."""
    if motor.resistance == 0.0:
        return motor.constant * command * supply, 0.0
    connected = min(abs(command), 1.0) if loop.switched else 0.0
    per_volt = motor.constant / (motor.resistance + motor.source_resistance * connected)
    return per_volt * command * supply, per_volt * motor.constant


@njit(cache=True, nogil=True)
def tabled(table: Table, side: float, speed: float) -> float:
    """The table's friction against motion to one side."""
    speeds, row = table.speeds, table.braking[0 if side > 0.0 else 1]
    node = min(max(int(np.searchsorted(speeds, speed)) - 1, 0), speeds.size - 2)
    share = (speed - speeds[node]) / (speeds[node + 1] - speeds[node])
    return float(row[node] + share * (row[node + 1] - row[node]))


@njit(cache=True, nogil=True)
def next_velocity(
    inertia: float, friction: Friction, acting: Acting, load_inertia: float, velocity: float, dt_s: float
) -> float:
    """The velocity ``dt_s`` later; friction stops a motion and holds it, and does not turn it round."""
    driving, braking, pull, side, further = acting
    left = exp(-((velocity / friction.stribeck_velocity) ** 2))
    coefficient = friction.load_coefficient + friction.load_stiction * left
    constant = friction.coulomb + friction.stiction * left + further
    if velocity == 0.0 and abs(driving - pull) <= constant + coefficient * abs(pull):
        return 0.0
    acceleration = 0.0
    sign = 1.0 if pull > 0.0 else -1.0
    for _ in range(2):
        share = side * sign * coefficient
        push = driving - braking * velocity - side * constant - pull * (1.0 + share)
        acceleration = push / (inertia + dt_s * braking + load_inertia * (1.0 + share))
        if sign * (load_inertia * acceleration + pull) >= 0.0:
            break
        sign = -sign
    after = velocity + dt_s * acceleration
    return 0.0 if after * side < 0.0 else after


@njit(cache=True, nogil=True)
def simulate(
    axis: Axis, load: Load, loop: Loop, inputs: Inputs, position: float, velocity: float, longest_s: float
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
        command = commanded(loop, inputs.goal[k], q, v) if loop.closed and loop.sampled else inputs.command[k]
        for _ in range(steps):
            ahead = q + 0.5 * h * v
            if loop.closed and not loop.sampled:
                command = commanded(loop, inputs.goal[k], ahead, v)
            driving, braking = 0.0, 0.0
            if inputs.enabled[k]:
                driving, braking = electric(axis.motor, loop, command, inputs.supply[k])
            driving -= axis.offset + inputs.port[k]
            if axis.cogging_wave_number != 0.0:
                phase = axis.cogging_wave_number * ahead
                driving -= axis.cogging[0] * sin(phase) + axis.cogging[1] * cos(phase)
            pull = load.weight + load.gravity * sin(ahead - load.gravity_zero)
            side = 1.0 if v > 0.0 or (v == 0.0 and driving > pull) else -1.0
            further = tabled(axis.table, side, abs(v)) if axis.table.speeds.size > 0 else 0.0
            acting = Acting(driving, braking + axis.friction.viscous, pull, side, further)
            after = next_velocity(axis.inertia, axis.friction, acting, load.inertia, v, h)
            q += 0.5 * h * (v + after)
            v = after
        path[k + 1] = q
    return path
