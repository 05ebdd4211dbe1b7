"""What was measured: raw streams with their own time stamps, and the ticks. The form in which the loop hands data to
the recorder, the identifier and the screen, and in which a recording is read back."""

# ruff: noqa: RUF009 (_table makes a dataclass field)

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from operator import itemgetter
from typing import Annotated, Any, NamedTuple, TypedDict, get_type_hints

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import IntArray
from norton_bench.segments import Segment, Use
from norton_drivers.readings import CurrentReading, MotionReading, RawFrame, TemperatureReading, TorqueReading
from norton_drivers.servo import Servo

Table = npt.NDArray[np.void]

NO_SEGMENT = -1  # of ticks between two segments, while the loop waits for the session


class Tick(TypedDict):
    """One row a tick: its columns, in their order.

    Values are the newest known at the tick (NaN before the first); ages are now minus arrival.
    """

    tick_ns: int  # the tick's deadline, at which its commands were sent
    lateness_ns: int  # when the tick really began, after its deadline
    work_ns: int  # how long the tick took
    segment: Annotated[int, "i4"]  # its index, or NO_SEGMENT
    command: float  # actuator command as it was sent: after the guard and the rounding of its wire
    wished_load_torque_nm: float
    load_torque_nm: float  # load command, likewise
    torque_nm: float
    torque_age_ns: int
    position_rad: float
    velocity_rad_s: float
    motion_age_ns: int
    load_position_rad: float
    load_velocity_rad_s: float
    load_motion_age_ns: int
    reference_position_rad: float
    reference_velocity_rad_s: float
    transistor_temperature_c: float
    load_transistor_temperature_c: float
    limited: Annotated[int, "u4"]  # bit set of the guard's limits that clipped this tick's commands
    receive_ns: int  # how long each stage took: reading all ports,
    control_ns: int  # the sample and what is wished,
    guard_ns: int  # the drives' health and the guard's limits,
    send_ns: int  # writing to all ports,
    put_ns: int  # and, in the tick before, putting it all away
    modulation: float  # the modulator's command as it was sent; NaN where there is none
    modulator_position_rad: float
    modulator_motion_age_ns: int
    modulator_transistor_temperature_c: float
    supply_v: float  # of the actuator's drive; NaN, as temperatures are, where the drive does not report it
    load_supply_v: float
    motor_temperature_c: float
    load_motor_temperature_c: float


# A column's type in recordings, where its annotation does not give another.
CODES = {int: "i8", float: "f8"}
TICK = np.dtype(
    [
        (name, getattr(kind, "__metadata__", ("",))[0] or CODES[kind])
        for name, kind in get_type_hints(Tick, include_extras=True).items()
    ]
)
NO_DEVICE_TIME = np.iinfo(np.int64).min

# One row a reading. ``device_ns`` is NO_DEVICE_TIME where the device sends none.
MOTION = np.dtype(
    [
        ("arrival_ns", "i8"),
        ("sequence", "i8"),
        ("position_rad", "f8"),
        ("velocity_rad_s", "f8"),
        ("device_ns", "i8"),
    ]
)
CURRENT = np.dtype([("arrival_ns", "i8"), ("sequence", "i8"), ("current_a", "f8"), ("device_ns", "i8")])
TORQUE = np.dtype([("arrival_ns", "i8"), ("device_ns", "i8"), ("sequence", "i8"), ("torque_nm", "f8"), ("valid", "?")])

TEMPERATURE = np.dtype([("arrival_ns", "i8"), ("sequence", "i8"), ("temperature_c", "f8")])


class Quantity(NamedTuple):
    """One measured value of a reading: its column, and its name and unit for people."""

    column: str
    name: str
    unit: str


def sent_ns(ticks: Table) -> IntArray:
    """When the commands of each tick were sent, shape (ticks,)."""
    return np.asarray(ticks["tick_ns"] + ticks["lateness_ns"] + ticks["work_ns"])


def has_device_clock(table: Table) -> bool:
    """Whether every row bears the device's own time."""
    stamped = "device_ns" in (table.dtype.names or ()) and len(table) > 0
    return stamped and bool(np.all(table["device_ns"] != NO_DEVICE_TIME))


def _motion_row(reading: MotionReading) -> tuple[float, ...]:
    sequence, arrival_ns, position_rad, velocity_rad_s, device_ns = reading
    return arrival_ns, sequence, position_rad, velocity_rad_s, NO_DEVICE_TIME if device_ns is None else device_ns


