"""The network's equation about the network's own values: what it leaves of the torque, and how that would change.

To first order, residual = jacobian · (true values − found) + what the model does not have + noise. Whether the model
lacks something, and what that does to each value, is then linear algebra on sums over stretches of time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.identification.counts import moving
from norton_bench.identification.joint_regression import JointRegression
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.motor_values import KNOWN, PHYSICAL
from norton_bench.identification.regression import Memory, Regression
from norton_bench.identification.results import FitResult, SensorZero
from norton_bench.identification.shape import COULOMB, DAMPING, GAIN, INERTIA, VISCOUS, Shape
from norton_bench.identification.signals import FINE, Signals
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import joint_of, waves_of

# What nothing has told of yet is known to about this: the box that the fit searches is as wide.
VAGUE_RELATIVE = 3.0
VAGUE_S = 5e-3
# A parameter that came out as nothing has no scale of its own; with this one its relative deviation is vast.
LEAST = 1e-12


# What a record tells of each parameter, or what an experiment that is only planned would tell, in the same terms.
#
# The columns and slopes of the fit's own regression, at an estimate that is there already, give the information
# matrix JᵀJ / σ²: its inverse is the covariance that noise alone would leave (the Cramér–Rao bound where σ² is the
# noise's density). Each stretch's initial friction and the sensor's wandering zero are unknowns too, and are
# projected out.
@dataclass(frozen=True)
class Excitation:
    """A planned stretch: arrays of shape (ticks,), the motion smooth and imposed, so known ahead."""

    tick_s: float
    command: FloatArray
    position_rad: FloatArray


@dataclass(frozen=True)
class Linearised:
    """Where the information is taken: a network, delays, the band, and the waves of cogging."""

    network: NortonNetwork
    command_delay_s: float
    motion_delay_s: float
    band: Kernel = FULL_BAND
    cogging: tuple[float, ...] = ()
    zero_nm: float = 0.0  # of the torque sensor
    middle_s: float = 0.0  # of the session

    @classmethod
    def at(cls, result: FitResult) -> "Linearised":
        waves = tuple(wave.periods_per_turn for wave in result.cogging)
        delays_s = (result.command_delay_s, result.motion_delay_s)
        return cls(result.network, *delays_s, result.band, waves, result.torque_bias_nm, result.middle_s)

    @property
    def shape(self) -> Shape:
        network = self.network
        s_per_rad = network.presliding_stiffness_nm_rad / network.coulomb_torque_nm
        delays_s = (self.command_delay_s, self.motion_delay_s)
        return Shape(network.amplifier_bandwidth_rad_s, s_per_rad, *delays_s, network.relative_terms)

    def regression(self, stretches: Sequence[Signals]) -> Regression:
        """Of these stretches, in this band, with this cogging and these terms."""
        regression = Regression.of(tuple(stretches), self.band, cogging=self.cogging)
        composed = regression.with_terms(self.network.relative_terms, self.zero_nm, self.middle_s)
        if joint_of(self.network.terms) is None:
            return composed
        nominal = np.concatenate([self.linear, self.waves])
        return JointRegression.behind(composed, nominal)

    @property
    def waves(self) -> FloatArray:
        """Of each wave of ``cogging``, what goes with cosine and sine, as the network has them: (2 · waves,) [N m]."""
        waves = waves_of(self.network.terms)
        return np.asarray(waves[np.isin(waves[:, 0], self.cogging), 1:].ravel())

    @property
    def linear(self) -> FloatArray:
        """In the order of the regression's first five columns."""
        network = self.network
        values = np.zeros(5)
        values[GAIN], values[INERTIA] = network.torque_gain, network.inertia_kgm2
        values[VISCOUS], values[COULOMB] = network.viscous_damping_nms_rad, network.coulomb_torque_nm
        values[DAMPING] = network.presliding_damping_nms_rad
        return values


def noise_density_nm(result: FitResult) -> float:
    """The deviation of white noise, a sample a tick, whose rms behind the fit's low-pass is that of its residual."""
    return float(result.torque_rms_nm / np.sqrt(result.band.energy(0)))


