"""How great an encoder's errors are in a fit's band, as the other machine's encoder tells it.

Both turn with one shaft. Of the accelerations a and z that they show, the mean of a (a - z) is the energy of a's own
errors, whatever they come from and whether they hide behind counts or not (instrumental variables: Söderström,
Errors-in-Variables Methods in System Identification, 2018, ch. 6). Before, everything else that makes the angles differ
is found from the angles themselves and taken off: the difference of the delays, the twist of the sensor, which goes
with the torque, and errors of either encoder that repeat every turn and every half of one.

Counts of both encoders err alike where a shaft moves slowly. How wrong that makes the result is seen in simulated
records, whose errors are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.bootstrap import ErrorsSeen, Readings, Simulation, stated_energy
from norton_bench.identification.joint_fit import solve_again
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.motor_values import covariance_of, physical
from norton_bench.identification.readings import nominal_period_s
from norton_bench.identification.rows import Rows
from norton_bench.identification.separable import Solution, normal_solution
from norton_bench.identification.shape import Shape
from norton_bench.identification.signals import (
    INTERPOLATION,
    LONGEST_GAP_S,
    Signals,
    TimeSeries,
    positions_of,
    signals,
)
from norton_bench.identification.statistics import std_of_next
from norton_bench.records import Table

# Deviations. Errors that change no value by more than this when they are not undone need not be known any better.
NEGLIGIBLE = 0.1
DRAWS = 6
# Fewer readings of a load tell no clock.
FEWEST_READINGS = 100
# Deviations: another encoder is asked where it tells noise as great as the counts' own from none.
TELLING = 2.0
# The angle between the encoders is looked at within blocks of this length: what changes more slowly matters to no
# acceleration.
BLOCK_S = 0.5
PERIODS_PER_TURN = (1.0, 2.0)
# Of the squares of the velocities' difference and their sum: they are equal where one of both stands still.
MOST_APART = 0.1
# Deviations within which the most likely energy is sought, in so many places.
PLAUSIBLE, PLACES = 3.0, 1001


def with_errors_seen(
    readings: Readings, stretches: tuple[Signals, ...], solution: Solution
) -> tuple[Readings, tuple[Signals, ...], Solution]:
    """Readings, signals and solution with what another encoder tells; unchanged where it tells nothing, or where these
    errors do not matter.

    What readings alone tell is the most likely energy beforehand, and noise of as much as the counts' own errors, which
    can hide behind them, its deviation: of the logarithm, for no energy is below zero.
    """
    as_read = readings, stretches, solution
    hidden = counts_energy(stretches, _kernel(solution))
    if not solution.converged or solution.free_motion or hidden == 0.0 or not matters(solution):
        return as_read
    shown = shown_energy(stretches, readings.measured.load_motion, solution.shape, _kernel(solution))
    if shown is None or TELLING * shown.doubt(readings) > hidden:
        return as_read
    bench = Simulation.of(replace(readings, draws=DRAWS), stretches, solution)
    off = errors_of_simulated(bench.with_load(shown.compliance_rad_nm))
    std = float(np.hypot(std_of_next(off), shown.doubt(readings)))
    if TELLING * std > hidden:
        return as_read
    assumed = stated_energy(stretches, _kernel(solution))
    factor, known_to = _likeliest((shown.energy - float(np.mean(off))) / assumed, std / assumed, hidden / assumed)
    seen = ErrorsSeen(factor, known_to, np.zeros(0))
    after = solve_again(seen.of(stretches), solution)
    if not after.converged:
        return as_read
    seen = replace(seen, moved=physical(after)[0] - physical(solution)[0])
    return replace(readings, errors_seen=seen), seen.of(stretches), after


def matters(solution: Solution) -> bool:
    """Whether the fit's values, at which errors of the motion are undone, would be others if they were not."""
    jacobian, undone = solution.jacobian.T, solution.contamination
    pull = np.zeros(undone.size)
    pull[:5] = undone[:5] * solution.linear[:5]
    change = normal_solution(jacobian, pull, undone)
    return bool(np.any(np.abs(change) > NEGLIGIBLE * np.sqrt(np.diag(covariance_of(solution)))))


def counts_energy(stretches: Sequence[Signals], kernel: Kernel) -> float:
    """Of the acceleration, from errors anywhere within a count."""
    alone = [replace(each, position_noise=each.counts.variance * each.position_period_s) for each in stretches]
    return stated_energy(tuple(alone), kernel)


