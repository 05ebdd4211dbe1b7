"""What a modulation π of the impedance changes, and what it leaves alone: from the tables at several of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, groupby, pairwise

import numpy as np

from norton_bench.errors import ExperimentError
from norton_bench.identification.averages import COMMAND_DECIMALS, Mean, Setting
from norton_bench.identification.counts import resolution_of
from norton_bench.identification.exertion_table import ExertionTable, SpringLine
from norton_bench.identification.source_table import SourceTable
from norton_bench.records import Measured

# A modulation that lasted less was one on the way.
LEAST_S = 1.0
# Only the last part of it counts: before, the drive is still under way.
STOOD_SHARE = 0.5
# Places that differ by no more than this share of the drive's whole way, or so many counts, are one.
SAME_SHARE, SAME_COUNTS = 0.02, 4.0


# Where the drive that sets the impedance stood under each modulation, by its own encoder.
#
# How far it goes for a command nobody told the bench; but under one modulation it must stand at one place, and under
# two at two. A drive that slips or loses count does not, and then a table under that modulation is of several
# impedances.
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
    result: dict[float, list[float]] = {}
    for modulation, place_rad in _held(measured):
        result.setdefault(modulation, []).append(place_rad)
    if not result:
        raise ExperimentError('no modulation was held: give a step one, such as modulation = "2 N*m/rad"')
    way_rad = float(np.ptp([place for places in result.values() for place in places]))
    same_rad = max(SAME_SHARE * way_rad, SAME_COUNTS * resolution_of(measured.modulator_motion["position_rad"]).width)
    return ModulatorPlaces(tuple(Stood(each, tuple(result[each])) for each in sorted(result)), same_rad)


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


@dataclass(frozen=True)
class Stiffness:
    """At the source, under one modulation, over all commands: the mean slope [N m/rad].

    The half-width is the widest of any command's, and half of what lies between the commands.
    """

    modulation: float
    stiffness: Mean


@dataclass(frozen=True)
class Shift:
    """How far the source of a command goes between two modulations, at most [rad]; the half-width is of both ends."""

    command: float
    low: float
    high: float
    shift: Mean

    @property
    def shows(self) -> bool:
        """Whether it goes further than the intervals leave open."""
        return abs(self.shift.value) > self.shift.half_width


@dataclass(frozen=True)
class Modulated:
    """``stiffness`` by modulation, in increasing order; ``shift`` is the source's, None where it was read at one alone.

    Of all commands ``shift`` is the one that goes the furthest, counted in half-widths.
    """

    stiffness: tuple[Stiffness, ...]
    shift: Shift | None

    @property
    def stiffens(self) -> bool:
        """Whether the least and the greatest stiffness lie further apart than their intervals leave open."""
        if len(self.stiffness) < 2:
            return False
        ends = [one(self.stiffness, key=lambda row: row.stiffness.value).stiffness for one in (min, max)]
        return ends[1].value - ends[0].value > ends[0].half_width + ends[1].half_width


def modulated(source: SourceTable | None, exertion: ExertionTable | None) -> Modulated | None:
    """None where fewer than two modulations were tabulated."""
    stiffness = () if exertion is None else tuple(_stiffness(exertion.lines()))
    result = Modulated(stiffness, _shift(_places(source, exertion)))
    return result if len(stiffness) > 1 or result.shift is not None else None


def _stiffness(lines: tuple[SpringLine, ...]) -> Iterator[Stiffness]:
    known = [line for line in lines if line.setting.modulation is not None and np.isfinite(line.stiffness.value)]
    known.sort(key=_modulation)
    for modulation, group in groupby(known, key=_modulation):
        own = [line.stiffness for line in group]
        values = [mean.value for mean in own]
        half = max(mean.half_width for mean in own) + float(np.ptp(values)) / 2
        yield Stiffness(modulation, Mean(float(np.mean(values)), half))


def _modulation(line: SpringLine) -> float:
    return line.setting.modulation or 0.0


def _places(source: SourceTable | None, exertion: ExertionTable | None) -> dict[Setting, Mean]:
    """Where the port rested by setting: read from both sides, or else from one, before it was moved."""
    if source is not None and "actuator" in source.ports:
        return {row.setting.rounded: row.position for row in source.rows("actuator")}
    return {} if exertion is None else exertion.sources


def _shift(places: dict[Setting, Mean]) -> Shift | None:
    known = sorted((c, pi, place) for (c, pi), place in places.items() if pi is not None)
    shifts = [
        Shift(command, low, high, _between(here, there))
        for (command, low, here), (other, high, there) in combinations(known, 2)
        if command == other
    ]
    return max(shifts, key=lambda each: abs(each.shift.value) / each.shift.half_width, default=None)


def _between(here: Mean, there: Mean) -> Mean:
    return Mean(there.value - here.value, here.half_width + there.half_width)
