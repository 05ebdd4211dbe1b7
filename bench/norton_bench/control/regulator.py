"""The feedback of prescribed motion: least squares of tracking errors against changes of the command.

    minimise Σ (Il Δv / T)² + (Il Δx / T²)² + ρ (Δu)²,     T the time in which an error of position is to be mended

Changes of the command are what costs, so that a standing disturbance leaves no standing error.
"""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.dynamics import POSITION, STATES, VELOCITY, Bench, sampled
from norton_bench.errors import ExperimentError

FREE, FREE_RATE, LOAD = STATES, STATES + 1, STATES + 2
WIDTH = STATES + 3  # deviations from the reference
# Disturbances are random walks to the observer; here they forget slowly, which Riccati's equation needs.
FORGETTING_S = 1.0
# An error of position weighs as much as the error of velocity that mends it in this time.
MENDING_S = 0.01


@dataclass(frozen=True)
class Regulator:
    """Gains on the deviations (WIDTH,) and on the last commands, newest first (commands in flight,)."""

    on_state: FloatArray
    on_commands: FloatArray


def design_regulator(bench: Bench, effort: float, tick_s: float) -> Regulator:
    """``effort`` is √ρ: the error, as a torque, that is worth one newton metre of change within a tick."""
    transition, change = _transition(bench, tick_s)
    errors = np.zeros((2, len(transition)))
    errors[0, VELOCITY] = bench.load_inertia_kgm2 / MENDING_S
    errors[1, POSITION] = bench.load_inertia_kgm2 / MENDING_S**2
    scale = _scale(bench, len(transition))
    f, g, h = transition * scale / scale[:, None], change / scale[:, None], errors * scale / effort
    value = solve_riccati(f, g, h.T @ h)
    gain = np.linalg.solve(np.eye(1) + g.T @ value @ g, g.T @ value @ f)[0] / scale
    return Regulator(gain[:WIDTH], gain[WIDTH:])


def _transition(bench: Bench, tick_s: float) -> tuple[FloatArray, FloatArray]:
    """State (deviations, last commands newest first) from tick to tick, and its input, the change of the command."""
    a5, b5 = bench.matrices()
    a, b = np.zeros((WIDTH, WIDTH)), np.zeros((WIDTH, 1))
    a[:STATES, :STATES], b[:STATES] = a5, b5[:, :1]
    a[:STATES, LOAD], a[:STATES, FREE] = b5[:, 1], b5[:, 2]
    a[FREE, FREE_RATE] = 1.0
    for disturbance in (FREE, FREE_RATE, LOAD):
        a[disturbance, disturbance] = -1.0 / FORGETTING_S
    model = sampled(a, b, tick_s, bench.command_delay_s)
    flow, in_flight = model.flow(tick_s), model.whole + 1
    size = WIDTH + in_flight
    transition, change = np.zeros((size, size)), np.zeros((size, 1))
    transition[:WIDTH, :WIDTH] = flow[:, :WIDTH]
    transition[:WIDTH, WIDTH + model.whole] += flow[:, WIDTH]
    if model.whole:
        transition[:WIDTH, WIDTH + model.whole - 1] += flow[:, WIDTH + 1]
    else:
        transition[:WIDTH, WIDTH] += flow[:, WIDTH + 1]
        change[:WIDTH, 0] = flow[:, WIDTH + 1]
    transition[WIDTH, WIDTH] = change[WIDTH, 0] = 1.0
    transition[WIDTH + 1 :, WIDTH:-1] = np.eye(in_flight - 1)
    return transition, change


def _scale(bench: Bench, size: int) -> FloatArray:
    """Typical sizes, which keep the Riccati equation well conditioned."""
    twist, scale = 1e-2 / bench.stiffness_nm_rad, np.full(size, 1e-2)
    free = 1e-2 / bench.load_inertia_kgm2
    scale[:WIDTH] = [1e-3, 1.0, twist, 300 * twist, 1e-2, free, 100 * free, 1e-2]
    return scale


MOST_DOUBLINGS = 50  # 2**50 ticks: a mode that has not settled by then is not seen, or not moved, at all
SETTLED = 1e-12  # of the largest element; rounding leaves some 1e-14


def solve_riccati(a: FloatArray, b: FloatArray, cost: FloatArray) -> FloatArray:
    """The discrete algebraic Riccati equation, for states that hold a line of past readings or commands.

    X of X = A'XA - A'XB (1 + B'XB)^-1 B'XA + Q, with Q = ``cost``; transposed A and B give an observer's
    covariance.

    By structure-preserving doubling (Chu, Fan, Lin and Wang, International Journal of Control 77, 2004): each round
    doubles the horizon, so some 14 suffice. scipy's ``solve_discrete_are`` gives the same to twelve digits, but its
    reordering of a Schur form gives up on some benches, whose shift of past states makes A singular.

    Raises ExperimentError where it does not settle.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        value = _doubled(a, b @ b.T, cost)
    if value is None:
        raise ExperimentError("no controller can be designed for this calibration; run 'calibrate' again, for longer")
    return value


def _doubled(a: FloatArray, gramian: FloatArray, value: FloatArray) -> FloatArray | None:
    """What the value of a longer and longer horizon settles at; None where it grows for ever."""
    identity = np.eye(len(a))
    for _ in range(MOST_DOUBLINGS):
        solved = np.linalg.solve(identity + gramian @ value, np.hstack([a, gramian]))
        flow, reach = solved[:, : len(a)], solved[:, len(a) :]
        more = a.T @ value @ flow
        gramian = gramian + a @ reach @ a.T
        value, a = value + (more + more.T) / 2, a @ flow
        if not np.isfinite(value).all():
            return None
        if np.max(np.abs(more)) <= SETTLED * np.max(np.abs(value)):
            return value
    return None
