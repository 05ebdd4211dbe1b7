"""What the branches of a measured source map say: velocity at any command, the dead zone, hysteresis."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from norton_bench.arrays import FloatArray
from norton_bench.distributions import f_tail

# Each dwell's velocity is looked at in this many pieces, beginning after the command's own transient.
PIECES = 16
SKIPPED_SHARE = 0.25
# The settling time may be this share of what is looked at, from the fastest to be told from none to the slowest that
# shows its end. Chance gives one that is told from none so much less often than the level named.
SETTLING_SHARES = np.geomspace(0.05, 0.5, 96)
SETTLING_P = 0.01
RESAMPLES = 400
SEED = 6


# Where a velocity settles to while a command is held, and how well that is known.
#
# While the shaft still approaches its steady velocity v∞, and while a torque e · B acts on it, inertia and damping
# make its velocity follow
#
# v + T dv/dt = v∞ − e + d, T = I / B
#
# So v + T dv/dt + e says v∞ at every instant, whatever approach or disturbance is under way; what is left, d, is what
# disturbs the shaft unseen, and the torque sensor's noise. Unlike the velocity itself it does not wander.
@dataclass(frozen=True)
class Approach:
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


def settled(velocity: FloatArray, span_s: FloatArray, lost: FloatArray | None = None) -> Approach:
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
    return Approach(centre, drawn, share * float(np.mean(span_s)))


def _settling_share(velocity: FloatArray) -> float:
    """Settling time over the span of a dwell; 0 where it cannot be told from none.

    The approach is taken as exponential, with one time constant for all dwells.
    """
    freedom = len(velocity) * (PIECES - 2) - 1
    plain = float(np.sum((velocity - velocity.mean(axis=1, keepdims=True)) ** 2))
    costs = [_cost(velocity, share) for share in SETTLING_SHARES]
    best = int(np.argmin(costs))
    gain = (plain - costs[best]) / max(costs[best], 1e-300) * freedom / (len(velocity) + 1)
    shows = f_tail(gain, len(velocity) + 1, freedom) < SETTLING_P
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


Interval = tuple[float, float]

# Slower than this share of the fastest level counts as rest.
REST_SHARE = 0.005
# And so does what its own deviation does not tell from rest.
REST_DEVIATIONS = 3.0
TAILS = (0.025, 0.975)
UNKNOWN = (float("nan"), float("nan"))


@dataclass(frozen=True)
class DeadZone:
    """The commands between which the shaft rests, with 95 % intervals, in the command's unit."""

    low: float
    high: float
    width: float
    low_interval: Interval
    high_interval: Interval
    width_interval: Interval


@dataclass(frozen=True)
class Hysteresis:
    """The greatest difference, rising less falling, between the two branches at one command.

    ``band_rad_s`` is what chance gives to the greatest of all levels 95 times in 100, at this level.
    """

    command: float
    difference_rad_s: float
    band_rad_s: float

    @property
    def significant(self) -> bool:
        return abs(self.difference_rad_s) > self.band_rad_s


def monotone(command: FloatArray, velocity: FloatArray) -> "scipy.interpolate.PchipInterpolator":
    """The monotonic curve next to the points (their order does not matter); NaN outside them.

    Raises ValueError for fewer than two different commands.
    """
    levels, place = np.unique(command, return_inverse=True)
    if levels.size < 2:
        raise ValueError("a branch needs at least two levels of command")
    count = np.bincount(place).astype(float)
    mean = np.bincount(place, velocity) / count
    increasing = bool(np.dot(levels - levels.mean(), mean) >= 0)
    return scipy.interpolate.PchipInterpolator(
        levels, scipy.optimize.isotonic_regression(mean, weights=count, increasing=increasing).x, extrapolate=False
    )


