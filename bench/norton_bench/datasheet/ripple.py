"""What of the residual goes with the shaft's angle, by its order: cogging, and ripple in proportion to the torque.

Both at once by least squares on what the network leaves of the torque. Deviations are those of sums over blocks of
time, so that no colour of the residual makes them too small; a line that chance could have made is left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from norton_bench.arrays import FloatArray
from norton_bench.identification.residuals.position_lines import HIGHEST_CYCLES
from norton_bench.identification.statistics import sandwich

CHANCE = 0.01
LEVEL = 1.96
BINS = 36


@dataclass(frozen=True)
class Wave:
    """An amplitude with half of its interval of 95 %, and the chance of such a one where there is none."""

    amplitude: float
    half_width: float
    p_value: float

    @property
    def shows(self) -> bool:
        return self.p_value < CHANCE


@dataclass(frozen=True)
class Order:
    """One line: so many periods a turn; cogging [N m] and ripple [share of the motor's torque]."""

    periods_per_turn: float
    cogging_nm: Wave
    ripple: Wave


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


def orders(samples: Samples, lines: Mapping[float, FloatArray]) -> tuple[Order, ...]:
    """The lines of which something shows, the greatest first. ``lines`` are cosine and sine of so many periods a turn
    (2, n), by that number, through the same low-pass as the residual."""
    if not lines:
        return ()
    drive = samples.drive_nm
    waves = np.concatenate(list(lines.values()))
    columns = np.concatenate([waves, drive * waves, [np.ones(drive.size), drive]])
    found, covariance = _fitted(columns.T, samples.residual_nm, samples.time_s)
    told = []
    for place, each in enumerate(lines):
        cogging, ripple = (
            _wave(found[first : first + 2], covariance[first : first + 2, first : first + 2])
            for first in (2 * place, len(waves) + 2 * place)
        )
        told.append(Order(each, cogging, ripple))
    shown = [order for order in told if order.cogging_nm.shows or order.ripple.shows]
    return tuple(sorted(shown, key=lambda order: -order.cogging_nm.amplitude))


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


def _wave(pair: FloatArray, covariance: FloatArray) -> Wave:
    """Of a cosine and a sine: along their phase."""
    amplitude = float(np.hypot(*pair))
    if amplitude == 0.0:
        return Wave(0.0, 0.0, 1.0)
    along = pair / amplitude
    chance = float(chi2.sf(pair @ np.linalg.pinv(covariance, hermitian=True) @ pair, 2))
    return Wave(amplitude, LEVEL * float(np.sqrt(along @ covariance @ along)), chance)
