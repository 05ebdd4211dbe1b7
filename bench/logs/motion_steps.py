"""The compiled simulation of a log's motion: one axis with friction of velocity alone, in a loop or driven openly.

Kept apart because it is compiled: see bench/identification/loops.py.
"""

from math import cos, sin
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]

SUBSTEPS = 4


class Machine(NamedTuple):
    """One axis in SI. ``speed`` (k,) rises from next to zero; ``braking`` (2, k) is friction against positive and
    negative motion at these speeds, both positive where they brake. ``gravity`` and ``cogging`` are (sine, cosine)."""

    inertia: float
    gain: float
    speed: FloatArray
    braking: FloatArray
    weight: float
    gravity: FloatArray
    cogging: FloatArray
    cogging_wave_number: float


class Law(NamedTuple):
    """``command = proportional (goal − position) − derivative · velocity`` within ± ``limit``; else it is as logged."""

    closed: bool
    proportional: float
    derivative: float
    limit: float


class Inputs(NamedTuple):
    """What acts from outside at every sample, arrays (n,). ``supply`` multiplies the command; it is 0 while off."""

    command: FloatArray
    goal: FloatArray
    supply: FloatArray
    port: FloatArray
    offset: FloatArray


@njit(cache=True, nogil=True)
def braking_at(machine: Machine, side: int, speed: float) -> float:
    """Friction at ``speed`` on one side, from the table."""
    table = machine.speed
    node = min(max(int(np.searchsorted(table, speed)) - 1, 0), table.size - 2)
    share = (speed - table[node]) / (table[node + 1] - table[node])
    braking = machine.braking[side]
    return float(braking[node] + share * (braking[node + 1] - braking[node]))


@njit(cache=True, nogil=True)
def simulate(machine: Machine, law: Law, inputs: Inputs, position: float, velocity: float, dt_s: float) -> FloatArray:
    """Position at every sample, shape (n,). A command is held from one sample to the next."""
    count = inputs.command.size
    path = np.empty(count)
    q, v, h = position, velocity, dt_s / SUBSTEPS
    for k in range(count):
        path[k] = q
        command = inputs.command[k]
        if law.closed:
            wished = law.proportional * (inputs.goal[k] - q) - law.derivative * v
            command = min(max(wished, -law.limit), law.limit)
        driving = machine.gain * command * inputs.supply[k] - inputs.port[k] - inputs.offset[k] - machine.weight
        for _ in range(SUBSTEPS):
            phase = machine.cogging_wave_number * q
            push = driving - machine.gravity[0] * sin(q) - machine.gravity[1] * cos(q)
            push -= machine.cogging[0] * sin(phase) + machine.cogging[1] * cos(phase)
            if v == 0.0 and -braking_at(machine, 1, 0.0) <= push <= braking_at(machine, 0, 0.0):
                continue
            forward = v > 0.0 or (v == 0.0 and push > 0.0)
            friction = braking_at(machine, 0, v) if forward else -braking_at(machine, 1, -v)
            faster = v + h * (push - friction) / machine.inertia
            # Friction stops a motion; it does not turn it round.
            faster = 0.0 if faster * v < 0.0 else faster
            q += 0.5 * h * (v + faster)
            v = faster
    return path