def errors_of_simulated(bench: Simulation) -> FloatArray:
    """By how much the energy shown is too great in each simulated record, (draws,)."""
    off = []
    for record in bench.records():
        stretches = signals(record, bench.readings.tick_s, bench.readings.use)
        shown = shown_energy(stretches, record.load_motion, bench.solution.shape, _kernel(bench.solution))
        off.append((0.0 if shown is None else shown.energy) - bench.error_energy(record, stretches))
    return np.array(off)


def _kernel(solution: Solution) -> Kernel:
    return solution.regression.rows[0].kernel


def _likeliest(seen: float, std: float, hidden: float) -> tuple[float, float]:
    """The most likely factor, and the standard deviation of its logarithm."""
    deviations, prior_std = np.linspace(-PLAUSIBLE, PLAUSIBLE, PLACES), np.log1p(hidden)
    off = (np.exp(deviations * prior_std) - seen) / std
    factor = float(np.exp(prior_std * deviations[np.argmin(deviations**2 + off**2)]))
    return factor, float(1.0 / np.sqrt(1.0 / prior_std**2 + (factor / std) ** 2))


@dataclass(frozen=True)
class Shown:
    """The ``energy`` of a's errors [rad²/s⁴], with the sensor's compliance that was found for it.

    ``of_compliance`` is the energy that a compliance of 1 rad/(N m) takes off, ``of_waves`` what errors that repeat
    every turn took off. ``unsteady`` is what the other encoder's clock may add, as its delay differs from block to
    block.
    """

    energy: float
    compliance_rad_nm: float
    of_compliance: float
    of_waves: float
    unsteady: float

    def doubt(self, readings: Readings) -> float:
        """What the energy may be wrong by: for that clock; for errors that repeat every turn, anything between none and
        twice those that were found; and by how much the compliance that was calibrated, if one was, would change it."""
        twist = 0.0
        if readings.coupling is not None:
            twist = (self.compliance_rad_nm - 1.0 / readings.coupling.stiffness_nm_rad) * self.of_compliance
        return float(np.linalg.norm([self.unsteady, self.of_waves / np.sqrt(3.0), twist]))


def shown_energy(stretches: Sequence[Signals], load_motion: Table, shape: Shape, kernel: Kernel) -> Shown | None:
    """Of all stretches; None where the load's encoder was not read throughout, or where the two do not turn as one."""
    read_rad = _read_at_ticks(stretches, load_motion)
    if read_rad is None:
        return None
    pairs = [_Pair.of(Rows(each, kernel), read, shape) for each, read in zip(stretches, read_rad, strict=True)]
    # A slope is exact for small delays: once more from where it leads, which is exact to the third order.
    delay_s = float(_slopes([each.read_later(0.0) for each in pairs])[0])
    later = [each.read_later(delay_s) for each in pairs]
    slopes = _slopes(later)
    energy = sum((each.energy(slopes) for each in later), 0.0)
    explained = sum((each.explained() for each in later), np.zeros(_Pair.REGRESSORS))
    apart, together = (sum(np.sum((each.other[1] + sign * each.own[1]) ** 2) for each in later) for sign in (-1.0, 1.0))
    if apart > MOST_APART * together:
        return None
    samples = sum(each.own.shape[1] for each in later)
    unsteady = sum(each.unsteady(slopes) for each in later) / samples
    of_waves = float(slopes[2:] @ explained[2:]) / samples
    return Shown(energy / samples, float(slopes[1]), float(explained[1]) / samples, of_waves, unsteady)


