"""What the port exerts while it is moved slowly across its source, from one end to the other and back.

A port that is held still lets friction's contacts forget, by and by, how they were strained; one that slides does not.
Half of what lies between both directions is its friction at that speed; in the mean of both, friction drops out.
"""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.identification.tables.means import UNKNOWN, Mean, Setting, mean_of
from norton_bench.records import Table

# Displacement [rad], torque [N m] and its half-width in one direction: (places,) each.
Branch = tuple[FloatArray, FloatArray, FloatArray]

# A sweep is read in so many pieces of its time at most, and no fewer readings than this in each.
PIECES, LEAST_READINGS = 40, 24
LEAST_STEP = 0.25  # of their mean step: what is no further on is left out
# Friction is read over this share of the way that both directions have in common: there contacts have turned round.
MIDDLE_SHARE = 0.5


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
    kept = pieces[:1]
    for piece in pieces[1:]:
        if (piece[0] - kept[-1][0]) * np.sign(way_rad) >= least_rad:
            kept.append(piece)
    return kept


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
