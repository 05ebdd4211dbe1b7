"""Where a velocity settles to while a command is held, and how well that is known (block bootstrap)."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import f as f_distribution
from scipy.stats import t as t_distribution

FloatArray = npt.NDArray[np.float64]

# Each dwell's velocity is looked at in this many pieces, beginning after the command's own transient.
PIECES = 16
SKIPPED_SHARE = 0.25
# The settling time may be this share of what is looked at, from the fastest to be told from none to the slowest that
# shows its end.
SETTLING_SHARES = np.geomspace(0.05, 0.5, 24)
SETTLING_P = 0.01
RESAMPLES = 400
SEED = 6
# Pieces are resampled in runs so long that what lies a run apart hardly correlates any more.
RUNS = (1, 2, 4)
LOW_CORRELATION = 0.2


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


def settled(velocity: FloatArray, span_s: FloatArray) -> Settled:
    """From velocities in pieces (dwells, PIECES); ``span_s`` (dwells,) is how long each dwell's pieces last in all.

    A shaft still approaches its velocity while it is looked at; the approach is taken as exponential with one time
    constant for all dwells, where the data show it at all.
    """
    dwells = len(velocity)
    plain = velocity - velocity.mean(axis=1, keepdims=True)
    costs = [float(np.sum(_remainder(velocity, _design(share)) ** 2)) for share in SETTLING_SHARES]
    best = int(np.argmin(costs))
    freedom = dwells * (PIECES - 2) - 1
    gain = (float(np.sum(plain**2)) - costs[best]) / max(costs[best], 1e-300) * freedom / (dwells + 1)
    shows = bool(f_distribution.sf(gain, dwells + 1, freedom) < SETTLING_P)
    share = float(SETTLING_SHARES[best]) if shows else 0.0
    design = _design(share) if shows else np.ones((PIECES, 1))
    centre = velocity @ np.linalg.pinv(design)[0]
    resampled = _resampled(_remainder(velocity, design), design, share)
    return Settled(centre, centre + resampled, share * float(np.mean(span_s)))


def _design(share: float) -> FloatArray:
    middle = (np.arange(PIECES) + 0.5) / PIECES
    return np.stack([np.ones(PIECES), np.exp(-middle / share)], axis=1)


def _remainder(velocity: FloatArray, design: FloatArray) -> FloatArray:
    return np.asarray(velocity - velocity @ np.linalg.pinv(design).T @ design.T)


def _resampled(remainder: FloatArray, design: FloatArray, share: float) -> FloatArray:
    """Deviations of each dwell's steady velocity: (RESAMPLES, dwells), centred on zero."""
    run = _run(remainder)
    random = np.random.default_rng(SEED)
    starts = random.integers(0, PIECES, (RESAMPLES, len(remainder), -(-PIECES // run)))
    places = (starts[..., None] + np.arange(run)).reshape(RESAMPLES, len(remainder), -1)[..., :PIECES] % PIECES
    drawn = np.take_along_axis(np.broadcast_to(remainder, (RESAMPLES, *remainder.shape)), places, axis=2)
    return np.asarray(_widening(design, share, run) * (drawn @ np.linalg.pinv(design)[0]))


def _widening(design: FloatArray, share: float, run: int) -> float:
    """What a bootstrap of so few pieces misses, for disturbances that wander as slowly as the shaft settles.

    The same inertia and friction that make the shaft settle pass disturbances on as a first-order wander with the same
    time constant; part of it the estimate takes for the steady velocity itself, and what is left has few degrees of
    freedom (Satterthwaite), hence Student's wider tails.
    """
    lag = np.abs(np.subtract.outer(np.arange(PIECES), np.arange(PIECES)))
    wander = np.exp(-lag / (share * PIECES)) if share else np.eye(PIECES)
    inverse = np.linalg.pinv(design)
    left = np.eye(PIECES) - design @ inverse
    seen = left @ wander @ left
    around = (np.arange(PIECES)[:, None] + np.arange(PIECES)) % PIECES
    circular = seen[np.arange(PIECES)[:, None], around].mean(axis=0)
    together = np.subtract.outer(np.arange(PIECES) // run, np.arange(PIECES) // run) == 0
    expected = inverse[0] @ (circular[lag] * together) @ inverse[0]
    freedom = np.trace(seen) ** 2 / np.sum(seen**2)
    student = float(t_distribution.ppf(0.975, max(freedom, 1.0))) / 1.96
    return float(student * np.sqrt(inverse[0] @ wander @ inverse[0] / expected))


def _run(remainder: FloatArray) -> int:
    scatter = max(float(np.mean(remainder**2)), 1e-300)
    for run in RUNS:
        if float(np.mean(remainder[:, run:] * remainder[:, :-run])) < LOW_CORRELATION * scatter:
            return run
    return RUNS[-1]
