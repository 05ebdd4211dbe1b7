"""What a modulation π of the impedance changes, and what it leaves alone: from the tables at several of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, groupby

import numpy as np

from norton_bench.identification.tables.exertion_table import ExertionTable, Line
from norton_bench.identification.tables.means import Mean, Setting
from norton_bench.identification.tables.source_table import SourceTable


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
    found = Modulated(stiffness, _shift(_places(source, exertion)))
    return found if len(stiffness) > 1 or found.shift is not None else None


def _stiffness(lines: tuple[Line, ...]) -> Iterator[Stiffness]:
    known = [line for line in lines if line.setting.modulation is not None and np.isfinite(line.stiffness.value)]
    known.sort(key=_modulation)
    for modulation, group in groupby(known, key=_modulation):
        own = [line.stiffness for line in group]
        values = [mean.value for mean in own]
        half = max(mean.half_width for mean in own) + float(np.ptp(values)) / 2
        yield Stiffness(modulation, Mean(float(np.mean(values)), half))


def _modulation(line: Line) -> float:
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
