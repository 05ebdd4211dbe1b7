"""Messages of the experiment's process to the recording process: pickles, each after its length."""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import BinaryIO

from norton_bench.recording.contents import EstimatesLike, RecordedEstimates
from norton_bench.recording.disk import RESERVE_BYTES
from norton_bench.records import TABLES, Event, Measured, SegmentInfo
from norton_drivers.readings import RawFrame

_LENGTH_BYTES = 8


@dataclass(frozen=True)
class Start:
    """The file, which is there and empty, and what is known before the first sample.

    ``candump`` is the log beside it, likewise there and empty, or "". ``reserve_bytes`` are kept back on the disk.
    ``wall_time`` says that parts come whether they are taken or not.
    """

    path: str
    rig_text: str
    metadata: Mapping[str, str]
    candump: str = ""
    reserve_bytes: int = RESERVE_BYTES
    wall_time: bool = False


@dataclass(frozen=True)
class Frames:
    """Raw frames as columns, those of :class:`RawFrame`: a tenth of the cost of sending them as objects."""

    stamp_ns: tuple[int, ...] = ()
    channel: tuple[str, ...] = ()
    sent: tuple[bool, ...] = ()
    data: tuple[bytes, ...] = ()
    arbitration_id: tuple[int, ...] = ()
    extended: tuple[bool, ...] = ()
    remote: tuple[bool, ...] = ()
    fd: tuple[bool, ...] = ()
    switched: tuple[bool, ...] = ()

    @staticmethod
    def of(frames: tuple[RawFrame, ...]) -> "Frames":
        return Frames(*zip(*frames, strict=True))


@dataclass(frozen=True)
class Part:
    """A stretch of measurements; ``tables`` holds the bytes of each table that has rows."""

    tables: Mapping[str, bytes]
    segments: tuple[SegmentInfo, ...] = ()
    events: tuple[Event, ...] = ()
    frames: Frames = field(default_factory=Frames)


@dataclass(frozen=True)
class Stop:
    """The end, in good order."""

    dropped_parts: int


Message = Start | Part | RecordedEstimates | Stop


def part_of(measured: Measured) -> Part:
    """``measured`` in the form that travels."""
    tables = {table.name: getattr(measured, table.name) for table in TABLES}
    return Part(
        tables={name: table.tobytes() for name, table in tables.items() if len(table)},
        segments=measured.segments,
        events=measured.events,
        frames=Frames.of(measured.frames),
    )


def estimates_of(live: EstimatesLike) -> RecordedEstimates:
    """``live`` in the form that travels."""
    return RecordedEstimates(live.stamp_ns, live.samples, live.estimates)


def send(pipe: BinaryIO, message: Message) -> None:
    """Raises OSError where nobody reads any more."""
    data = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
    view = memoryview(len(data).to_bytes(_LENGTH_BYTES, "little") + data)
    while view:
        view = view[pipe.write(view) :]
    pipe.flush()


def receive(pipe: BinaryIO) -> Message | None:
    """The next message, or None where the sender is gone."""
    prefix = pipe.read(_LENGTH_BYTES)
    if len(prefix) < _LENGTH_BYTES:
        return None
    length = int.from_bytes(prefix, "little")
    data = pipe.read(length)
    if len(data) < length:
        return None
    message: Message = pickle.loads(data)
    return message
