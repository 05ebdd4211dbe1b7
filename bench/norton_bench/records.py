"""What was measured: raw streams with their own time stamps, and the ticks. The form in which the loop hands data to
the recorder, the identifier and the screen, and in which a recording is read back."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.segments import Use
from norton_drivers.readings import RawFrame

Table = npt.NDArray[np.void]

NO_SEGMENT = -1  # of ticks between two segments, while the loop waits for the session

# One row a tick. Values are the newest known at the tick (NaN before the first); ages are now minus arrival.
TICK = np.dtype(
    [
        ("tick_ns", "i8"),  # the tick's deadline, at which its commands were sent
        ("lateness_ns", "i8"),  # when the tick really began, after its deadline
        ("work_ns", "i8"),  # how long the tick took
        ("segment", "i4"),  # its index, or NO_SEGMENT
        ("command", "f8"),  # actuator command as it was sent: after the guard and the rounding of its wire
        ("wished_load_torque_nm", "f8"),
        ("load_torque_nm", "f8"),  # load command, likewise
        ("torque_nm", "f8"),
        ("torque_age_ns", "i8"),
        ("position_rad", "f8"),
        ("velocity_rad_s", "f8"),
        ("motion_age_ns", "i8"),
        ("load_position_rad", "f8"),
        ("load_velocity_rad_s", "f8"),
        ("load_motion_age_ns", "i8"),
        ("reference_position_rad", "f8"),
        ("reference_velocity_rad_s", "f8"),
        ("transistor_temperature_c", "f8"),
        ("load_transistor_temperature_c", "f8"),
        ("limited", "u4"),  # bit set of the guard's limits that clipped this tick's commands
        ("receive_ns", "i8"),  # how long each stage took: reading all ports,
        ("control_ns", "i8"),  # the sample and what is wished,
        ("guard_ns", "i8"),  # the drives' health and the last word,
        ("send_ns", "i8"),  # writing to all ports,
        ("put_ns", "i8"),  # and, in the tick before, putting it all away
        ("modulation", "f8"),  # the modulator's command as it was sent; NaN where there is none
        ("modulator_position_rad", "f8"),
        ("modulator_motion_age_ns", "i8"),
        ("modulator_transistor_temperature_c", "f8"),
        ("supply_v", "f8"),  # of the actuator's drive; NaN, as temperatures are, where the drive does not tell
        ("load_supply_v", "f8"),
        ("motor_temperature_c", "f8"),
        ("load_motor_temperature_c", "f8"),
    ]
)
MOTION = np.dtype([("arrival_ns", "i8"), ("sequence", "i8"), ("position_rad", "f8"), ("velocity_rad_s", "f8")])
CURRENT = np.dtype([("arrival_ns", "i8"), ("sequence", "i8"), ("current_a", "f8")])
TORQUE = np.dtype(
    [("arrival_ns", "i8"), ("device_ns", "i8"), ("sequence", "i8"), ("torque_nm", "f8"), ("valid", "?")]
)  # device_ns is NO_DEVICE_TIME where the sensor sends none
NO_DEVICE_TIME = np.iinfo(np.int64).min
# The tables of readings in Measured, each with the arrivals of its own device.
READINGS = ("motion", "load_motion", "torque", "current", "load_current", "modulator_motion", "modulator_current")


@dataclass(frozen=True)
class SegmentInfo:
    """Which stretch of time belongs to which segment."""

    index: int
    procedure: str
    name: str
    use: Use
    mode: str
    start_ns: int
    end_ns: int
    preview: bool = False


# What an in-situ experiment takes its load for (norton_bench.identification.in_situ).
LOAD_TAKEN = "load"
# Kinds of events that are for programs: people are told the same in other places.
FOR_PROGRAMS = ("segment", LOAD_TAKEN)


@dataclass(frozen=True)
class Event:
    """Something that happened once, in words."""

    stamp_ns: int
    kind: str  # "stop", "drive", "watchdog", "bus", "device", "operator", "fault", "step" (finished), "answer", "load"
    text: str


@dataclass(frozen=True)
class Chain:
    """What is known of the devices beforehand, and shows in no single reading.

    ``torque_averaging_s`` is the time over which the torque sensor itself averages. ``released_at_zero`` are the roles
    whose drive switches its bridge off at a command of zero: the current then ends without the lag of its loop.
    """

    torque_averaging_s: float = 0.0
    released_at_zero: frozenset[str] = frozenset()


PLAIN_CHAIN = Chain()


@dataclass(frozen=True)
class Measured:
    """Everything measured over a stretch of time. Tables are sorted by time; readings appear once each."""

    ticks: Table = field(default_factory=lambda: np.empty(0, TICK))
    motion: Table = field(default_factory=lambda: np.empty(0, MOTION))  # the actuator's encoder
    load_motion: Table = field(default_factory=lambda: np.empty(0, MOTION))
    torque: Table = field(default_factory=lambda: np.empty(0, TORQUE))
    current: Table = field(default_factory=lambda: np.empty(0, CURRENT))  # the actuator's amplifier
    segments: tuple[SegmentInfo, ...] = ()
    events: tuple[Event, ...] = ()
    frames: tuple[RawFrame, ...] = ()
    load_current: Table = field(default_factory=lambda: np.empty(0, CURRENT))
    chain: Chain = PLAIN_CHAIN
    modulator_motion: Table = field(default_factory=lambda: np.empty(0, MOTION))  # the encoder of the second drive
    modulator_current: Table = field(default_factory=lambda: np.empty(0, CURRENT))

    @property
    def empty(self) -> bool:
        """Whether nothing was measured, and nothing happened."""
        told = bool(self.segments or self.events or self.frames)
        return not told and not any(len(table) for table in (self.ticks, *(getattr(self, name) for name in READINGS)))

    def between(self, start_ns: int, end_ns: int) -> "Measured":
        """The part with ``start_ns <= stamp < end_ns`` (by tick or arrival); frames and events too."""

        def cut(table: Table, key: str) -> Table:
            first, last = np.searchsorted(table[key], [start_ns, end_ns])
            return table[first:last]

        tables: dict[str, Any] = {name: cut(getattr(self, name), "arrival_ns") for name in READINGS}
        return Measured(
            ticks=cut(self.ticks, "tick_ns"),
            **tables,
            segments=tuple(s for s in self.segments if s.start_ns < end_ns and s.end_ns > start_ns),
            events=tuple(e for e in self.events if start_ns <= e.stamp_ns < end_ns),
            frames=tuple(f for f in self.frames if start_ns <= f.stamp_ns < end_ns),
            chain=self.chain,
        )

    def without_frames(self) -> "Measured":
        return replace(self, frames=())


def stacked(tables: Sequence[Table]) -> Table:
    """Tables of one kind, at least one, one after the other."""
    kind = tables[0].dtype
    # As mere bytes: numpy would compare all columns anew for every table.
    return np.concatenate([table.astype(kind, copy=False).view(f"V{kind.itemsize}") for table in tables]).view(kind)


def join(parts: Iterable[Measured]) -> Measured:
    """One after the other, in time order; a segment that spans several parts is named once, with its last end."""
    pieces: Sequence[Measured] = tuple(parts)
    tables = {
        f.name: stacked([getattr(piece, f.name) for piece in pieces])
        for f in fields(Measured)
        if pieces and isinstance(getattr(pieces[0], f.name), np.ndarray)
    }
    segments = {segment.index: segment for piece in pieces for segment in piece.segments}
    return Measured(
        **tables,
        segments=tuple(segments.values()),
        events=tuple(event for piece in pieces for event in piece.events),
        frames=tuple(frame for piece in pieces for frame in piece.frames),
        chain=pieces[0].chain if pieces else PLAIN_CHAIN,
    )
