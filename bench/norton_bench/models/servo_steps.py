"""A servo's loop in a network: what it asks of its amplifier, from where the shaft was; compiled.

The angle counts as it was a delay ago, and the velocity comes from two angles a window apart (norton_drivers.servo).
"""

import numpy as np
from numba import njit

from norton_bench.arrays import FloatArray

# How a loop works: what share of the angle it takes off the command, and how much of the velocity; delay and window
# [s]; and the error that its limit lets through, in the command's unit.
Loop = tuple[float, float, float, float, float]


@njit(cache=True, nogil=True)
def asked(command: float, angle: float, earlier: float, loop: Loop) -> float:
    """What the amplifier is asked for, as an error; ``earlier`` is the angle a window before ``angle``."""
    of_angle, of_velocity, _, window, limit = loop
    error = command - of_angle * angle - of_velocity / window * (angle - earlier)
    return float(min(max(error, -limit), limit))


@njit(cache=True, nogil=True)
def moving_evenly(size: int, position: float, step: float) -> FloatArray:
    """A ring of angles whose first is ``position``, after a motion by the same ``step`` each."""
    ring = np.empty(size)
    for k in range(size):
        ring[-k % size] = position - k * step
    return ring


@njit(cache=True, nogil=True)
def before(history: FloatArray, newest: int, position: float, velocity: float, steps: float, step_s: float) -> float:
    """The angle so many ``steps`` ago, straight between those of ``history``, a ring whose ``newest`` is ``position``;
    a part of a step ahead where that is negative."""
    if steps <= 0.0:
        return position - velocity * steps * step_s
    whole = min(int(steps), history.size - 2)
    later = history[(newest - whole) % history.size]
    return float(later + (steps - whole) * (history[(newest - whole - 1) % history.size] - later))


@njit(cache=True, nogil=True)
def asked_in_step(
    command: float,
    history: FloatArray,
    newest: int,
    position: float,
    velocity: float,
    step_s: float,
    loop: Loop,
) -> float:
    """What the amplifier is asked for in the middle of the step that begins at ``position``, the ``newest`` of
    history."""
    ago = loop[2] / step_s - 0.5
    now = before(history, newest, position, velocity, ago, step_s)
    earlier = before(history, newest, position, velocity, ago + loop[3] / step_s, step_s)
    return asked(command, now, earlier, loop)


@njit(cache=True, nogil=True)
def between(values: FloatArray, at: float) -> float:
    """A signal at any place between its samples (n,), by the cubic through four of them; the ends are held."""
    last = values.size - 1
    place = min(max(at, 0.0), float(last))
    k = min(int(place), last - 1)
    x = place - k
    a, b, c, d = values[max(k - 1, 0)], values[k], values[k + 1], values[min(k + 2, last)]
    cubic = 2.0 * a - 5.0 * b + 4.0 * c - d + x * (3.0 * (b - c) + d - a)
    return float(b + 0.5 * x * (c - a + x * cubic))


@njit(cache=True, nogil=True)
def shifted(values: FloatArray, places: float) -> FloatArray:
    """``values`` (n,) so many places further on, by the same cubics: by straight lines, two places near each other
    would differ as in the middle between two samples."""
    output = np.empty(values.size)
    for k in range(values.size):
        output[k] = between(values, k + places)
    return output


@njit(cache=True, nogil=True)
def lagged(
    command: FloatArray,
    position: FloatArray,
    bandwidth: float,
    tick_s: float,
    substeps: int,
    loop: Loop,
    start: float,
) -> FloatArray:
    """Behind the amplifier's lag, at every tick (n,), of a motion known at the ticks; the command is held.

    ``start`` is the lag at the first tick.
    """
    delay, window = loop[2] / tick_s, loop[3] / tick_s
    output, state = np.empty(command.size), start
    decay = np.exp(-bandwidth * tick_s / substeps)
    for k in range(command.size):
        output[k] = state
        for step in range(substeps):
            at = k + (step + 0.5) / substeps - delay
            error = asked(command[k], between(position, at), between(position, at - window), loop)
            state = error + (state - error) * decay
    return output