def _current_row(reading: CurrentReading) -> tuple[float, ...]:
    sequence, arrival_ns, current_a, device_ns = reading
    return arrival_ns, sequence, current_a, NO_DEVICE_TIME if device_ns is None else device_ns


def _torque_row(reading: TorqueReading) -> tuple[float, ...]:
    sequence, arrival_ns, torque_nm, device_ns, valid = reading
    return arrival_ns, NO_DEVICE_TIME if device_ns is None else device_ns, sequence, torque_nm, valid


@dataclass(frozen=True)
class Kind:
    """A kind of table: one row a message in a recording, whose protobuf message is called ``message``.

    ``stamp`` is the column that gives a row's time. A kind of reading has ``quantities``; ``reading`` is the drivers'
    named tuple, ``take`` the method with which a device gives the new ones, ``instrument`` the part of the device that
    measures, where it is not the device itself. A reading's fields are named like the columns; where a field's value
    is no number, ``convert`` makes a row of a reading.
    """

    message: str
    columns: "np.dtype[np.void]"
    reading: Any = None
    take: str = ""
    quantities: tuple[Quantity, ...] = ()
    instrument: str = ""
    stamp: str = "arrival_ns"
    convert: Callable[[Any], tuple[float, ...]] | None = None

    @cached_property
    def row(self) -> Callable[[Any], tuple[float, ...]]:
        """Makes a row, in the order of the columns, of a reading."""
        return self.convert or itemgetter(*(self.reading._fields.index(name) for name in self.columns.names or ()))


TICKS = Kind("Tick", TICK, stamp="tick_ns")
MOTIONS = Kind(
    "Motion",
    MOTION,
    MotionReading,
    "take_motion",
    (Quantity("position_rad", "angle", "rad"), Quantity("velocity_rad_s", "velocity", "rad/s")),
    instrument="encoder",
    convert=_motion_row,
)
CURRENTS = Kind(
    "Current",
    CURRENT,
    CurrentReading,
    "take_current",
    (Quantity("current_a", "current", "A"),),
    convert=_current_row,
)
TORQUES = Kind(
    "Torque",
    TORQUE,
    TorqueReading,
    "take_torque",
    (Quantity("torque_nm", "torque", "N*m"),),
    convert=_torque_row,
)
TEMPERATURES = Kind(
    "Temperature",
    TEMPERATURE,
    TemperatureReading,
    "take_temperature",
    (Quantity("temperature_c", "temperature", "°C"),),
)


@dataclass(frozen=True)
class Stream:
    """The readings of one kind that one device gives: a line in the table of signals, :class:`Measured`.

    ``role`` is the device's section in the rig file, ``topic`` the stream's place in a recording, ``label`` its name
    for people, ``age`` the column of ``TICK`` with the age of its newest reading ("" where ticks do not hold it).
    Nothing is measured without a ``required`` stream of a device that the rig has.
    """

    kind: Kind
    topic: str
    role: str = ""
    label: str = ""
    age: str = ""
    required: bool = False
    name: str = ""  # of its field in Measured, and of its table in exports

    @property
    def source(self) -> str:
        """The instrument for people, such as "actuator encoder"."""
        return f"{self.role.replace('_', ' ')} {self.kind.instrument}".rstrip()


def _table(stream: Stream) -> Any:
    """A field of :class:`Measured`: an empty table unless it is given."""
    return field(default_factory=lambda: np.empty(0, stream.kind.columns), metadata={"stream": stream})


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

    @staticmethod
    def of(segment: Segment, index: int, start_ns: int, end_ns: int) -> "SegmentInfo":
        """A segment as it is recorded: the ``index``-th that was run, until ``end_ns``, or that has run so far."""
        mode = segment.mode.value
        return SegmentInfo(index, segment.procedure, segment.name, segment.use, mode, start_ns, end_ns, segment.preview)


