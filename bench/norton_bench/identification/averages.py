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


# Displacement [rad], torque [N m] and its half-width in one direction: (places,) each.
Branch = tuple[FloatArray, FloatArray, FloatArray]

# A sweep is read in so many pieces of its time at most, and no fewer readings than this in each.
PIECES, LEAST_READINGS = 40, 24
LEAST_STEP = 0.25  # of their mean step: what is no further on is left out
# Friction is read over this share of the way that both directions have in common: there contacts have turned round.
MIDDLE_SHARE = 0.5


# What the port exerts while it is moved slowly across its source, from one end to the other and back.
#
# A port that is held still lets friction's contacts forget, gradually how they were strained; one that slides does
# not. Half of what lies between both directions is its friction at that speed; in the mean of both, friction drops
# out.
@dataclass(frozen=True)
class Swept:
    """One way across. ``branch`` goes by displacement (θ − θ_N) from the source of its setting, increasing."""

    setting: Setting
    rising: bool
    speed_rad_s: float
    branch: Branch


@dataclass(frozen=True)
class Sweep:
    """Both ``ways`` across, under one setting, and the mean of both.

    ``friction`` [N m] is half of what lies between them, over the middle of the way, at ``speed_rad_s``.
    """

    speed_rad_s: float
    ways: tuple[Branch, Branch]
    mean: Branch
    friction: Mean


def swept(ticks: Table, setting: Setting, rising: bool, source_rad: float) -> Swept | None:
    """From the ticks of one way across; None where too few readings came. Torque is less the sensor's zero."""
    arrival_ns = ticks["tick_ns"] - ticks["torque_age_ns"]
    fresh = np.isfinite(ticks["torque_nm"]) & (np.diff(arrival_ns, prepend=arrival_ns[:1] - 1) > 0)
    torque_nm, pieces = ticks["torque_nm"][fresh], min(PIECES, int(fresh.sum()) // LEAST_READINGS)
    if pieces < 2:
        return None
    # Where the shaft was when the torque was read.
    motion_ns = ticks["tick_ns"] - ticks["motion_age_ns"]
    place_rad = np.interp(arrival_ns[fresh], motion_ns, ticks["position_rad"]) - source_rad
    parts = zip(np.array_split(place_rad, pieces), np.array_split(torque_nm, pieces), strict=True)
    table = np.array(sorted(_onwards([_piece(*part) for part in parts])))
    duration_s = float(ticks["tick_ns"][-1] - ticks["tick_ns"][0]) * 1e-9
    speed_rad_s = abs(float(place_rad[-1] - place_rad[0])) / duration_s
    return Swept(setting, rising, speed_rad_s, (table[:, 0], table[:, 1], table[:, 2]))


def both_ways(rising: Swept, falling: Swept) -> Sweep:
    """One there and one back."""
    places, up_nm, up_half = rising.branch
    common = (places >= falling.branch[0][0]) & (places <= falling.branch[0][-1])
    places, up_nm, up_half = places[common], up_nm[common], up_half[common]
    down_nm, down_half = (np.interp(places, falling.branch[0], column) for column in falling.branch[1:])
    mean = places, 0.5 * (up_nm + down_nm), 0.5 * np.hypot(up_half, down_half)
    speed_rad_s = 0.5 * (rising.speed_rad_s + falling.speed_rad_s)
    return Sweep(speed_rad_s, (rising.branch, falling.branch), mean, _middle(places, 0.5 * (down_nm - up_nm)))


def _onwards(pieces: list[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
    """Those that are further on than the one before: at its ends the port hardly moves while the torque turns round."""
    way_rad = pieces[-1][0] - pieces[0][0]
    least_rad = LEAST_STEP * abs(way_rad) / len(pieces)
    retained = pieces[:1]
    for piece in pieces[1:]:
        if (piece[0] - retained[-1][0]) * np.sign(way_rad) >= least_rad:
            retained.append(piece)
    return retained


def _piece(place_rad: FloatArray, torque_nm: FloatArray) -> tuple[float, float, float]:
    """Mean place and torque, and the latter's half-width about the straight line along the piece."""
    since = np.arange(torque_nm.size) - 0.5 * (torque_nm.size - 1)
    torque = mean_of(torque_nm - float(since @ torque_nm) / float(since @ since) * since)
    return float(np.mean(place_rad)), torque.value, torque.half_width


def _middle(places: FloatArray, apart_nm: FloatArray) -> Mean:
    if places.size < 2:
        return UNKNOWN
    about = np.abs(places - 0.5 * (places[0] + places[-1]))
    chosen = apart_nm[about <= 0.5 * MIDDLE_SHARE * (places[-1] - places[0])]
    if chosen.size < 2:
        return UNKNOWN
    deviation_nm = float(np.std(chosen, ddof=1)) / chosen.size**0.5
    return Mean(float(np.mean(chosen)), t_quantile(0.975, chosen.size - 1) * deviation_nm)
