"""What of the residual goes with the shaft's angle, by its order: cogging, ripple in proportion to the torque, and
errors of the angle itself.

All at once by least squares on what the network leaves of the torque. An encoder's error that repeats with the angle
looks like a torque that grows with the square of the velocity, because it is felt as an acceleration: it has columns
of its own, or fast motion would take it for cogging. Deviations are those of sums over blocks of time, so that no
colour of the residual makes them too small. A line that the search could have found by chance is left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import f_tail, t_quantile
from norton_bench.identification.residual_tests import HIGHEST_CYCLES, looked_at
from norton_bench.identification.statistics import BLOCKS_S, sandwich

# A recording without any line shows one this seldom, whatever kind it seems to be of.
CHANCE = 0.01
KINDS = 3
LEVEL = 1.96
BINS = 36


@dataclass(frozen=True)
class Wave:
    """An amplitude with half of its interval of 95 %, and the chance that a search finds such a one where there is
    none."""

    amplitude: float
    half_width: float
    p_value: float

    @property
    def shows(self) -> bool:
        return self.p_value < CHANCE


@dataclass(frozen=True)
class Order:
    """One line: so many periods a turn; cogging [N m], ripple [share of the motor's torque], error of the angle."""

    periods_per_turn: float
    cogging_nm: Wave
    ripple: Wave
    angle_error_rad: Wave

    @property
    def is_torque(self) -> bool:
        return self.cogging_nm.shows or self.ripple.shows


@dataclass(frozen=True)
class OrderWave:
    """Of one order, through the same low-pass as the residual, each (2, n): cosine and sine of the angle, and the
    torque [N m/rad] that the network makes of an error of the angle of that form."""

    wave: FloatArray
    of_error: FloatArray


@dataclass(frozen=True)
class Samples:
    """Of the residual, arrays (n,): NaN nowhere. ``drive_nm`` is the motor's torque, ``tick_s`` that of the band."""

    time_s: FloatArray
    position_rad: FloatArray
    velocity_rad_s: FloatArray
    drive_nm: FloatArray
    residual_nm: FloatArray
    tick_s: float


@dataclass(frozen=True)
class Folded:
    """The residual over one period of the strongest order: middle of each bin [rad], mean and half of its interval
    [N m], all (BINS,)."""

    angle_rad: FloatArray
    mean_nm: FloatArray
    half_width_nm: FloatArray


def orders(samples: Samples, lines: Mapping[float, OrderWave]) -> tuple[Order, ...]:
    """The lines of which something shows, the greatest cogging first; ``lines`` by their periods a turn."""
    if not lines:
        return ()
    drive = samples.drive_nm
    waves = np.concatenate([each.wave for each in lines.values()])
    errors = np.concatenate([each.of_error for each in lines.values()])
    columns = np.concatenate([waves, drive * waves, errors, [np.ones(drive.size), drive]])
    result, covariance = _fitted(columns.T, samples.residual_nm, samples.time_s)
    chances = KINDS * looked_at(samples.position_rad)
    blocks = _blocks(samples.time_s)
    told = []
    for place, each in enumerate(lines):
        pairs = (slice(first, first + 2) for first in range(2 * place, KINDS * len(waves), len(waves)))
        told.append(Order(each, *(_wave(result[at], covariance[at, at], blocks, chances) for at in pairs)))
    shown = [order for order in told if order.is_torque or order.angle_error_rad.shows]
    return tuple(sorted(shown, key=lambda order: (not order.is_torque, -order.cogging_nm.amplitude)))


def _blocks(time_s: FloatArray) -> int:
    """How many of the longest blocks that the covariance is summed over hold anything: its degrees of freedom."""
    return int(np.unique(((time_s - time_s[0]) / BLOCKS_S[-1]).astype(np.int64)).size)


def folded(samples: Samples, periods_per_turn: float) -> Folded:
    """Over one period, by the mean of each block of time in each bin."""
    slow = np.abs(samples.velocity_rad_s) * samples.tick_s / (2 * np.pi) * periods_per_turn < HIGHEST_CYCLES
    period_rad = 2 * np.pi / periods_per_turn
    share = np.mod(samples.position_rad[slow], period_rad) / period_rad
    index = np.minimum((share * BINS).astype(int), BINS - 1)
    columns = np.eye(BINS)[index]
    mean, covariance = _fitted(columns, samples.residual_nm[slow], samples.time_s[slow])
    half_width = LEVEL * np.sqrt(np.diag(covariance))
    return Folded((np.arange(BINS) + 0.5) / BINS * period_rad, mean, half_width)


def _fitted(columns: FloatArray, residual: FloatArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (k,) and their covariance, of columns (n, k)."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    values = np.linalg.lstsq(columns / scale, residual, rcond=1e-10)[0] / scale
    return values, sandwich(columns, residual - columns @ values, time_s)


def _wave(pair: FloatArray, covariance: FloatArray, blocks: int, chances: float) -> Wave:
    """Of a cosine and a sine: along their phase. The covariance is itself known from so many blocks only (Hotelling's
    T², Student's t), and the line was chosen from so many ``chances`` (Bonferroni)."""
    amplitude, freedom = float(np.hypot(*pair)), blocks - 1
    if amplitude == 0.0 or freedom < 2:
        return Wave(amplitude, float("inf"), 1.0)
    along = pair / amplitude
    distance = float(pair @ np.linalg.pinv(covariance, hermitian=True) @ pair)
    chance = float(f_tail((freedom - 1) / (2 * freedom) * distance, 2, freedom - 1))
    half_width = float(t_quantile(0.975, freedom) * np.sqrt(along @ covariance @ along))
    return Wave(amplitude, half_width, min(1.0, chances * chance))
