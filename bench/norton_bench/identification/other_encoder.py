"""How great an encoder's errors are in a fit's band, as the other machine's encoder tells it.

Both turn with one shaft, and their errors have nothing in common. Of the accelerations a and z that they show, the mean
of a (a - z) is the energy of a's own errors (an instrumental variable: Wright, 1928; Söderström, Errors-in-Variables
Methods in System Identification, 2018, ch. 6): whatever they come from, and whether they hide behind counts or not. The
twist of the sensor between both, which its torque tells, and the difference of the delays are taken off by least
squares.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.counts import UNIFORM_DEVIATION
from norton_bench.identification.rows import Rows
from norton_bench.identification.shape import STILL

# The delays' difference moves one against the other; found from slopes, it is exact after the second round.
ROUNDS = 3
# Means of blocks of this length, in which encoders' errors have long forgotten what they were, are independent.
BLOCK_S = 0.5
FEWEST_BLOCKS = 10
# Deviations. What differs by more than this is no encoder's error: the two do not turn as one shaft.
IMPLAUSIBLE = 3.0


def with_errors_seen(rows: tuple[Rows, ...]) -> tuple[Rows, ...]:
    """The rows of a regression, each with the density of its encoder's errors as far as another encoder tells it."""
    factor = position_noise_factor([each for each in rows if each.signals.other_rad is not None])
    if factor == 1.0:
        return rows
    return tuple(
        replace(each, signals=replace(each.signals, position_noise=factor * each.signals.position_noise))
        for each in rows
    )


def position_noise_factor(rows: Sequence[Rows]) -> float:
    """How many times the density that readings alone tell is the true one, in the rows' band, on average.

    Noise of as much as the counts' own errors may hide behind counts: that is the deviation of what readings tell, and
    the two are weighed by their variances. It is 1 where there are no counts, or another encoder tells nothing.
    """
    means = _block_means(rows)
    if means.size < FEWEST_BLOCKS:
        return 1.0
    weights = [each.usable.size for each in rows]
    assumed = float(np.average([each.motion_noise(2) for each in rows], weights=weights))
    hidden = float(np.average([_of_counts(each) for each in rows], weights=weights))
    seen, std = float(np.mean(means)), float(np.std(means, ddof=1) / np.sqrt(means.size))
    if hidden == 0.0 or abs(seen - assumed) > IMPLAUSIBLE * np.hypot(hidden, std):
        return 1.0
    return max(1.0 + (seen / assumed - 1.0) * hidden**2 / (hidden**2 + std**2), 0.0)


def _of_counts(rows: Rows) -> float:
    """Variance of the acceleration that comes of errors anywhere within a count."""
    signals = rows.signals
    density = (UNIFORM_DEVIATION * signals.count_rad) ** 2 * signals.position_period_s
    return density / signals.position_noise * rows.motion_noise(2) if density > 0.0 else 0.0


def _block_means(rows: Sequence[Rows]) -> FloatArray:
    """Of a (a - z) without twist and delay, (blocks,)."""
    shift_s, products = 0.0, [np.empty(0)]
    for _ in range(ROUNDS if rows else 0):
        parts = [_accelerations(each, shift_s) for each in rows]
        own, other, *columns = np.concatenate(parts, axis=1)
        slopes = np.linalg.lstsq(np.stack(columns, axis=1), own - other, rcond=None)[0]
        products = [part[0] * (part[0] - part[1] - slopes @ part[2:]) for part in parts]
        shift_s += float(slopes[0])
    return np.concatenate([_means(each, rows[0]) for each in products])


def _accelerations(rows: Rows, shift_s: float) -> FloatArray:
    """Of both encoders, the other's jerk, the torque's second and third derivative (which its delay and the sensor's
    damping add), (5, samples)."""
    assert rows.signals.other_rad is not None
    other = rows.derivatives(rows.signals.other_rad, (2, 3), shift_s)
    return np.stack([rows.kinematics(STILL)[1], *other, *rows.torque_derivatives((2, 3))])[:, rows.usable]


def _means(values: FloatArray, rows: Rows) -> FloatArray:
    length = max(1, round(BLOCK_S / (rows.signals.tick_s * rows.stride)))
    return np.asarray(values[: values.size // length * length].reshape(-1, length).mean(axis=1))
