"""Where the drive that sets the impedance stood under each modulation, by its own encoder.

How far it goes for a command nobody told the bench; but under one modulation it must stand at one place, and under two
at two. A drive that slips or loses count does not, and then a table under that modulation is of several impedances.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from norton_bench.errors import ExperimentError
from norton_bench.identification.quantisation import resolution_rad
from norton_bench.identification.tables.means import COMMAND_DECIMALS
from norton_bench.records import Measured

# A modulation that lasted less was one on the way.
LEAST_S = 1.0
# Only the last part of it counts: before, the drive is still under way.
STOOD_SHARE = 0.5
# Places that differ by no more than this share of the drive's whole way, or so many counts, are one.
SAME_SHARE, SAME_COUNTS = 0.02, 4.0


@dataclass(frozen=True)
class Stood:
    """Under one modulation: the mean place [rad] of each time it was there, in their order."""

    modulation: float
    places_rad: tuple[float, ...]

    @property
    def apart_rad(self) -> float:
        """The furthest that two times lie apart."""
        return float(np.ptp(self.places_rad))


@dataclass(frozen=True)
class ModulatorPlaces:
    """``stood`` by modulation, in increasing order; places within ``same_rad`` are one."""

    stood: tuple[Stood, ...]
    same_rad: float

    @property
    def stray(self) -> Stood | None:
        """The modulation under which it stood at different places, the furthest apart; None where there is none."""
        furthest = max(self.stood, key=lambda each: each.apart_rad)
        return furthest if furthest.apart_rad > self.same_rad else None

    @property
    def followed(self) -> bool:
        """Whether every modulation has one place, and two have two."""
        means = [float(np.mean(each.places_rad)) for each in self.stood]
        told_apart = all(abs(after - before) > self.same_rad for before, after in pairwise(means))
        return self.stray is None and told_apart


def modulator_places(measured: Measured) -> ModulatorPlaces:
    """From all that was recorded. Raises ExperimentError where no modulation was held."""
    found: dict[float, list[float]] = {}
    for modulation, place_rad in _held(measured):
        found.setdefault(modulation, []).append(place_rad)
    if not found:
        raise ExperimentError('no modulation was held: give a step one, such as modulation = "2 N*m/rad"')
    way_rad = float(np.ptp([place for places in found.values() for place in places]))
    same_rad = max(SAME_SHARE * way_rad, SAME_COUNTS * resolution_rad(measured.modulator_motion["position_rad"]))
    return ModulatorPlaces(tuple(Stood(each, tuple(found[each])) for each in sorted(found)), same_rad)


def _held(measured: Measured) -> Iterator[tuple[float, float]]:
    """Each time a modulation was held: which, and the mean place at last [rad]."""
    ticks, motion = measured.ticks, measured.modulator_motion
    modulation = np.round(ticks["modulation"], COMMAND_DECIMALS)
    edges = [0, *(np.flatnonzero(np.diff(modulation) != 0.0) + 1), len(ticks)] if len(motion) else []
    for first, end in pairwise(edges):
        start_ns, end_ns = int(ticks["tick_ns"][first]), int(ticks["tick_ns"][end - 1])
        if end_ns - start_ns < LEAST_S * 1e9 or not np.isfinite(modulation[first]):
            continue
        since_ns = end_ns - round(STOOD_SHARE * (end_ns - start_ns))
        stood = motion[slice(*np.searchsorted(motion["arrival_ns"], [since_ns, end_ns]))]
        if len(stood):
            yield float(modulation[first]), float(np.mean(stood["position_rad"]))
