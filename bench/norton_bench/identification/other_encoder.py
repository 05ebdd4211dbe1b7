"""How great an encoder's errors are in a fit's band, as the other machine's encoder tells it.

Both turn with one shaft. Of the accelerations a and z that they show, the mean of a (a - z) is the energy of a's own
errors, whatever they come from and whether they hide behind counts or not (instrumental variables: Söderström,
Errors-in-Variables Methods in System Identification, 2018, ch. 6). Before, z is moved by the difference of both delays,
and the twist of the sensor between both is taken off: it goes with the torque, as the angles themselves tell best.

Counts of both encoders err alike where a shaft moves slowly. How wrong that makes the result is seen in simulated
records, whose errors are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.identification.bootstrap import Readings, Simulation, louder
from norton_bench.identification.counts import UNIFORM_DEVIATION
from norton_bench.identification.joint_fit import solve_again
from norton_bench.identification.motor_values import covariance_of
from norton_bench.identification.rows import Rows
from norton_bench.identification.separable import Solution, normal_solution
from norton_bench.identification.signals import Signals, signals
from norton_bench.identification.statistics import NORMAL_95

# Deviations. Errors that change no value by more than this when they are not undone need not be known any better.
NEGLIGIBLE = 0.1
DRAWS = 6
# Deviations: another encoder is asked where it tells noise as great as the counts' own from none.
TELLING = 2.0
# The angle between the encoders is looked at within blocks of this length: slower, an encoder's own error that goes
# with its angle is greater than the twist.
BLOCK_S = 0.5
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
    if not solution.converged or solution.free_motion:
        return as_read
    rows = _rows(stretches, solution)
    shown = _shown(rows, solution.shape.motion_delay_s)
    if shown is None or not _matter(solution):
        return as_read
    assumed, hidden = _mean(rows, [each.motion_noise(2) for each in rows]), _mean(rows, [_of_counts(e) for e in rows])
    if hidden == 0.0:
        return as_read
    bench = Simulation.of(replace(readings, draws=DRAWS), stretches, solution)
    off = _errors_of_simulated(replace(bench, compliance_rad_nm=shown.compliance_rad_nm))
    energy = shown.energy - float(np.mean(off))
    few = t_quantile(0.975, DRAWS - 1) / NORMAL_95 * np.sqrt(1.0 + 1.0 / DRAWS)
    std = few * float(np.std(off, ddof=1))
    if std * TELLING > hidden:
        return as_read
    factor, known_to = _likeliest(energy / assumed, std / assumed, hidden / assumed)
    stretches = louder(stretches, factor)
    return replace(readings, errors_known_to=known_to), stretches, solve_again(stretches, solution)


def _matter(solution: Solution) -> bool:
    """Whether the fit's values, at which errors of the motion are undone, would be others if they were not."""
    jacobian, undone = solution.jacobian.T, solution.contamination
    pull = np.zeros(undone.size)
    pull[:5] = undone[:5] * solution.linear[:5]
    change = normal_solution(jacobian, pull, undone)
    return bool(np.any(np.abs(change) > NEGLIGIBLE * np.sqrt(np.diag(covariance_of(solution)))))


def _likeliest(seen: float, std: float, hidden: float) -> tuple[float, float]:
    """The most likely factor, and the standard deviation of its logarithm."""
    deviations, prior_std = np.linspace(-PLAUSIBLE, PLAUSIBLE, PLACES), np.log1p(hidden)
    off = (np.exp(deviations * prior_std) - seen) / std
    factor = float(np.exp(prior_std * deviations[np.argmin(deviations**2 + off**2)]))
    return factor, float(1.0 / np.sqrt(1.0 / prior_std**2 + (factor / std) ** 2))


def _errors_of_simulated(bench: Simulation) -> FloatArray:
    """By how much the result is too great in each simulated record, (draws,)."""
    off = []
    for record in bench.records():
        stretches = signals(record, bench.readings.tick_s, bench.readings.use)
        rows = _rows(stretches, bench.solution)
        stated = _mean(rows, [each.motion_noise(2) for each in rows])
        shown = _shown(rows, bench.solution.shape.motion_delay_s)
        off.append((0.0 if shown is None else shown.energy) - bench.noise_factor(record, stretches) * stated)
    return np.array(off)