@dataclass(frozen=True)
class Slopes:
    """Change of the torque with every unknown, at every sample that is used.

    ``wanted`` (9, samples) in the order of KNOWN; ``others`` (k, samples), of cogging, the sensor's zero and terms;
    ``memory``, of the friction after each rest; ``errors`` (9,), what readings' own errors add to the squares of
    ``wanted``. ``regression`` says which samples those are.
    """

    regression: Regression
    wanted: FloatArray
    others: FloatArray
    memory: Memory
    errors: FloatArray

    @classmethod
    def of(cls, stretches: tuple[Signals, ...], at: Linearised) -> "Slopes":
        regression = at.regression(stretches)
        shape, linear = at.shape, at.linear
        columns, memory = regression.columns(shape)
        slopes = regression.jacobian(shape, columns, linear)
        (slope_bandwidth, slope_s, slope_command, slope_motion), of_terms = slopes[:4], slopes[4:]
        scale = np.maximum(np.abs(linear), LEAST)
        own = columns[:5] * scale[:, None]
        # s is σ0/τc: with σ0 held, a greater τc makes the contact softer relative to its strength.
        wanted = np.stack(
            [own[GAIN], slope_bandwidth, own[INERTIA], own[VISCOUS], own[COULOMB] - slope_s, slope_s, own[DAMPING],
             slope_command, slope_motion]
        )  # fmt: skip
        errors = np.zeros(len(KNOWN))
        contamination = regression.contamination() * scale**2
        for row, column in ((KNOWN.index("inertia"), INERTIA), (KNOWN.index("viscous_damping"), VISCOUS)):
            errors[row] = contamination[column]
        return cls(regression, wanted, np.concatenate([columns[5:], of_terms]), memory, errors)

    @cached_property
    def products(self) -> FloatArray:
        """Products of ``wanted`` without what any other unknown could explain as well, shape (9, 9)."""
        wanted, others = self.memory.taken_off(self.wanted), self.memory.taken_off(self.others)
        return without(wanted @ wanted.T, others @ wanted.T, others @ others.T)

    def motion_share(self) -> FloatArray:
        """By how much each of ``wanted`` is motion: errors of readings look like it, and tell nothing. Shape (9,)."""
        squares = np.diag(self.products)
        left = np.maximum(squares - self.errors, 0.0)
        return np.sqrt(np.divide(left, squares, out=np.zeros_like(left), where=squares > 0.0))


def information(stretches: tuple[Signals, ...], at: Linearised, noise_nm: float) -> FloatArray:
    """The information matrix of ``stretches``, shape (9, 9), in the order of KNOWN, relative (delays: seconds).

    ``noise_nm`` is white, a tick.
    """
    slopes = Slopes.of(stretches, at)
    share = slopes.motion_share()
    return np.asarray(slopes.products * np.outer(share, share) / noise_nm**2)


def information_of_plan(
    excitation: Excitation, at: Linearised, noise_nm: float, *, position_resolution_rad: float = 0.0
) -> FloatArray:
    """The same, of what is only planned; what the encoder's counts would hide is left out as the fit would."""
    return information((planned_signals(excitation, position_resolution_rad),), at, noise_nm)


def planned_signals(excitation: Excitation, position_resolution_rad: float) -> Signals:
    """An ideal record of the plan."""
    tick_s, ticks = excitation.tick_s, len(excitation.command)
    time_s = np.asarray(np.arange(ticks) * tick_s, dtype=np.float64)
    fine_s = np.arange(ticks * FINE) * (tick_s / FINE)
    path = np.asarray(CubicSpline(time_s, excitation.position_rad)(np.minimum(fine_s, time_s[-1])), dtype=np.float64)
    usable = moving(excitation.position_rad, position_resolution_rad)
    return Signals(
        tick_s=tick_s,
        origin_ns=0,
        time_s=time_s,
        position_rad=path,
        path_rad=path,
        sent_s=time_s,
        command=np.ascontiguousarray(excitation.command, dtype=np.float64),
        segment=np.zeros(ticks, dtype=np.int64),
        usable=usable if usable.any() else np.ones(ticks, dtype=bool),
        rests=np.zeros(0, dtype=np.int64),
        torque_nm=np.zeros(ticks),
    )


def vague() -> FloatArray:
    """The information of somebody who knows next to nothing, shape (9, 9): it makes every matrix invertible."""
    deviations = np.array([VAGUE_RELATIVE] * 7 + [VAGUE_S] * 2)
    return np.diag(deviations**-2.0)


