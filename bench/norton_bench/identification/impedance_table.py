"""The impedance as a table: mean torque at the port for each command and each steady velocity that was imposed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.distributions import t_quantile
from norton_bench.identification.rows import Aligned, usable_of
from norton_bench.records import SegmentInfo

GRID_PROCEDURE, GRID_NAME = "imposed", "grid"
# A velocity is steady while its mean over this long changes by less than this share of the greatest: ripple may stay.
STEADY_SHARE = 0.03
STEADY_S = 0.05
# Friction and amplifier settle at the beginning of a dwell, which is left out; what remains must last this long.
SETTLING_S = 0.05
SHORTEST_S = 0.08
# Levels nearer than this share of the greatest are one.
SAME_SHARE = 0.04
# Below this share of the greatest velocity the shaft rests, and friction leaves its torque open.
REST_SHARE = 0.01
# The scatter of the means of so many parts is the deviation of a cell.
PARTS = 5


@dataclass(frozen=True)
class ImpedanceTable:
    """Mean torque by command (rows) and velocity (columns): shape (commands, velocities); NaN in an empty cell.

    ``command`` (commands,) and ``velocity_rad_s`` (velocities,) increase; the shaft turned, so zero is not among them.
    ``torque_std_nm`` is the deviation of the mean, ``seconds`` how long each cell was measured.
    """

    command: FloatArray
    velocity_rad_s: FloatArray
    torque_nm: FloatArray
    torque_std_nm: FloatArray
    seconds: FloatArray

    @property
    def half_width_nm(self) -> FloatArray:
        """Half of each cell's 95 % interval (Student's, of so few parts)."""
        return np.asarray(t_quantile(0.975, PARTS - 1) * self.torque_std_nm)

    @property
    def empty(self) -> int:
        """How many cells were never measured."""
        return int(np.count_nonzero(np.isnan(self.torque_nm)))

    def torque(self, command: npt.ArrayLike, velocity_rad_s: npt.ArrayLike) -> FloatArray:
        """Port torque [N m] by straight lines between the cells, on the velocity's own side of rest.

        Slower than the slowest column counts as that column. NaN beyond the table, at rest, and next to empty cells:
        what was not measured is not made up.
        """
        command, velocity = np.broadcast_arrays(
            np.asarray(command, dtype=float), np.asarray(velocity_rad_s, dtype=float)
        )
        torque = np.full(command.shape, np.nan)
        for side in (1.0, -1.0):
            columns = np.flatnonzero(side * self.velocity_rad_s > 0)[:: int(side)]
            chosen = side * velocity > 0
            if columns.size and chosen.any():
                speed = np.abs(self.velocity_rad_s[columns])
                torque[chosen] = _bilinear(
                    self.command,
                    speed,
                    self.torque_nm[:, columns],
                    command[chosen],
                    np.maximum(np.abs(velocity[chosen]), speed[0]),
                )
        return torque

    def fall(self, command: float, velocity_rad_s: float) -> tuple[float, float]:
        """How steeply torque falls with velocity there [N m s/rad], and the deviation of that: straight lines between
        the middles of neighbouring cells on the velocity's own side of rest, and level beyond them.

        NaN where a side has no two columns; the slope is, where a cell around is empty.
        """
        side = 1.0 if velocity_rad_s > 0 else -1.0
        columns = np.flatnonzero(side * self.velocity_rad_s > 0)
        if columns.size < 2:
            return float("nan"), float("nan")
        apart = np.diff(self.velocity_rad_s[columns])
        falls = -np.diff(self.torque_nm[:, columns], axis=1) / apart
        deviations = np.hypot(self.torque_std_nm[:, columns[1:]], self.torque_std_nm[:, columns[:-1]]) / apart
        middles = 0.5 * (self.velocity_rad_s[columns[1:]] + self.velocity_rad_s[columns[:-1]])
        value, deviation = (
            float(np.interp(command, self.command, [np.interp(velocity_rad_s, middles, row) for row in rows]))
            for rows in (falls, deviations)
        )
        return value, deviation

    def predict(self, stretches: Sequence[Aligned]) -> FloatArray:
        """Port torque at every usable instant from command and velocity alone, shape (samples,): no inertia, no lag."""
        return usable_of(stretches, [self.torque(each.command, each.velocity_rad_s) for each in stretches])

    def left_out_rms_nm(self) -> float:
        """How far each inner cell lies from what its two neighbours in velocity give, rms; NaN where none has two."""
        errors = []
        for side in (1.0, -1.0):
            columns = np.flatnonzero(side * self.velocity_rad_s > 0)
            for before, middle, after in zip(columns, columns[1:], columns[2:], strict=False):
                v = self.velocity_rad_s[[before, middle, after]]
                share = (v[1] - v[0]) / (v[2] - v[0])
                expected = (1 - share) * self.torque_nm[:, before] + share * self.torque_nm[:, after]
                errors.append(self.torque_nm[:, middle] - expected)
        known = np.concatenate(errors) if errors else np.empty(0)
        known = known[np.isfinite(known)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def impedance_table(
    stretches: Sequence[Aligned], segments: Sequence[SegmentInfo], bias_nm: float
) -> ImpedanceTable | None:
    """From the grid of imposed velocities, less ``bias_nm``, the sensor's zero; None where there was no grid."""
    grid = {each.index for each in segments if each.procedure == GRID_PROCEDURE and each.name.startswith(GRID_NAME)}
    dwells = [dwell for stretch in stretches for index in sorted(grid) for dwell in _dwells(stretch, index)]
    if not dwells:
        return None
    result = np.array(dwells)
    command, row = _levels(result[:, 0])
    velocity, column = _levels(result[:, 1])
    shape = (command.size, velocity.size)
    seconds, torque, variance = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    np.add.at(seconds, (row, column), result[:, 4])
    np.add.at(torque, (row, column), result[:, 2] * result[:, 4])
    np.add.at(variance, (row, column), (result[:, 3] * result[:, 4]) ** 2)
    with np.errstate(invalid="ignore"):
        mean, deviation = torque / seconds - bias_nm, np.sqrt(variance) / seconds
    return ImpedanceTable(command, velocity, mean, deviation, seconds)


