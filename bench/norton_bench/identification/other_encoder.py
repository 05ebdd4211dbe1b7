"""How great an encoder's errors are in a fit's band, as the other machine's encoder tells it.

Both turn with one shaft, and their errors have nothing in common. Of the accelerations a and z that they show, the mean
of a (a - z) is the energy of a's own errors, whatever they come from and whether they hide behind counts or not
(instrumental variables: Söderström, Errors-in-Variables Methods in System Identification, 2018, ch. 6). Before, z is
moved by the difference of both delays, and the twist of the sensor between both is taken off: it goes with the torque,
as the angles themselves tell best.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.counts import UNIFORM_DEVIATION
from norton_bench.identification.rows import Rows

# Of the square of the acceleration: less changes no inertia by more than this.
NEGLIGIBLE = 1e-4
# Over this time encoders' errors have long forgotten what they were.
BLOCK_S = 0.5
FEWEST_BLOCKS = 10
# Of the squares of the velocities' difference and their sum: they are equal where one of both stands still.
MOST_APART = 0.1
# Deviations. What differs by more than this is no encoder's error.
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
    sizes = [each.usable.size for each in rows]
    assumed, hidden = (
        float(np.average(each, weights=sizes)) if rows else 0.0
        for each in ([each.motion_noise(2) for each in rows], [_of_counts(each) for each in rows])
    )
    told = _told(rows) if hidden > NEGLIGIBLE * _acceleration_square(rows) else None
    if told is None:
        return 1.0
    energy, std = told
    if abs(energy - assumed) > IMPLAUSIBLE * np.hypot(hidden, std):
        return 1.0
    return max(1.0 + (energy / assumed - 1.0) * hidden**2 / (hidden**2 + std**2), 0.0)


def _acceleration_square(rows: Sequence[Rows]) -> float:
    """In the mean; 0 without rows."""
    parts = [each.derivatives_of_motion((2,))[0, each.usable] for each in rows]
    return float(np.mean(np.concatenate(parts) ** 2)) if parts else 0.0


def _of_counts(rows: Rows) -> float:
    """Variance of the acceleration that comes of errors anywhere within a count."""
    signals = rows.signals
    density = (UNIFORM_DEVIATION * signals.count_rad) ** 2 * signals.position_period_s
    return density / signals.position_noise * rows.motion_noise(2) if density > 0.0 else 0.0


@dataclass(frozen=True)
class _Products:
    """Sums over blocks, shape (blocks, ...).

    The angle between both encoders has two regressors, the other's velocity (for the delay) and the torque, and two
    instruments, the own velocity (for the other's has errors) and the torque. ``matrix`` (2, 2) is of instruments and
    regressors, without the torque's own noise, ``right`` (2,) of instruments and the angle, ``own`` (2,) of a and the
    regressors' second derivatives, ``energy`` of a and a - z. ``apart`` is the square of both velocities' difference,
    ``together`` that of their sum, ``samples`` how many there are.
    """

    matrix: FloatArray
    right: FloatArray
    own: FloatArray
    energy: FloatArray
    apart: FloatArray
    together: FloatArray
    samples: FloatArray

    @classmethod
    def of(cls, rows: Rows, shift_s: float) -> "_Products":
        """With the other encoder read ``shift_s`` later."""
        length = max(1, round(BLOCK_S / (rows.signals.tick_s * rows.stride)))
        own, other, torque = (
            each[:, : each.shape[1] // length * length].reshape(len(each), -1, length) for each in _both(rows, shift_s)
        )
        about = [each - each.mean(axis=-1, keepdims=True) for each in (own[1], other[1], torque[0], own[0] - other[0])]
        instruments, regressors = np.stack([about[0], about[2]]), np.stack([about[1], about[2]])
        samples = np.full(own.shape[1], float(length))
        matrix = np.einsum("ibn,rbn->bir", instruments, regressors)
        matrix[:, 1, 1] -= samples * rows.torque_noise(0)
        return cls(
            matrix,
            np.einsum("ibn,bn->bi", instruments, about[3]),
            np.einsum("rbn,bn->br", np.stack([other[3], torque[1]]), own[2]),
            np.einsum("bn,bn->b", own[2], own[2] - other[2]),
            np.sum((own[1] - other[1]) ** 2, axis=1),
            np.sum((own[1] + other[1]) ** 2, axis=1),
            samples,
        )

    @classmethod
    def joined(cls, parts: Sequence["_Products"]) -> "_Products":
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))

    def without_each(self) -> "_Products":
        """Of all blocks but one, and of all of them at the end, (blocks + 1, ...)."""
        each = (getattr(self, name) for name in self.__dataclass_fields__)
        return _Products(*(np.concatenate([sums.sum(0) - sums, sums.sum(0)[None]]) for sums in each))

    @property
    def slopes(self) -> FloatArray:
        """Of the delay [s] and of the twist, (..., 2); none of a regressor that is nowhere seen."""
        size = np.sqrt(np.abs(np.einsum("...ii->...i", self.matrix)))
        size = np.where(size > 0.0, size, 1.0)
        scaled = self.matrix / size[..., :, None] / size[..., None, :]
        found = np.linalg.pinv(scaled) @ (self.right / size)[..., None]
        return np.asarray(found[..., 0] / size)


def _told(rows: Sequence[Rows]) -> tuple[float, float] | None:
    """The energy of a's errors and its standard deviation (jackknife over blocks); None where too little was read, or
    the two do not turn as one shaft."""
    near = _Products.joined([_Products.of(each, 0.0) for each in rows])
    if len(near.energy) < FEWEST_BLOCKS:
        return None
    # A slope is exact for small delays: once more from where it leads, which is exact to the third order.
    shift_s = float(near.without_each().slopes[-1, 0])
    sums = _Products.joined([_Products.of(each, shift_s) for each in rows]).without_each()
    if sums.apart[-1] > MOST_APART * sums.together[-1]:
        return None
    energies = (sums.energy - np.einsum("br,br->b", sums.slopes, sums.own)) / sums.samples
    left_out, energy = energies[:-1], float(energies[-1])
    return energy, float(np.sqrt((len(left_out) - 1) * np.var(left_out)))


def _both(rows: Rows, shift_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The own angle with its first two derivatives, the other's with three, and the torque with its second: (3,
    samples), (4, samples), (2, samples)."""
    assert rows.signals.other_rad is not None
    own, other = rows.derivatives_of_motion((0, 1, 2)), rows.derivatives(rows.signals.other_rad, (0, 1, 2, 3), shift_s)
    return own[:, rows.usable], other[:, rows.usable], rows.torque_derivatives((0, 2))[:, rows.usable]