def _rows(stretches: Sequence[Signals], solution: Solution) -> list[Rows]:
    """In the fit's band."""
    return [Rows(each, solution.regression.rows[0].kernel) for each in stretches]


def _mean(rows: Sequence[Rows], values: Sequence[float]) -> float:
    return float(np.average(values, weights=[each.usable.size for each in rows]))


def _of_counts(rows: Rows) -> float:
    """Variance of the acceleration that comes of errors anywhere within a count."""
    signals = rows.signals
    density = (UNIFORM_DEVIATION * signals.count_rad) ** 2 * signals.position_period_s
    return density / signals.position_noise * rows.motion_noise(2) if density > 0.0 else 0.0


@dataclass(frozen=True)
class Shown:
    """What the other encoder makes of the energy of a's errors, and the sensor's compliance that it found for it."""

    energy: float
    compliance_rad_nm: float


def _shown(rows: Sequence[Rows], motion_delay_s: float) -> Shown | None:
    """The mean of a (a - z) without twist and delay, where motion comes later than torque by ``motion_delay_s``; None
    where no other encoder was read throughout, or where the two do not turn as one shaft."""
    if any(each.signals.other_rad is None for each in rows):
        return None
    # A slope is exact for small delays: once more from where it leads, which is exact to the third order.
    delays_s = (motion_delay_s, motion_delay_s + float(_slopes(rows, (motion_delay_s, motion_delay_s))[0]))
    slopes = _slopes(rows, delays_s)
    energy, apart, together, samples = 0.0, 0.0, 0.0, 0
    for each in rows:
        own, other, torque = _both(each, delays_s)
        energy += float(own[2] @ (own[2] - other[2] - slopes[0] * other[3] - slopes[1] * torque[1]))
        apart += float(np.sum((own[1] - other[1]) ** 2))
        together += float(np.sum((own[1] + other[1]) ** 2))
        samples += own.shape[1]
    return None if apart > MOST_APART * together else Shown(energy / samples, float(slopes[1]))


def _slopes(rows: Sequence[Rows], delays_s: tuple[float, float]) -> FloatArray:
    """Of the angle between both, whose delays on the torque's clock are ``delays_s``, (2,): with the other's velocity
    (the delay [s]), and with the torque (the compliance [rad/(N m)]).

    The own velocity is the instrument for the other's, whose errors are in the angle; of the square of the torque its
    own noise is taken off."""
    matrix, right = np.zeros((2, 2)), np.zeros(2)
    for each in rows:
        own, other, torque = (_about_blocks(values, each) for values in _both(each, delays_s))
        instruments, regressors = np.stack([own[1], torque[0]]), np.stack([other[1], torque[0]])
        matrix += instruments @ regressors.T
        matrix[1, 1] -= torque[0].size * each.torque_noise(0)
        right += instruments @ (own[0] - other[0])
    size = np.sqrt(np.abs(np.diag(matrix)))
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.pinv(matrix / np.outer(size, size)) @ (right / size) / size)


def _about_blocks(values: FloatArray, rows: Rows) -> FloatArray:
    """About the mean of each block, (signals, samples)."""
    length = max(1, round(BLOCK_S / rows.signals.tick_s))
    blocks = values[:, : values.shape[1] // length * length].reshape(len(values), -1, length)
    return np.asarray((blocks - blocks.mean(axis=-1, keepdims=True)).reshape(len(values), -1))


def _both(rows: Rows, delays_s: tuple[float, float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The own angle with its first two derivatives, the other's with three, and the torque with its second: (3,
    samples), (4, samples), (2, samples)."""
    assert rows.signals.other_rad is not None
    own = rows.of_fine_signal(rows.signals.position_rad, (0, 1, 2), delays_s[0])
    other = rows.derivatives(rows.signals.other_rad, (0, 1, 2, 3), delays_s[1])
    return own[:, rows.usable], other[:, rows.usable], rows.torque_derivatives((0, 2))[:, rows.usable]
