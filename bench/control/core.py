"""The controller's arithmetic of one tick, compiled: the running observer and the Dahl contact.

Arrays, newest first: ``states`` (past + 1, width) at this and the last ticks; ``inputs`` (past + 1, 3), of which row i
acts from the tick of ``states[i]`` on: command in force, next command, known torque on the load.
"""

from math import ceil, exp

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def slide(force, displacement, coulomb, stiffness):  # type: ignore[no-untyped-def]
    """The Dahl contact's exact flow over a displacement [rad]: its force σ0 φ [N m] afterwards."""
    if displacement == 0.0:
        return force
    end = coulomb if displacement > 0.0 else -coulomb
    return end + (force - end) * exp(-stiffness * abs(displacement) / coulomb)


@njit(cache=True, nogil=True)
def friction(force, velocity, law):  # type: ignore[no-untyped-def]
    """Friction torque [N m] at a velocity, given the contact's force; ``law`` is (B, τc, σ0, σ1)."""
    return force + law[3] * (velocity - abs(velocity) * force / law[1]) + law[0] * velocity


@njit(cache=True, nogil=True)
def correct(states, inputs, readings, delays, fresh, tick, rows, gain):  # type: ignore[no-untyped-def]
    """Correct the states by the readings that are fresh, of triples; ``delays`` [s] say when each was true."""
    past, width = states.shape[0] - 1, states.shape[1]
    innovation = np.zeros(3)
    for output in range(3):
        ticks = delays[output] / tick
        back = max(1, ceil(ticks - 1e-9))
        if fresh[output] and back <= past:
            row = rows[round((back - ticks) * (rows.shape[0] - 1)), output]
            expected = 0.0
            for i in range(width):
                expected += row[i] * states[back, i]
            for i in range(inputs.shape[1]):
                expected += row[width + i] * inputs[back, i]
            innovation[output] = readings[output] - expected
    for age in range(past + 1):
        for i in range(width):
            for output in range(3):
                states[age, i] += gain[age * width + i, output] * innovation[output]


@njit(cache=True, nogil=True)
def sense(states, inputs, contact, readings, delays, fresh, tick, rows, gain, law, position):  # type: ignore[no-untyped-def]
    """Take in one tick's readings, and let the contact slide by what the shaft has turned (at row ``position``).

    ``contact`` is its force and the position up to which that holds.
    """
    correct(states, inputs, readings, delays, fresh, tick, rows, gain)
    contact[0] = slide(contact[0], states[0, position] - contact[1], law[1], law[2])
    contact[1] = states[0, position]


@njit(cache=True, nogil=True)
def predict(states, inputs, step):  # type: ignore[no-untyped-def]
    """Move every state one tick on, under ``inputs[0]``."""
    width = states.shape[1]
    new = np.zeros(width)
    for i in range(width):
        for j in range(width):
            new[i] += step[i, j] * states[0, j]
        for j in range(inputs.shape[1]):
            new[i] += step[i, width + j] * inputs[0, j]
    for age in range(states.shape[0] - 1, 0, -1):
        states[age] = states[age - 1]
        inputs[age] = inputs[age - 1]
    states[0] = new


@njit(cache=True, nogil=True)
def put_first(values, newest):  # type: ignore[no-untyped-def]
    """Move ``values`` one place on, ``newest`` to the front."""
    for i in range(values.size - 1, 0, -1):
        values[i] = values[i - 1]
    values[0] = newest


@njit(cache=True, nogil=True)
def advance(states, inputs, contact, commands, command, law, step, velocity):  # type: ignore[no-untyped-def]
    """Let one tick pass with ``command`` sent; the last two of ``commands`` are those that act in it."""
    put_first(commands, command)
    inputs[0, 0], inputs[0, 1] = commands[-1], commands[-2]
    inputs[0, 2] = -friction(contact[0], states[0, velocity], law)
    predict(states, inputs, step)


@njit(cache=True, nogil=True)
def feedback(deviation, commands, shares, on_state, on_commands):  # type: ignore[no-untyped-def]
    """Gains times deviations, those of the commands from their feed-forward shares included."""
    total = 0.0
    for i in range(deviation.size):
        total += on_state[i] * deviation[i]
    for i in range(on_commands.size):
        total += on_commands[i] * (commands[i] - shares[i + 1])
    return total