# What an in-situ experiment takes its load for (norton_bench.identification.in_situ).
LOAD_TAKEN = "load"
# Kinds of events that are for programs: people read the same in other places.
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
    ``servo`` is the actuator's own loop, where its command is a position or a velocity. ``answers_commands`` are the
    roles whose drive takes its readings when a command arrives, and answers with them.
    """

    torque_averaging_s: float = 0.0
    released_at_zero: frozenset[str] = frozenset()
    servo: Servo | None = None
    answers_commands: frozenset[str] = frozenset()


PLAIN_CHAIN = Chain()


@dataclass(frozen=True)
class Measured:
    """Everything measured over a stretch of time, and the table of signals: each stream of readings is one line here.

    Whatever handles all streams alike follows from these lines: what the loop takes from the devices and hands on,
    recordings and exports, what is shown and reported, and the sections that a rig file may have. See
    docs/adding-a-signal.md for how to add one.

    Tables are sorted by time; every reading stands in them once.
    """

    ticks: Table = _table(Stream(TICKS, "/ticks"))
    motion: Table = _table(
        Stream(MOTIONS, "/actuator/motion", "actuator", "actuator motion", "motion_age_ns", required=True)
    )
    load_motion: Table = _table(
        Stream(MOTIONS, "/load/motion", "load", "load motion", "load_motion_age_ns", required=True)
    )
    torque: Table = _table(Stream(TORQUES, "/torque", "torque_sensor", "port torque", "torque_age_ns", required=True))
    current: Table = _table(Stream(CURRENTS, "/actuator/current", "actuator", "actuator current"))
    segments: tuple[SegmentInfo, ...] = ()
    events: tuple[Event, ...] = ()
    frames: tuple[RawFrame, ...] = ()
    load_current: Table = _table(Stream(CURRENTS, "/load/current", "load", "load current"))
    chain: Chain = PLAIN_CHAIN
    modulator_motion: Table = _table(
        Stream(MOTIONS, "/modulator/motion", "modulator", "modulator motion", "modulator_motion_age_ns", required=True)
    )
    modulator_current: Table = _table(Stream(CURRENTS, "/modulator/current", "modulator", "modulator current"))
    temperature: Table = _table(Stream(TEMPERATURES, "/temperature", "temperature_sensor", "housing temperature"))

    @property
    def empty(self) -> bool:
        """Whether nothing was measured, and nothing happened."""
        happened = self.segments or self.events or self.frames
        return not happened and not any(len(getattr(self, table.name)) for table in TABLES)

    def between(self, start_ns: int, end_ns: int) -> "Measured":
        """The part with ``start_ns <= stamp < end_ns`` (by tick or arrival); frames and events too."""

        def cut(name: str, stamp: str) -> Table:
            table: Table = getattr(self, name)
            first, last = np.searchsorted(table[stamp], [start_ns, end_ns])
            return table[first:last]

        tables: dict[str, Any] = {each.name: cut(each.name, each.kind.stamp) for each in TABLES}
        return Measured(
            **tables,
            segments=tuple(s for s in self.segments if s.start_ns < end_ns and s.end_ns > start_ns),
            events=tuple(e for e in self.events if start_ns <= e.stamp_ns < end_ns),
            frames=tuple(f for f in self.frames if start_ns <= f.stamp_ns < end_ns),
            chain=self.chain,
        )

    def without_frames(self) -> "Measured":
        return replace(self, frames=())


# The tables of Measured, the ticks first; and those of readings, the signals.
TABLES: tuple[Stream, ...] = tuple(
    replace(each.metadata["stream"], name=each.name) for each in fields(Measured) if "stream" in each.metadata
)
STREAMS = TABLES[1:]


def stacked(tables: Sequence[Table]) -> Table:
    """Tables of one kind, at least one, one after the other."""
    kind = tables[0].dtype
    # As mere bytes: numpy would compare all columns anew for every table.
    return np.concatenate([table.astype(kind, copy=False).view(f"V{kind.itemsize}") for table in tables]).view(kind)


def join(parts: Iterable[Measured]) -> Measured:
    """One after the other, in time order; a segment that spans several parts is named once, with its last end."""
    pieces: Sequence[Measured] = tuple(parts)
    tables: dict[str, Any] = {
        each.name: stacked([getattr(piece, each.name) for piece in pieces]) for each in TABLES if pieces
    }
    segments = {segment.index: segment for piece in pieces for segment in piece.segments}
    return Measured(
        **tables,
        segments=tuple(segments.values()),
        events=tuple(event for piece in pieces for event in piece.events),
        frames=tuple(frame for piece in pieces for frame in piece.frames),
        chain=pieces[0].chain if pieces else PLAIN_CHAIN,
    )
