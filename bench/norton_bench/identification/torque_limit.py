"""The greatest torque of a servo's motor, from stretches in which its loop asked for more.

There, torque at the port = ± limit − what moves and rubs, which the fit below the limit has told: a mean over each
visit to the limit is one datum.
"""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.identification.rows import Rows
from norton_bench.identification.separable import Solution
from norton_bench.identification.shape import DAMPING, GAIN, INERTIA, LINEAR
from norton_bench.identification.signals import LIMIT_LASTS_TICKS
from norton_bench.identification.turns import Turns
from norton_bench.models.parameters import BY_NAME, HALF_INTERVAL, Estimate, Status

# What the loop asks for must lie so far beyond the limit that is in the drive: its scale is off by a few per cent.
BEYOND = 1.1
# A limit that holds leaves less than this of what was asked for.
HELD = 0.95
FEWEST_VISITS = 3
# What is taken off the torque at the port, in the order of the regression's columns, and its places among all values.
MOVES_AND_RUBS = ("inertia", "viscous_damping", "coulomb_torque", "presliding_damping")
PLACES = [2, 3, 4, 6]


@dataclass(frozen=True)
class _Visits:
    """``torque_nm`` (n,) that the motor gave, mean of each visit, of what its loop ``asked_nm`` (n,) for.

    ``turning_nm`` (n,) is how much more it seems to be near turns of the shaft than elsewhere in that visit, NaN where
    all of it is either. ``moving`` (n, 4) is the change with inertia, B, τc and σ1.
    """

    torque_nm: FloatArray
    asked_nm: FloatArray
    turning_nm: FloatArray
    moving: FloatArray


def torque_limit(solution: Solution, values: FloatArray, covariance: FloatArray) -> Estimate | None:
    """None where the servo was not at its limit; ``values`` and ``covariance`` as the fit has them, in the order of the
    network's parameters: gain, bandwidth, inertia, B, τc, σ0, σ1."""
    if solution.free_motion or solution.regression.rows[0].signals.servo is None:
        return None
    parts = [_visits(rows, solution, values) for rows in solution.regression.rows]
    visits = _Visits(*(np.concatenate([getattr(part, name) for part in parts]) for name in _Visits.__annotations__))
    count = visits.torque_nm.size
    if count < FEWEST_VISITS:
        return None
    value = float(np.mean(visits.torque_nm))
    if value > HELD * float(np.mean(visits.asked_nm)):
        return None
    scatter = float(np.std(visits.torque_nm, ddof=1)) / np.sqrt(count) * t_quantile(0.975, count - 1) / HALF_INTERVAL
    slope = np.mean(visits.moving, axis=0)
    # The limit knows nothing of turns. What goes with them is an error of friction or of the path, by which either side
    # may be off: the truth is anywhere between the two.
    turning = visits.turning_nm[np.isfinite(visits.turning_nm)]
    between = float(np.mean(turning)) if turning.size else 0.0
    std = float(np.sqrt(scatter**2 + between**2 / 12.0 + slope @ covariance[np.ix_(PLACES, PLACES)] @ slope))
    return Estimate("torque_limit", value, std, BY_NAME["torque_limit"].unit, Status.VALID)


def _visits(rows: Rows, solution: Solution, values: FloatArray) -> _Visits:
    shape, servo = solution.shape, rows.signals.servo
    assert servo is not None
    columns = rows.columns(shape)[: DAMPING + 1]
    asked = columns[GAIN]
    moving = columns[INERTIA : DAMPING + 1]
    torque_nm = rows.torque() - _zero(rows, solution) - values[PLACES] @ moving
    for place, periods in enumerate(solution.regression.cogging):
        pair = solution.linear[len(LINEAR) + 2 * place : len(LINEAR) + 2 * place + 2]
        torque_nm = torque_nm - pair @ rows.cogging(shape, periods)
    spans = _spans(np.abs(asked) > BEYOND * servo.greatest_error)
    sides = [float(np.sign(asked[first])) for first, _ in spans]
    torque = [side * float(np.mean(torque_nm[first:last])) for side, (first, last) in zip(sides, spans, strict=True)]
    near = Turns.of(rows.signals, shape.s_per_rad, LIMIT_LASTS_TICKS).near[:: rows.stride]
    turning = [side * _apart(torque_nm[a:b], near[a:b]) for side, (a, b) in zip(sides, spans, strict=True)]
    wanted = [values[0] * float(np.mean(np.abs(asked[first:last]))) for first, last in spans]
    change = [-side * np.mean(moving[:, a:b], axis=1) for side, (a, b) in zip(sides, spans, strict=True)]
    return _Visits(np.array(torque), np.array(wanted), np.array(turning), np.array(change).reshape(-1, 4))


def _apart(values: FloatArray, near: BoolArray) -> float:
    """The mean of some values (n,) less that of the others; NaN where there are no others."""
    return float(np.mean(values[near]) - np.mean(values[~near])) if near.any() and not near.all() else float("nan")


def _zero(rows: Rows, solution: Solution) -> FloatArray:
    """Of the torque sensor, at every instant."""
    regression = solution.regression
    wanders = solution.linear[len(LINEAR) + 2 * len(regression.cogging) :] @ regression.bias()
    return np.asarray(np.interp(rows.signals.time_s[:: rows.stride], regression.time_s(), wanders))


def _spans(beyond: BoolArray) -> list[tuple[int, int]]:
    """First and last of each visit, without its edges, where filters and delays reach below the limit."""
    edges = np.flatnonzero(np.diff(beyond.astype(np.int8), prepend=0, append=0))
    inner = ((first + LIMIT_LASTS_TICKS, last - LIMIT_LASTS_TICKS) for first, last in edges.reshape(-1, 2))
    return [(int(first), int(last)) for first, last in inner if last > first]
