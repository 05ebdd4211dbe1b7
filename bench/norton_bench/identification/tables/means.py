"""Means of what was read while nothing changed, with their 95 % intervals."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.records import Measured, SegmentInfo, Table

# The scatter of the means of so many blocks is that of noise that lasts: control, drift, friction.
BLOCKS = 6
# Commands that agree to so many decimals are one: the wire rounds them.
COMMAND_DECIMALS = 6
T_95 = t_quantile(0.975, BLOCKS - 1)


@dataclass(frozen=True)
class Mean:
    """A value and half of its 95 % interval; NaN where too little was read."""

    value: float
    half_width: float


UNKNOWN = Mean(float("nan"), float("nan"))


def mean_of(values: FloatArray, least: float = 0.0) -> Mean:
    """The mean of values (n,) in order of time, whose half-width is at least ``least``."""
    if len(values) < 2 * BLOCKS:
        return UNKNOWN
    blocks = [float(np.mean(block)) for block in np.array_split(values, BLOCKS)]
    scatter = T_95 * float(np.std(blocks, ddof=1)) / BLOCKS**0.5
    return Mean(float(np.mean(values)), max(scatter, least))


def inside(table: Table, segment: SegmentInfo, stamp: str = "arrival_ns") -> Table:
    """The rows of a segment."""
    first, last = np.searchsorted(table[stamp], [segment.start_ns, segment.end_ns])
    return table[first:last]


class Setting(NamedTuple):
    """What acted while a segment was held: the actuator's command, and its modulator's, None where there is none."""

    command: float
    modulation: float | None = None

    @property
    def rounded(self) -> "Setting":
        """As one and the same key, however the wire rounded it."""
        modulation = None if self.modulation is None else round(self.modulation, COMMAND_DECIMALS)
        return Setting(round(self.command, COMMAND_DECIMALS), modulation)


def modulations_of(settings: Iterable[Setting]) -> tuple[float | None, ...]:
    """Each once, in increasing order."""
    return tuple(sorted({setting.rounded.modulation for setting in settings}, key=lambda each: each or 0.0))


def setting_in(measured: Measured, segment: SegmentInfo) -> Setting:
    """Under what a segment stood."""
    ticks = inside(measured.ticks, segment, "tick_ns")
    modulation = float(np.median(ticks["modulation"]))
    return Setting(float(np.median(ticks["command"])), modulation if isfinite(modulation) else None)


def velocity_of(motion: Table) -> float:
    """Mean velocity [rad/s], as the slope of positions over their arrivals; there must be two of them."""
    time_s = (motion["arrival_ns"] - motion["arrival_ns"][0]) * 1e-9
    time_s = time_s - np.mean(time_s)
    return float(time_s @ motion["position_rad"] / (time_s @ time_s))


def torque_in(measured: Measured, segment: SegmentInfo, resolution_nm: float = 0.0) -> Mean:
    """Port torque in a segment, less the sensor's zero as the bench knew it then."""
    torque_nm = inside(measured.ticks, segment, "tick_ns")["torque_nm"]
    return mean_of(torque_nm[np.isfinite(torque_nm)], resolution_nm)


def line_amplitudes(time_s: FloatArray, values: FloatArray, omega_rad_s: FloatArray) -> tuple[ComplexArray, float]:
    """Amplitudes of sines of known frequencies in readings that come at any times.

    Complex amplitudes (lines,) of the real parts A exp(jωt) in ``values``, and the deviation of either part of
    each.

    Least squares together with a constant and a slope. The deviation is that of what is left, taken as white.
    """
    angle = np.outer(omega_rad_s, time_s)
    columns = np.vstack([np.cos(angle), -np.sin(angle), np.ones_like(time_s), time_s - np.mean(time_s)])
    solution, *_ = np.linalg.lstsq(columns.T, values, rcond=None)
    rest = values - solution @ columns
    lines = len(omega_rad_s)
    free = max(len(values) - len(solution), 1)
    deviation = float(np.sqrt(2 * np.sum(rest**2) / free / len(values)))
    return solution[:lines] + 1j * solution[lines : 2 * lines], deviation
