"""Torque constant and amplifier gain apart: possible only where the amplifier reports its current.

i = Ka·lag_β(c): with the lag known from the torque, the gain is one more linear unknown, and Km = (Km·Ka)/Ka. How well
the lag is known is part of the gain's deviation: in a slow loop, too long a lag makes the gain too great.

A drive that reports its current in steps makes the same error again and again where the current is held, and no number
of readings averages it out: each step that was met is one datum, and its error as likely anywhere within the step.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.fed_back import lag_of_place
from norton_bench.identification.separable import linear_solution
from norton_bench.identification.signals import FINE, Signals
from norton_bench.identification.statistics import sandwich
from norton_bench.models.parameters import BY_NAME, Estimate, Status

DELAY_STEPS = 6
LEAST_READINGS = 50
# Currents come in steps where so many readings share a value; fewer on one do not make it count for less.
READINGS_A_STEP = 20


class Known(NamedTuple):
    """A value and its deviation."""

    value: float
    std: float


@dataclass(frozen=True)
class CurrentFit:
    """Ka [A per command] and Km [N m/A], each with its deviation. Amperes are the drive's own: nothing here
    tells how well its current sensor is calibrated."""

    amplifier_gain: float
    amplifier_gain_std: float
    torque_constant: float
    torque_constant_std: float

    def estimates(self, command_unit: str, gain_status: Status) -> list[Estimate]:
        """As rows of the table; no better than the torque gain they are drawn from."""
        known = (
            ("torque_constant", self.torque_constant, self.torque_constant_std),
            ("amplifier_gain", self.amplifier_gain, self.amplifier_gain_std),
        )
        return [
            Estimate(name, value, std, BY_NAME[name].unit_for(command_unit), gain_status) for name, value, std in known
        ]


def fit_current(
    stretches: tuple[Signals, ...], bandwidth: Known, delay_s: float, torque_gain: Known
) -> CurrentFit | None:
    """None where current was not measured throughout, or says nothing.

    ``bandwidth`` [rad/s] and ``torque_gain`` [N m per command] are what the torque tells. ``delay_s`` is where the
    search for the current's own delay begins: it comes on another wire than the torque.
    """
    readings = [_in_use(stretch) for stretch in stretches]
    target = np.concatenate([value for _, value in readings])
    if target.size < LEAST_READINGS:
        return None
    steps = Steps.of(target)
    weight = np.ones(target.size) if steps is None else steps.weight
    with_lag = partial(_with_lag, stretches, readings, weight, delay_s)
    reached = with_lag(bandwidth.value)
    # Half of what a deviation of the lag to either side makes of the gain; one that nobody knows is off by a factor e.
    relative = min(bandwidth.std / bandwidth.value, 1.0)
    aside = [with_lag(bandwidth.value * float(np.exp(side * relative))) for side in (-1.0, 1.0)]
    if reached is None or aside[0] is None or aside[1] is None:
        return None
    gain, columns, residual = reached
    of_lag = 0.5 * (aside[1].gain - aside[0].gain)
    covariance = sandwich(columns.T, residual, np.concatenate([time_s for time_s, _ in readings]))
    unseen = 0.0 if steps is None else steps.deviation(columns)
    std = float(np.sqrt(covariance[0, 0] + unseen**2 + of_lag**2))
    constant = torque_gain.value / gain
    of_both = np.hypot(std / gain, torque_gain.std / torque_gain.value)
    return CurrentFit(gain, std, float(constant), float(abs(constant) * of_both))


class _Reached(NamedTuple):
    """The gain; the weighted columns (3, m) and residual (m,) with which it was found."""

    gain: float
    columns: FloatArray
    residual: FloatArray


def _with_lag(
    stretches: tuple[Signals, ...],
    readings: list[tuple[FloatArray, FloatArray]],
    weight: FloatArray,
    delay_s: float,
    bandwidth_rad_s: float,
) -> _Reached | None:
    """The gain and the current's delay behind an amplifier of this bandwidth; None where there is no gain."""
    target = np.concatenate([value for _, value in readings])
    for _ in range(DELAY_STEPS):
        parts = [
            _lag(stretch, bandwidth_rad_s, time_s, delay_s)
            for stretch, (time_s, _) in zip(stretches, readings, strict=True)
        ]
        columns = np.concatenate([np.concatenate(parts, axis=1), np.ones((1, target.size))])
        solution = linear_solution(columns * weight, target * weight)
        gain, slope, _bias = solution
        if gain == 0.0:
            return None
        delay_s -= float(np.clip(slope / gain, -1e-3, 1e-3))
    return _Reached(float(gain), columns * weight, (target - solution @ columns) * weight)


@dataclass(frozen=True)
class Steps:
    """Readings that come in steps: the step of each reading, and how wide each step is [A]."""

    index: npt.NDArray[np.intp]
    width: FloatArray

    @classmethod
    def of(cls, readings: FloatArray) -> "Steps | None":
        """None where the readings, shape (m,), come in no steps."""
        levels, index = np.unique(readings, return_inverse=True)
        if levels.size < 2 or readings.size < READINGS_A_STEP * levels.size:
            return None
        return cls(index, np.gradient(levels))

    @property
    def weight(self) -> FloatArray:
        """By which each row is to be multiplied, shape (m,), so that every step weighs the same."""
        met = np.maximum(np.bincount(self.index), READINGS_A_STEP)
        return np.asarray(1.0 / np.sqrt(met[self.index]), dtype=np.float64)

    def deviation(self, weighted: FloatArray) -> float:
        """What the steps' own errors leave unknown of the first parameter; ``weighted`` columns, (parameters, m)."""
        scores = np.stack([np.bincount(self.index, row * self.weight) for row in weighted])
        of_first = np.linalg.solve(weighted @ weighted.T, scores)[0]
        return float(np.sqrt(np.sum((of_first * self.width) ** 2) / 12.0))


def _in_use(stretch: Signals) -> tuple[FloatArray, FloatArray]:
    """Instants and currents, each of shape (m,), where the stretch may be fitted."""
    if stretch.current is None:
        return np.empty(0), np.empty(0)
    nearest = np.round((stretch.current.time_s - stretch.time_s[0]) / stretch.tick_s).astype(np.int64)
    chosen = stretch.usable[np.clip(nearest, 0, stretch.usable.size - 1)]
    return stretch.current.time_s[chosen], stretch.current.value[chosen]


def _lag(stretch: Signals, bandwidth_rad_s: float, read_s: FloatArray, delay_s: float) -> FloatArray:
    """The lagged command, delayed, and its rate at any instants, shape (2, m): exact, so nothing needs filtering.

    A servo's command has the angle and velocity of its shaft taken off.
    """
    at_s = read_s - delay_s
    if not at_s.size:
        return np.empty((2, 0))
    lag = loops.lag_of_held(stretch.sent_s, stretch.command, bandwidth_rad_s, at_s, stretch.released_at_zero)
    held = stretch.command[np.clip(np.searchsorted(stretch.sent_s, at_s, side="right") - 1, 0, None)]
    rate = bandwidth_rad_s * (held - lag)
    if stretch.servo is not None:
        # The drive reports its current with where its shaft is: no delay lies between them.
        fine_s = stretch.tick_s / FINE
        place = lag_of_place(stretch.servo, bandwidth_rad_s, stretch.position_rad, fine_s)
        lag = lag - np.interp(read_s - stretch.time_s[0], np.arange(place.size) * fine_s, place)
    return np.stack([lag, rate])
