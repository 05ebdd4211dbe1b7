"""The discrete algebraic Riccati equation, for states that hold a line of past readings or commands."""

import numpy as np

from norton_bench.control.dynamics import FloatArray
from norton_bench.errors import ExperimentError

MOST_DOUBLINGS = 50  # 2**50 ticks: a mode that has not settled by then is not seen, or not moved, at all
SETTLED = 1e-12  # of the largest element; rounding leaves some 1e-14


def solve_riccati(a: FloatArray, b: FloatArray, cost: FloatArray) -> FloatArray:
    """X of X = A'XA - A'XB (1 + B'XB)^-1 B'XA + Q, with Q = ``cost``; transposed A and B give an observer's covariance.

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
