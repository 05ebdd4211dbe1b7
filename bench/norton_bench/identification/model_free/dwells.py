"""Where a velocity settles to while a command is held, and how well that is known.

While the shaft still approaches its steady velocity v∞, and while a torque e · B acts on it, inertia and damping make
its velocity follow

    v + T dv/dt = v∞ − e + d,        T = I / B

So v + T dv/dt + e says v∞ at every instant, whatever approach or disturbance is under way; what is left, d, is what
disturbs the shaft unseen, and the torque sensor's noise. Unlike the velocity itself it does not wander.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from norton_bench.arrays import FloatArray

# Each dwell's velocity is looked at in this many pieces, beginning after the command's own transient.
PIECES = 16
SKIPPED_SHARE = 0.25
# The settling time may be this share of what is looked at, from the fastest to be told from none to the slowest that
# shows its end. Chance gives one that is told from none so much less often than the level named.
SETTLING_SHARES = np.geomspace(0.05, 0.5, 96)
SETTLING_P = 0.01
RESAMPLES = 400
SEED = 6


@dataclass(frozen=True)
class Settled:
    """Steady velocities (dwells,), as they might have come out (resamples, dwells), and the settling time, 0: none."""

    velocity: FloatArray
    resampled: FloatArray
    settling_s: float


def pieces_of(time_s: FloatArray, position: FloatArray) -> FloatArray:
    """Mean velocity in each of PIECES equal parts, from positions: no drive's own filter stands in between."""
    edges = np.linspace(0, len(time_s), PIECES + 1).astype(int)
    velocity = np.empty(PIECES)
    for k in range(PIECES):
        part = slice(edges[k], edges[k + 1])
        t = time_s[part] - time_s[part].mean()
        velocity[k] = t @ position[part] / (t @ t)
    return velocity


def settled(velocity: FloatArray, span_s: FloatArray, lost: FloatArray | None = None) -> Settled:
    """From velocities in pieces (dwells, PIECES); ``span_s`` (dwells,) is how long each dwell's pieces last in all.

    ``lost`` (dwells, PIECES) is the velocity that torque at the port took from the shaft, steadily: e above. Only inner
    pieces count: they have a neighbour on both sides.
    """
    share = _settling_share(velocity)
    taken = np.zeros_like(velocity) if lost is None else lost
    # In steps of a piece h. Of an exponential approach the difference of neighbours is sinh(h / T) of it.
    time = 1 / PIECES / np.sinh(1 / PIECES / share) if share else 0.0
    rate = (velocity[:, 2:] - velocity[:, :-2]) * PIECES / 2
    inner = (velocity + taken)[:, 1:-1] + time * rate
    centre, left = inner.mean(axis=1), inner - inner.mean(axis=1, keepdims=True)
    count = left.shape[1]
    deviation = np.sqrt(np.sum(left**2, axis=1) / (count - 1) / count * _alike(left))
    random = np.random.default_rng(SEED)
    drawn = centre + deviation * random.standard_t(count - 1, (RESAMPLES, len(velocity)))
    return Settled(centre, drawn, share * float(np.mean(span_s)))


def _settling_share(velocity: FloatArray) -> float:
    """Settling time over the span of a dwell; 0 where it cannot be told from none.

    The approach is taken as exponential, with one time constant for all dwells.
    """
    freedom = len(velocity) * (PIECES - 2) - 1
    plain = float(np.sum((velocity - velocity.mean(axis=1, keepdims=True)) ** 2))
    costs = [_cost(velocity, share) for share in SETTLING_SHARES]
    best = int(np.argmin(costs))
    gain = (plain - costs[best]) / max(costs[best], 1e-300) * freedom / (len(velocity) + 1)
    shows = f_distribution.sf(gain, len(velocity) + 1, freedom) < SETTLING_P
    return float(SETTLING_SHARES[best]) if shows else 0.0


def _cost(velocity: FloatArray, share: float) -> float:
    """What a constant and an approach leave of all dwells: the sum of squares."""
    middle = (np.arange(PIECES) + 0.5) / PIECES
    design = np.stack([np.ones(PIECES), np.exp(-middle / share)], axis=1)
    return float(np.sum((velocity - velocity @ np.linalg.pinv(design).T @ design.T) ** 2))


def _alike(left: FloatArray) -> float:
    """What neighbours that are alike add to the variance of a mean, as in a first-order process; never below 1."""
    power = max(float(np.sum(left**2)), 1e-300)
    # A mean that is taken off makes neighbours unlike by one over their number.
    alike = float(np.sum(left[:, 1:] * left[:, :-1])) / power + 1 / left.shape[1]
    alike = min(max(alike, 0.0), 0.9)
    return float((1 + alike) / (1 - alike))
