"""The network's equation about the network's own values: what it leaves of the torque, and how that would change.

To first order, residual = jacobian · (true values − found) + what the model does not have + noise. Whether the model
lacks something, and what that does to each value, is then linear algebra on sums over stretches of time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.identification.fit import PHYSICAL
from norton_bench.identification.information import Linearised
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.regression import COULOMB, DAMPING, GAIN, INERTIA, VISCOUS, Memory, Regression
from norton_bench.identification.results import FitResult, SensorZero
from norton_bench.identification.signals import Signals

# Sums over stretches this long are taken as independent of each other, as in the residual's other tests.
BLOCK_S = 0.5


@dataclass(frozen=True)
class Expansion:
    """Arrays over the samples used, (n,), in order of time, first of what was fitted, then of what no fit has seen.

    ``residual`` [N m] still has the sensor's zero in it. ``jacobian`` (unknowns, n) has the five linear unknowns, two
    for each wave of cogging, the zero's ``hats``, and log β, log s and two delays. What a friction's state after a
    rest may have made is taken off both (``memory`` does it to others).
    """

    residual: FloatArray
    jacobian: FloatArray
    linear: FloatArray  # the network's own, shape (5,)
    hats: slice
    memory: Memory
    motor_nm: FloatArray  # behind the amplifier's lag
    predicted_nm: FloatArray  # by the network, at the port
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    friction: FloatArray  # share of the contact's strength in use, −1 … 1
    position_rad: FloatArray
    time_s: FloatArray
    segment: IntArray
    fitted: npt.NDArray[np.bool_]
    knots_s: FloatArray  # of the hats
    noise_nm2: float  # variance that the readings' own errors leave in the residual
    unknown_nm2: float  # and that instants known to within a tick, and places known to within a count, may leave

    @classmethod
    def of(cls, result: FitResult, fitted: Sequence[Signals], unseen: Sequence[Signals]) -> "Expansion":
        """Of all stretches, in the fit's own band. They must have measured the torque."""
        at = Linearised.at(result)
        regression = Regression.of((*fitted, *unseen), at.band, cogging=at.cogging)
        columns, memory = regression.columns(at.shape)
        slopes = regression.jacobian(at.shape, columns, at.linear)
        first = 5 + 2 * len(at.cogging)
        predicted = at.linear @ columns[:5]
        count = sum(rows.usable.size for rows in regression.rows[: len(fitted)])
        time_s = regression.time_s()
        knots_s = np.linspace(np.min(time_s[:count]), np.max(time_s[:count]), len(columns) - first)
        # Over the fitted time alone, the outermost held on beyond it: what no fit has seen tells nothing of the zero.
        columns[first:] = [np.interp(time_s, knots_s, one) for one in np.eye(knots_s.size)]
        noise = np.array([rows.noise() for rows in regression.rows])
        weights = [rows.usable.size for rows in regression.rows]
        carried = np.array([1.0, at.linear[INERTIA] ** 2, at.linear[VISCOUS] ** 2])
        return cls(
            residual=memory.taken_off(regression.target() - predicted),
            jacobian=memory.taken_off(np.concatenate([columns, slopes])),
            linear=at.linear,
            hats=slice(first, len(columns)),
            memory=memory,
            motor_nm=at.linear[GAIN] * columns[GAIN],
            predicted_nm=predicted,
            velocity_rad_s=-columns[VISCOUS],
            acceleration_rad_s2=-columns[INERTIA],
            friction=-columns[COULOMB],
            position_rad=regression.chosen([rows.position(at.shape)[0] for rows in regression.rows]),
            time_s=time_s,
            segment=regression.segment(),
            fitted=np.arange(predicted.size) < count,
            knots_s=knots_s,
            noise_nm2=float(np.average(noise, axis=0, weights=weights) @ carried),
            unknown_nm2=_unknown(slopes[-2:], fitted[0].tick_s, at.band)
            + _within_counts(at, -columns[COULOMB], -columns[VISCOUS], max(each.count_rad for each in fitted)),
        )

    @property
    def command(self) -> FloatArray:
        """Behind the amplifier's lag, in the command's unit, shape (n,)."""
        return np.asarray(self.motor_nm / self.linear[GAIN])

    @cached_property
    def zero(self) -> SensorZero:
        """The sensor's zero as the fitted part tells it."""
        rows = self.jacobian[:, self.fitted]
        scale = np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
        scaled = rows / scale[:, None]
        values = np.linalg.lstsq(scaled @ scaled.T, scaled @ self.residual[self.fitted], rcond=1e-12)[0] / scale
        return SensorZero(self.knots_s, values[self.hats])

    def without(self, zero: SensorZero) -> FloatArray:
        """The residual without the sensor's ``zero``, shape (n,)."""
        return np.asarray(self.residual - self.memory.taken_off(zero.at(self.time_s)))

    @cached_property
    def part(self) -> IntArray:
        """The number of each sample's segment, from 0 without gaps, shape (n,)."""
        return np.asarray(np.unique(self.segment, return_inverse=True)[1], dtype=np.int64)

    @cached_property
    def block(self) -> IntArray:
        """The number of each sample's block: a stretch of BLOCK_S, or what a segment has of it; shape (n,)."""
        index = np.floor(self.time_s / BLOCK_S).astype(np.int64)
        return np.asarray(np.unique(index + self.part * (int(index.max()) + 1), return_inverse=True)[1], dtype=np.int64)

    def physical(self, change: FloatArray) -> FloatArray:
        """The relative change of each of fit.PHYSICAL, shape (7,), from that of the unknowns (unknowns,)."""
        relative = change[:5] / np.where(self.linear == 0.0, np.inf, self.linear)
        bandwidth, shape = change[self.hats.stop], change[self.hats.stop + 1]
        by_name = {
            "torque_gain": relative[GAIN],
            "amplifier_bandwidth": bandwidth,
            "inertia": relative[INERTIA],
            "viscous_damping": relative[VISCOUS],
            "coulomb_torque": relative[COULOMB],
            "presliding_stiffness": relative[COULOMB] + shape,
            "presliding_damping": relative[DAMPING],
        }
        return np.array([by_name[name] for name in PHYSICAL])