def deviations(matrix: FloatArray) -> FloatArray:
    """The standard deviations that ``matrix`` leaves, shape (9,), relative (delays: seconds)."""
    scale = np.sqrt(np.diag(matrix))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(matrix / np.outer(scale, scale)))) / scale)


def without(own: FloatArray, shared: FloatArray, nuisance: FloatArray) -> FloatArray:
    """Products ``own`` (k, k) of what is wanted, without what a nuisance could explain as well.

    ``shared`` (m, k) are the products of nuisance and wanted, ``nuisance`` (m, m) its own.
    """
    lengths = np.sqrt(np.diag(nuisance))
    there = lengths > 0
    scale = lengths[there]
    shared = shared[there] / scale[:, None]
    explained = np.linalg.lstsq(nuisance[np.ix_(there, there)] / np.outer(scale, scale), shared, rcond=1e-12)[0]
    matrix = own - shared.T @ explained
    return np.asarray(0.5 * (matrix + matrix.T))


# Sums over stretches this long are taken as independent of each other, as in the residual's other tests.
BLOCK_S = 0.5


@dataclass(frozen=True)
class Expansion:
    """Arrays over the samples used, (n,), in order of time, first of what was fitted, then of what no fit has seen.

    ``residual`` [N m] still has the sensor's zero in it. ``jacobian`` (unknowns, n) has the five linear unknowns, two
    for each wave of cogging, the zero's ``basis`` functions, log β, log s, two delays and the terms' parameters. What
    a friction's state after a rest may have made is taken off both (``memory`` does it to others).
    """

    residual: FloatArray
    jacobian: FloatArray
    linear: FloatArray  # the network's own, shape (5,)
    terms: tuple[str, ...]  # that the network has
    basis: slice
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
    drifted_nm: FloatArray  # what of the prediction is due to changes in time, which the network does not foresee
    knots_s: FloatArray  # of the basis functions
    noise_nm2: float  # variance that the readings' own errors leave in the residual
    unknown_nm2: float  # and that instants known to within a tick, and places known to within a count, may leave

    @classmethod
    def of(cls, result: FitResult, fitted: Sequence[Signals], unseen: Sequence[Signals]) -> "Expansion":
        """Of all stretches, in the fit's own band. They must have measured the torque."""
        at = Linearised.at(result)
        regression = at.regression((*fitted, *unseen))
        columns, memory = regression.columns(at.shape)
        slopes = regression.jacobian(at.shape, columns, at.linear)
        first = 5 + 2 * len(at.cogging)
        predicted = np.concatenate([at.linear, at.waves]) @ columns[:first]
        count = sum(rows.usable.size for rows in regression.rows[: len(fitted)])
        time_s = regression.time_s()
        knots_s = np.linspace(np.min(time_s[:count]), np.max(time_s[:count]), len(columns) - first)
        # Over the fitted time alone, the outermost held on beyond it: what no fit has seen tells nothing of the zero.
        columns[first:] = [np.interp(time_s, knots_s, one) for one in np.eye(knots_s.size)]
        velocity, acceleration = regression.chosen([rows.kinematics(at.shape) for rows in regression.rows])
        noise = np.array([rows.noise() for rows in regression.rows])
        weights = [rows.usable.size for rows in regression.rows]
        return cls(
            residual=memory.taken_off(regression.target() - predicted),
            jacobian=memory.taken_off(np.concatenate([columns, slopes])),
            linear=at.linear,
            terms=tuple(term.name for term in at.network.terms),
            basis=slice(first, len(columns)),
            memory=memory,
            motor_nm=at.linear[GAIN] * regression.chosen([rows.lag(at.shape) for rows in regression.rows]),
            predicted_nm=predicted,
            velocity_rad_s=velocity,
            acceleration_rad_s2=acceleration,
            friction=-columns[COULOMB],
            position_rad=regression.chosen([rows.position(at.shape)[0] for rows in regression.rows]),
            time_s=time_s,
            segment=regression.segment(),
            fitted=np.arange(predicted.size) < count,
            drifted_nm=predicted - _without_drift(regression, at, predicted),
            knots_s=knots_s,
            noise_nm2=float(np.average(noise, axis=0, weights=weights) @ regression.carried(at.linear)),
            unknown_nm2=_unknown(slopes[2:4], fitted[0].tick_s, at.band)
            + _within_counts(at, -columns[COULOMB], velocity, max(each.counts.variance for each in fitted)),
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
        return SensorZero(self.knots_s, values[self.basis])

    @cached_property
    def sums(self) -> "Sums":
        """Of the jacobian's own columns."""
        return Sums.of(self, self.jacobian)

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
        """The relative change of each of motor_values.PHYSICAL, shape (7,), from that of the unknowns (unknowns,)."""
        relative = change[:5] / np.where(self.linear == 0.0, np.inf, self.linear)
        bandwidth, shape = change[self.basis.stop], change[self.basis.stop + 1]
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


def _without_drift(regression: Regression, at: Linearised, predicted: FloatArray) -> FloatArray:
    """The prediction (n,) with everything as it was in the middle of the session."""
    lasting = tuple(each for each in at.shape.terms if not each.term.in_time)
    if len(lasting) == len(at.shape.terms):
        return predicted
    known = np.concatenate([at.linear, at.waves])
    return np.asarray(known @ regression.columns(replace(at.shape, terms=lasting))[0][: known.size])


def _unknown(slopes: FloatArray, tick_s: float, band: Kernel) -> float:
    """The variance that instants make which lie anywhere within a tick, from the slopes with both delays (2, n)."""
    return float(np.sum(np.mean(slopes**2, axis=1))) * tick_s**2 / 12 * band.energy(0)


def _within_counts(at: Linearised, friction: FloatArray, velocity: FloatArray, counts_rad2: float) -> float:
    """The variance that places make which lie anywhere within a count: the contact is as stiff there as dh/dx says."""
    slope = at.network.presliding_stiffness_nm_rad * (1.0 - np.sign(velocity) * friction)
    return float(np.mean(slope**2)) * counts_rad2


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
        order = np.argsort(expansion.block, kind="stable")
        scaled, residual = columns[:, order] / scale[:, None], expansion.residual[order]
        edges = np.concatenate([[0], np.cumsum(np.bincount(expansion.block))])
        spans = [slice(first, last) for first, last in pairwise(edges)]
        gram = np.stack([scaled[:, span] @ scaled[:, span].T for span in spans])
        score = np.stack([scaled[:, span] @ residual[span] for span in spans])
        power = np.array([float(np.sum(residual[span] ** 2)) for span in spans])
        part = expansion.part[order[edges[:-1]]]
        return cls(gram, score, power, part, scale, expansion.residual.size)

    @cached_property
    def _by_part(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """``gram``, ``score`` and ``power`` summed over the blocks of each segment, (parts, …)."""
        parts = [self.part == part for part in range(int(self.part.max()) + 1)]
        gram, score, power = (
            np.stack([np.sum(sums[part], axis=0) for part in parts]) for sums in (self.gram, self.score, self.power)
        )
        return gram, score, power

    @cached_property
    def _whole(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        gram, score, power = (np.sum(sums, axis=0) for sums in self._by_part)
        return gram, score, power

    def solved(self, chosen: IntArray, without: int | None = None) -> FloatArray:
        """Least squares of the residual by ``chosen`` columns, of all blocks but those of a segment; scaled."""
        gram, score, _ = self._whole
        if without is not None:
            gram, score = gram - self._by_part[0][without], score - self._by_part[1][without]
        return np.asarray(np.linalg.lstsq(gram[np.ix_(chosen, chosen)], score[chosen], rcond=1e-12)[0])

    def left(self, chosen: IntArray, values: FloatArray, part: int | None = None) -> float:
        """The sum of squares that ``values`` of ``chosen`` columns leave of the residual, in all or in one segment."""
        gram, score, power = self._whole if part is None else (sums[part] for sums in self._by_part)
        return float(power - 2 * values @ score[chosen] + values @ gram[np.ix_(chosen, chosen)] @ values)

    def held_out(self, chosen: IntArray) -> float:
        """The mean square left, each segment predicted by what all others tell."""
        parts = range(len(self._by_part[0]))
        return sum(self.left(chosen, self.solved(chosen, part), part) for part in parts) / self.count