@dataclass(frozen=True)
class _Pair:
    """Both encoders in one stretch, on the torque's clock, filtered, at usable rows.

    ``own`` (3, samples) is the angle with two derivatives, ``other`` (4, samples) with three, ``torque`` (2, samples)
    with its second, ``waves`` (2, waves, samples) what may repeat with the angle, with its second derivative.
    """

    REGRESSORS = 2 + 2 * len(PERIODS_PER_TURN)

    rows: Rows
    read_rad: FloatArray
    motion_delay_s: float
    own: FloatArray
    other: FloatArray
    torque: FloatArray
    waves: FloatArray

    @classmethod
    def of(cls, rows: Rows, read_rad: FloatArray, shape: Shape) -> "_Pair":
        """Without the other encoder, which has a delay of its own."""
        own = rows.of_fine_signal(rows.signals.position_rad, (0, 1, 2), shape.motion_delay_s)
        waves = [
            np.concatenate([rows.cogging(shape, periods, order) for periods in PERIODS_PER_TURN]) for order in (0, 2)
        ]
        used = (each[..., rows.usable] for each in (own, rows.torque_derivatives((0, 2)), np.stack(waves)))
        own, torque, waved = used
        return cls(rows, read_rad, shape.motion_delay_s, own, np.empty((4, 0)), torque, waved)

    def read_later(self, delay_s: float) -> "_Pair":
        """With the other encoder, whose readings come later than the own by ``delay_s``."""
        other = self.rows.derivatives(self.read_rad, (0, 1, 2, 3), self.motion_delay_s + delay_s)
        return replace(self, other=other[:, self.rows.usable])

    def regressors(self, *, of_acceleration: bool = False) -> FloatArray:
        """Of the angle between both, or of its second derivative: the other's velocity, for the delay [s], the torque,
        for the compliance [rad/(N m)], and the waves: (REGRESSORS, samples)."""
        order = int(of_acceleration)
        return np.stack([self.other[1 + 2 * order], self.torque[order], *self.waves[order]])

    def energy(self, slopes: FloatArray) -> float:
        """The sum of a (a - z) without what ``slopes`` (REGRESSORS,) explain."""
        return float(self.own[2] @ (self.own[2] - self.other[2]) - slopes @ self.explained())

    def explained(self) -> FloatArray:
        """What a slope of 1 explains of that sum, (REGRESSORS,)."""
        return np.asarray(self.regressors(of_acceleration=True) @ self.own[2])

    def unsteady(self, slopes: FloatArray) -> float:
        """What a delay that differs from block to block adds to that sum."""
        velocity, jerk = self.blocks(self.other[1]), self.blocks(self.other[3])
        left = self.blocks(self.own[0] - self.other[0] - slopes @ self.regressors())
        delays_s = np.sum(velocity * left, axis=1) / np.maximum(np.sum(velocity**2, axis=1), 1e-300)
        return float(delays_s**2 @ np.sum(jerk**2, axis=1))

    def blocks(self, values: FloatArray) -> FloatArray:
        """About the mean of each block, (..., blocks, samples of one)."""
        length = max(1, round(BLOCK_S / (self.rows.signals.tick_s * self.rows.stride)))
        parts = values[..., : values.shape[-1] // length * length].reshape(*values.shape[:-1], -1, length)
        return np.asarray(parts - parts.mean(axis=-1, keepdims=True))


def _read_at_ticks(stretches: Sequence[Signals], load_motion: Table) -> list[FloatArray] | None:
    """The load's position at the ticks of each stretch, (n,) each; None where readings are too slow for the whole band,
    or missing for longer than LONGEST_GAP_S."""
    if len(load_motion) < FEWEST_READINGS or not nominal_period_s(load_motion["arrival_ns"]) > 0.0:
        return None
    load = positions_of(load_motion, stretches[0].origin_ns)
    if load.period_s * FULL_BAND.cutoff > INTERPOLATION.cutoff * stretches[0].tick_s:
        return None
    if not all(_throughout(load, each.time_s) for each in stretches):
        return None
    return [_to_the_ends(load.at(each.time_s)) for each in stretches]


def _throughout(load: TimeSeries, time_s: FloatArray) -> bool:
    inside_s = load.between(time_s[0], time_s[-1]).time_s
    steps_s = np.diff(inside_s, prepend=time_s[0], append=time_s[-1])
    return bool(np.max(steps_s) <= LONGEST_GAP_S)


def _to_the_ends(values: FloatArray) -> FloatArray:
    """The nearest that is known, where none is."""
    known = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(values.size), known, values[known])


def _slopes(pairs: Sequence[_Pair]) -> FloatArray:
    """Of the angle between both with its regressors, (REGRESSORS,); none with one that is nowhere seen.

    The own velocity is the instrument for the other's, whose errors are in the angle; of the square of the torque its
    own noise is taken off.
    """
    matrix, right = np.zeros((_Pair.REGRESSORS, _Pair.REGRESSORS)), np.zeros(_Pair.REGRESSORS)
    for pair in pairs:
        regressors = pair.blocks(pair.regressors()).reshape(_Pair.REGRESSORS, -1)
        instruments = np.concatenate([pair.blocks(pair.own[1]).reshape(1, -1), regressors[1:]])
        matrix += instruments @ regressors.T
        matrix[1, 1] -= regressors.shape[1] * pair.rows.torque_noise(0)
        right += instruments @ pair.blocks(pair.own[0] - pair.other[0]).reshape(-1)
    size = np.sqrt(np.abs(np.diag(matrix)))
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.pinv(matrix / np.outer(size, size)) @ (right / size) / size)