def _unknown(slopes: FloatArray, tick_s: float, band: Kernel) -> float:
    """The variance that instants make which lie anywhere within a tick, from the slopes with both delays (2, n)."""
    return float(np.sum(np.mean(slopes**2, axis=1))) * tick_s**2 / 12 * band.energy(0)


def _within_counts(at: Linearised, friction: FloatArray, velocity: FloatArray, count_rad: float) -> float:
    """The variance that places make which lie anywhere within a count: the contact is as stiff there as dh/dx says."""
    slope = at.network.presliding_stiffness_nm_rad * (1.0 - np.sign(velocity) * friction)
    return float(np.mean(slope**2)) * count_rad**2 / 12


@dataclass(frozen=True)
class Sums:
    """Normal equations by block: ``gram`` (blocks, p, p), ``score`` (blocks, p), ``power`` (blocks,), all of columns
    scaled to an rms of one; ``scale`` (p,) undoes that. ``part`` (blocks,) is the segment of each block."""

    gram: FloatArray
    score: FloatArray
    power: FloatArray
    part: IntArray
    scale: FloatArray
    count: int

    @classmethod
    def of(cls, expansion: Expansion, columns: FloatArray) -> "Sums":
        """Of ``columns`` (p, n)."""
        scale = np.maximum(np.sqrt(np.mean(columns**2, axis=1)), 1e-300)
        scaled = columns / scale[:, None]
        order = np.argsort(expansion.block, kind="stable")
        edges = np.concatenate([[0], np.cumsum(np.bincount(expansion.block))])
        spans = [order[first:last] for first, last in pairwise(edges)]
        gram = np.stack([scaled[:, span] @ scaled[:, span].T for span in spans])
        score = np.stack([scaled[:, span] @ expansion.residual[span] for span in spans])
        power = np.array([float(np.sum(expansion.residual[span] ** 2)) for span in spans])
        part = np.array([expansion.part[span[0]] for span in spans])
        return cls(gram, score, power, part, scale, expansion.residual.size)

    def solved(self, chosen: IntArray, without: int | None = None) -> FloatArray:
        """Least squares of the residual by ``chosen`` columns, of all blocks but those of a segment; scaled."""
        kept = np.ones(self.part.size, dtype=bool) if without is None else self.part != without
        gram = self.gram[kept].sum(axis=0)[np.ix_(chosen, chosen)]
        return np.asarray(np.linalg.lstsq(gram, self.score[kept].sum(axis=0)[chosen], rcond=1e-12)[0])

    def left(self, chosen: IntArray, values: FloatArray, within: npt.NDArray[np.bool_]) -> float:
        """The sum of squares that ``values`` of ``chosen`` columns leave of the residual in some blocks."""
        gram = self.gram[within].sum(axis=0)[np.ix_(chosen, chosen)]
        score = self.score[within].sum(axis=0)[chosen]
        return float(self.power[within].sum() - 2 * values @ score + values @ gram @ values)

    def held_out(self, chosen: IntArray) -> float:
        """The mean square left, each segment predicted by what all others tell."""
        total = sum(
            self.left(chosen, self.solved(chosen, int(part)), self.part == part) for part in np.unique(self.part)
        )
        return float(total) / self.count