def dead_zone(command: FloatArray, velocity: FloatArray, draws: FloatArray) -> DeadZone | None:
    """Of one branch; ``draws`` (resamples, levels) gives the intervals. None where a side never leaves rest.

    Each edge is where the line through the two slowest moving levels meets zero, never outside the gap between the
    last resting level and the first moving one; with one moving level alone, the gap itself is all that is known.
    """
    order = np.argsort(command)
    levels, values, drawn = command[order], velocity[order], draws[:, order]
    deviation = np.std(drawn, axis=0) if len(drawn) else np.zeros_like(values)
    rest = resting(values, deviation)
    direction = 1.0 if np.dot(levels - levels.mean(), values) >= 0 else -1.0
    forward = np.flatnonzero(~rest & (direction * values > 0))
    backward = np.flatnonzero(~rest & (direction * values < 0))[::-1]
    if not forward.size or not backward.size or forward[0] <= backward[0]:
        return None
    # Where nothing rests, the first level that moves the other way ends the gap.
    above, below = max(forward[0] - 1, backward[0]), min(backward[0] + 1, forward[0])
    high = _edge(levels, np.vstack([values, drawn]), forward[:2], above)
    low = _edge(levels, np.vstack([values, drawn]), backward[:2], below)
    width = np.maximum(high - low, 0.0)
    return DeadZone(
        float(low[0]), float(high[0]), float(width[0]), _interval(low[1:]), _interval(high[1:]), _interval(width[1:])
    )


def resting(velocity: FloatArray, deviation: FloatArray) -> npt.NDArray[np.bool_]:
    """At which levels the shaft rests, as far as can be told; all of shape (levels,)."""
    return np.asarray(
        np.abs(velocity) <= np.maximum(REST_SHARE * np.max(np.abs(velocity)), REST_DEVIATIONS * deviation)
    )


def hysteresis(rising: tuple[FloatArray, ...], falling: tuple[FloatArray, ...]) -> Hysteresis | None:
    """Of two branches, each (command, velocity, draws); None where they share no command or nothing gives a band."""
    if not rising[0].size or not falling[0].size:
        return None
    command, at_rising, at_falling = np.intersect1d(
        _rounded(rising[0], falling[0]), _rounded(falling[0], rising[0]), return_indices=True
    )
    if not command.size or not len(rising[2]):
        return None
    difference = rising[1][at_rising] - falling[1][at_falling]
    drawn = rising[2][:, at_rising] - falling[2][:, at_falling]
    deviation = np.maximum(np.std(drawn, axis=0), 1e-300)
    share = np.abs(drawn - drawn.mean(axis=0)) / deviation
    greatest = int(np.argmax(np.abs(difference) / deviation))
    limit = float(np.quantile(np.max(share, axis=1), 0.95))
    return Hysteresis(
        float(rising[0][at_rising[greatest]]), float(difference[greatest]), limit * float(deviation[greatest])
    )


def _rounded(command: FloatArray, other: FloatArray) -> npt.NDArray[np.int64]:
    """Commands as whole numbers of a ten-thousandth of the greatest: the same level may differ in its last digit."""
    unit = 1e-4 * max(float(np.max(np.abs(command))), float(np.max(np.abs(other))), 1e-300)
    return np.round(command / unit).astype(np.int64)


def _edge(levels: FloatArray, values: FloatArray, moving: npt.NDArray[np.intp], gap_end: int) -> FloatArray:
    """Where the velocity sets in, for each row of ``values``."""
    near, end = levels[moving[0]], levels[gap_end]
    if moving.size < 2:
        # Anything within the gap will do as well: an even spread of it, the middle first.
        return np.concatenate([[0.5 * (near + end)], np.linspace(min(near, end), max(near, end), len(values) - 1)])
    first, second = values[:, moving[0]], values[:, moving[1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        edge = near - first * (levels[moving[1]] - near) / (second - first)
    return np.asarray(np.clip(np.nan_to_num(edge, nan=end), min(near, end), max(near, end)))


def _interval(draws: FloatArray) -> Interval:
    if not draws.size:
        return UNKNOWN
    low, high = np.quantile(draws, TAILS)
    return float(low), float(high)