def _dwells(stretch: Aligned, index: int) -> list[tuple[float, float, float, float, float]]:
    """Command, velocity, torque, its deviation and duration of every steady piece of one segment."""
    tick_s = stretch.signals.tick_s
    inside = stretch.signals.segment == index
    if not inside.any():
        return []
    reach = max(1, round(STEADY_S / tick_s))
    greatest = float(np.max(np.abs(stretch.velocity_rad_s[inside])))
    limit = float(np.max(np.abs(stretch.command[inside])))
    steady = inside & stretch.usable & (np.abs(stretch.velocity_rad_s) > REST_SHARE * greatest)
    steady &= _change(stretch.velocity_rad_s, reach) < STEADY_SHARE * greatest
    steady &= _change(stretch.command, reach) <= STEADY_SHARE * limit
    pieces = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steady, [False]]).astype(np.int8)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        piece = slice(first + round(SETTLING_S / tick_s), last)
        length = piece.stop - piece.start
        if length * tick_s >= SHORTEST_S:
            torque = stretch.torque_nm[piece]
            means = [float(np.mean(part)) for part in np.array_split(torque, PARTS)]
            pieces.append(
                (
                    float(np.mean(stretch.command[piece])),
                    float(np.mean(stretch.velocity_rad_s[piece])),
                    float(np.mean(torque)),
                    float(np.std(means, ddof=1) / np.sqrt(PARTS)),
                    length * tick_s,
                )
            )
    return pieces


def _change(values: FloatArray, reach: int) -> FloatArray:
    """How much a signal's mean after each instant differs from that before, each over ``reach`` samples."""
    total = np.concatenate([[0.0], np.cumsum(np.pad(values, reach, mode="edge"))])
    before = total[reach : reach + values.size] - total[: values.size]
    after = total[2 * reach : 2 * reach + values.size] - total[reach : reach + values.size]
    return np.asarray(np.abs(after - before) / reach)


def _levels(values: FloatArray) -> tuple[FloatArray, IntArray]:
    """Different levels among ``values``, increasing, and which of them each value is."""
    order = np.argsort(values)
    apart = np.diff(values[order]) > SAME_SHARE * np.max(np.abs(values))
    place = np.empty(values.size, dtype=np.int64)
    place[order] = np.concatenate([[0], np.cumsum(apart)])
    return np.bincount(place, values) / np.bincount(place), place


def _bilinear(x: FloatArray, y: FloatArray, table: FloatArray, at_x: FloatArray, at_y: FloatArray) -> FloatArray:
    """Between the four cells around; a cell without weight does not count, NaN outside."""
    (i, p), (j, q) = _between(x, at_x), _between(y, at_y)
    total = np.zeros(at_x.shape)
    for row, share_x in ((i, 1 - p), (np.minimum(i + 1, x.size - 1), p)):
        for column, share_y in ((j, 1 - q), (np.minimum(j + 1, y.size - 1), q)):
            weight = share_x * share_y
            total += np.where(weight > 0, weight * table[row, column], 0.0)
    total[np.isnan(p) | np.isnan(q)] = np.nan
    return total


def _between(levels: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """The level below and the share of the one above, NaN outside."""
    index = np.clip(np.searchsorted(levels, at, side="right") - 1, 0, max(levels.size - 2, 0))
    width = levels[np.minimum(index + 1, levels.size - 1)] - levels[index]
    share = np.where(width > 0, (at - levels[index]) / np.where(width > 0, width, 1.0), at - levels[index])
    return index, np.where((share < 0) | (share > 1), np.nan, share)
