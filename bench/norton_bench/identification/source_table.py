"""The static source as measured: where the free port rests under each command, reached from either side."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from norton_bench.errors import ExperimentError
from norton_bench.identification.averages import (
    Mean,
    Setting,
    inside,
    mean_of,
    modulations_of,
    setting_in,
    torque_in,
    velocity_of,
)
from norton_bench.identification.counts import resolution_of
from norton_bench.records import Measured, SegmentInfo
from norton_bench.segments import READ, TABULATE_SOURCE

# The names of the procedure that measures it, and of its segments: "read actuator", "read external", then "leave".
LEAVE = "leave"
# While it was read the shaft may have drifted by this share of the table's span, or by so many counts, to be at rest.
DRIFT_SHARE = 0.01
DRIFT_COUNTS = 4.0
# And it is settled once it stays within this share of the way from where it was before.
SETTLED_SHARE = 0.02


@dataclass(frozen=True)
class SourceLevel:
    """One reading. ``rising`` says from which side the command came; ``port`` is "actuator" or "external".

    ``settling_s`` is how long, from the end of the command's change, the shaft took until it stayed within 2 % of its
    way; ``settled`` whether it rested while it was read. ``torque`` is that at the sensor [N m], ``position`` the
    actuator's encoder [rad], ``velocity_rad_s`` how fast the shaft went on moving.
    """

    port: str
    setting: Setting
    rising: bool
    position: Mean
    torque: Mean
    velocity_rad_s: float
    settled: bool
    settling_s: float


@dataclass(frozen=True)
class SourceRow:
    """One setting at one port: both branches taken together. ``gap_rad`` is rising less falling, NaN without both.

    The half-width has half of the gap in it: friction or backlash may leave the port anywhere between. A command that
    was reached from one side alone takes the widest gap of all.
    """

    port: str
    setting: Setting
    position: Mean
    gap_rad: float
    torque: Mean
    settled: bool

    def loosened(self, by_rad: float) -> "SourceRow":
        """The same, known less well."""
        return replace(self, position=Mean(self.position.value, self.position.half_width + by_rad))


@dataclass(frozen=True)
class SourceTable:
    """All readings, in the order in which they were made."""

    levels: tuple[SourceLevel, ...]

    @property
    def ports(self) -> tuple[str, ...]:
        """Those that were measured."""
        return tuple(dict.fromkeys(level.port for level in self.levels))

    @property
    def modulations(self) -> tuple[float | None, ...]:
        """Those that were measured, in increasing order; (None,) without a modulator."""
        return modulations_of(level.setting for level in self.levels)

    def branch(self, port: str, rising: bool, modulation: float | None = None) -> tuple[SourceLevel, ...]:
        """By command."""
        chosen = (
            level
            for level in self.levels
            if (level.port, level.rising, level.setting.rounded.modulation) == (port, rising, modulation)
        )
        return tuple(sorted(chosen, key=lambda level: level.setting))

    def rows(self, port: str) -> tuple[SourceRow, ...]:
        """One for each command and modulation, in their order."""
        by_setting: dict[Setting, list[SourceLevel]] = {}
        for level in self.levels:
            if level.port == port:
                by_setting.setdefault(level.setting.rounded, []).append(level)
        rows = tuple(_row(port, by_setting[setting]) for setting in sorted(by_setting))
        widest_rad = max((abs(row.gap_rad) for row in rows if isfinite(row.gap_rad)), default=0.0)
        return tuple(row if isfinite(row.gap_rad) else row.loosened(widest_rad / 2) for row in rows)


@dataclass(frozen=True)
class _Reading:
    """Where a reading stands in the recording. ``began_ns`` is when the command had arrived at its value."""

    segment: SegmentInfo
    began_ns: int
    setting: Setting
    rising: bool
    position: Mean


def source_table(measured: Measured) -> SourceTable:
    """From every reading that was made. Raises ExperimentError where there is none."""
    count_rad = resolution_of(measured.motion["position_rad"]).width if len(measured.motion) else 0.0
    readings = [each for each in _readings(measured, count_rad) if np.isfinite(each.position.value)]
    if not readings:
        raise ExperimentError(f"no source was tabulated: run the step '{TABULATE_SOURCE}'")
    span_rad = float(np.ptp([each.position.value for each in readings]))
    return SourceTable(tuple(_level(measured, each, count_rad, span_rad) for each in readings))


def _readings(measured: Measured, count_rad: float) -> Iterator[_Reading]:
    began_ns, before = 0, 0.0
    for segment in measured.segments:
        if segment.procedure == TABULATE_SOURCE and segment.name == "move":
            began_ns = segment.end_ns
        if segment.procedure == TABULATE_SOURCE and segment.name.startswith(READ):
            setting = setting_in(measured, segment)
            position = mean_of(inside(measured.motion, segment)["position_rad"], count_rad / 2)
            yield _Reading(segment, began_ns, setting, setting.command >= before, position)
            before = setting.command
        if segment.procedure == TABULATE_SOURCE and segment.name == LEAVE:
            before = 0.0


def _level(measured: Measured, reading: _Reading, count_rad: float, span_rad: float) -> SourceLevel:
    motion = inside(measured.motion, reading.segment)
    velocity_rad_s = velocity_of(motion)
    drift_rad = velocity_rad_s * float(motion["arrival_ns"][-1] - motion["arrival_ns"][0]) * 1e-9
    return SourceLevel(
        reading.segment.name.removeprefix(f"{READ} "),
        reading.setting,
        reading.rising,
        reading.position,
        torque_in(measured, reading.segment),
        velocity_rad_s,
        abs(drift_rad) <= max(DRIFT_SHARE * span_rad, DRIFT_COUNTS * count_rad),
        _settling_s(measured, reading, count_rad),
    )


def _settling_s(measured: Measured, reading: _Reading, count_rad: float) -> float:
    """From the end of the command's change until the shaft stays near where it was read."""
    motion = measured.motion
    first, last = np.searchsorted(motion["arrival_ns"], [reading.began_ns, reading.segment.end_ns])
    way_rad = np.abs(motion["position_rad"][first:last] - reading.position.value)
    if not way_rad.size:
        return float("nan")
    band_rad = max(SETTLED_SHARE * float(way_rad[0]), DRIFT_COUNTS * count_rad, 2 * reading.position.half_width)
    away = np.flatnonzero(way_rad > band_rad)
    return 0.0 if not away.size else float(motion["arrival_ns"][first + away[-1]] - reading.began_ns) * 1e-9


def _row(port: str, levels: Sequence[SourceLevel]) -> SourceRow:
    """Both branches together; the half-width is that of either, and half of what lies between them."""
    ends = {
        rising: float(np.mean([level.position.value for level in levels if level.rising is rising]))
        for rising in (True, False)
        if any(level.rising is rising for level in levels)
    }
    gap_rad = ends[True] - ends[False] if len(ends) == 2 else float("nan")
    half_rad = float(np.max([level.position.half_width for level in levels]))
    torque_nm = float(np.mean([level.torque.value for level in levels]))
    return SourceRow(
        port,
        levels[0].setting,
        Mean(float(np.mean(list(ends.values()))), half_rad + (abs(gap_rad) / 2 if len(ends) == 2 else 0.0)),
        gap_rad,
        Mean(torque_nm, float(np.max([level.torque.half_width for level in levels]))),
        all(level.settled for level in levels),
    )
