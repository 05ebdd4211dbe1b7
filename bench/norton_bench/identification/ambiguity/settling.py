"""The zero dynamics as they are seen: how the port settles after each step of the command, with no torque on it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.distributions import f_tail
from norton_bench.identification.model_free.branches import PIECES, pieces_of
from norton_bench.identification.model_free.source_map import LEAST_READINGS, dwells, is_staircase
from norton_bench.records import Measured

Interval = tuple[float, float]

# The time constant may be this share of a dwell, from what shows in one piece to what hardly bends over all of them.
SHARES = np.geomspace(0.02, 1.0, 160)
# Chance gives the approach that is fitted so much less often than this.
SEEN_P = 0.01
RESAMPLES = 400
SEED = 8
QUARTER = PIECES // 4
TAILS = (0.025, 0.975)


@dataclass(frozen=True)
class Settling:
    """Over all steps: the time constant, and how much of a step's change still comes in the last quarter of its dwell.

    ``left`` is near 0 where the port comes to rest on its source, near 1 or above where it does not. Intervals are of
    95 %, from steps drawn anew. ``time_s`` is 0 where the approach is too fast to be seen.
    """

    steps: int
    dwell_s: float
    time_s: float
    time_interval_s: Interval
    left: float
    left_interval: Interval


def settling(measured: Measured) -> Settling | None:
    """From the staircases of the free port; None where there are none."""
    velocity, spans_s, follows = _dwells(measured)
    if len(velocity) < 2:
        return None
    draws = np.random.default_rng(SEED).integers(0, len(velocity), (RESAMPLES, len(velocity)))
    end = velocity[:, -QUARTER:].mean(axis=1)
    late = end - velocity[:, -2 * QUARTER : -QUARTER].mean(axis=1)
    # What a first level steps from was not dwelt on.
    squares = np.stack([late**2, np.diff(end, prepend=end[:1]) ** 2]) * follows
    left = _rms_ratio(squares.sum(axis=1))
    left_drawn = _rms_ratio(squares[:, draws].sum(axis=2))
    dwell_s = float(np.mean(spans_s))
    share, shares_drawn = _time_shares(velocity, draws)
    return Settling(
        steps=len(velocity),
        dwell_s=dwell_s,
        time_s=share * dwell_s,
        time_interval_s=_interval(shares_drawn * dwell_s),
        left=float(left),
        left_interval=_interval(left_drawn),
    )


def _dwells(measured: Measured) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Velocity in pieces (dwells, PIECES) from each dwell's very beginning; how long it lasts; 1 where one came before.

    The latter two are of shape (dwells,).
    """
    pieces, spans_s, follows = [], [], []
    for segment in filter(is_staircase, measured.segments):
        for place, (_, start_ns, end_ns) in enumerate(dwells(measured.ticks, segment)):
            first, last = np.searchsorted(measured.motion["arrival_ns"], [start_ns, end_ns])
            rows = measured.motion[first:last]
            if len(rows) >= LEAST_READINGS:
                time_s = (rows["arrival_ns"] - rows["arrival_ns"][0]) * 1e-9
                pieces.append(pieces_of(time_s, rows["position_rad"]))
                spans_s.append(float(time_s[-1]))
                follows.append(float(place > 0))
    return np.array(pieces), np.array(spans_s), np.array(follows)


def _time_shares(velocity: FloatArray, draws: npt.NDArray[np.int64]) -> tuple[float, FloatArray]:
    """The time constant as a share of the dwell, and as other steps might have given it; zeros where none shows."""
    middle = (np.arange(PIECES) + 0.5) / PIECES
    costs = np.stack([_cost(velocity, np.exp(-middle / share)) for share in SHARES], axis=1)
    plain = float(np.sum((velocity - velocity.mean(axis=1, keepdims=True)) ** 2))
    total = costs.sum(axis=0)
    steps, best = len(velocity), int(np.argmin(total))
    freedom = steps * (PIECES - 2) - 1
    gain = (plain - total[best]) / max(total[best], 1e-300) * freedom / (steps + 1)
    if f_tail(gain, steps + 1, freedom) >= SEEN_P:
        return 0.0, np.zeros(len(draws))
    return float(SHARES[best]), SHARES[np.argmin(costs[draws].sum(axis=1), axis=1)]


def _cost(velocity: FloatArray, approach: FloatArray) -> FloatArray:
    """What a constant and an approach of this shape leave of each dwell: sums of squares (dwells,)."""
    design = np.stack([np.ones(PIECES), approach], axis=1)
    left = velocity - velocity @ np.linalg.pinv(design).T @ design.T
    return np.asarray(np.sum(left**2, axis=1))


def _rms_ratio(sums: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(sums[0] / np.maximum(sums[1], 1e-300)))


def _interval(draws: FloatArray) -> Interval:
    low, high = np.quantile(draws, TAILS)
    return float(low), float(high)
