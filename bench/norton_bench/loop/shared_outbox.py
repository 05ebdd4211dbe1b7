"""The outbox of a loop in a process of its own: every tick goes into shared memory, where the session finds it.

What the loop has put there survives the loop: killed in the middle of a tick, it takes that tick with it and no other.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from struct import Struct
from typing import Any

import numpy as np

from norton_bench.loop.devices import Arrivals
from norton_bench.loop.ring import Ring, RingReader, RingWriter
from norton_bench.records import STREAMS, TABLES, TICK, Event, Measured, SegmentInfo, Table
from norton_bench.rig.rig import Rig
from norton_drivers.readings import RawFrame

# A session that looks away for this long loses nothing; what it may lose is counted.
KEPT_S = 8.0
# Of each stream, for a sensor faster than the loop, and of frames, for both directions of every device.
READINGS_A_TICK, FRAMES_A_TICK = 4, 16
EVENTS = 256

CODES = {"i8": "q", "i4": "i", "u4": "I", "f8": "d", "b1": "?"}
# A frame's stamp, identifier, channel by its place, marks, count of bytes, bytes. Longer chunks take several records.
FRAME = Struct("<qiBBB64s")
FRAME_BYTES = 64
SENT, EXTENDED, REMOTE = 1, 2, 4
# An event's stamp, kind and text; what is longer is cut.
EVENT = Struct("<q16s1000s")


class SharedMemory:
    """A ring for every table, one for frames and one for events; goes to the loop's process as an argument."""

    def __init__(self, rig: Rig) -> None:
        wiring = rig.wiring
        ports = [device.port for device in wiring.devices() if device.port]
        self.channels = (*(bus.name for bus in wiring.buses), *dict.fromkeys(ports))
        ticks = round(KEPT_S / rig.tick_s)
        self.tables = {
            table.name: Ring(ticks * (READINGS_A_TICK if table in STREAMS else 1), table.kind.columns.itemsize)
            for table in TABLES
        }
        self.frames = Ring(ticks * FRAMES_A_TICK, FRAME.size)
        self.events = Ring(EVENTS, EVENT.size)


class SharedOutbox:
    """What the loop puts its ticks into, instead of :class:`norton_bench.loop.outbox.Outbox`: nothing piles up here."""

    def __init__(self, memory: SharedMemory) -> None:
        rings = {name: RingWriter(ring) for name, ring in memory.tables.items()}
        self._tick, self._tick_ring = _struct(TICK), rings["ticks"]
        # Of each stream: what makes a row of a reading, packs it, and puts it into its ring.
        self._streams = {
            stream.name: (stream.kind.row, _struct(stream.kind.columns).pack, rings[stream.name].put)
            for stream in STREAMS
        }
        self._frame_ring, self._event_ring = RingWriter(memory.frames), RingWriter(memory.events)
        self._places = {channel: place for place, channel in enumerate(memory.channels)}
        self._frames: list[RawFrame] = []

    def put(self, row: tuple[float, ...], arrivals: Arrivals) -> bool:
        """One tick's row (in the order of TICK), what arrived, and the frames of both."""
        for name, readings in arrivals.items():
            values, pack, put = self._streams[name]
            for reading in readings:
                put(pack(*values(reading)))
        self.put_waiting()
        self._tick_ring.put(self._tick.pack(*row))
        return False

    def put_frame(self, frame: RawFrame) -> None:
        """Kept until the tick's end, or the next wait: a command that waits for its turn is worth more."""
        self._frames.append(frame)

    def put_waiting(self) -> None:
        """The frames so far."""
        put, places, pack = self._frame_ring.put, self._places, FRAME.pack
        for stamp_ns, channel, sent, data, identifier, extended, remote in self._frames:
            marks = SENT * sent | EXTENDED * extended | REMOTE * remote
            place = places[channel]
            if len(data) <= FRAME_BYTES:
                put(pack(stamp_ns, identifier, place, marks, len(data), data))
                continue
            for at in range(0, len(data), FRAME_BYTES):
                piece = data[at : at + FRAME_BYTES]
                put(pack(stamp_ns, identifier, place, marks, len(piece), piece))
        self._frames.clear()

    def put_event(self, stamp_ns: int, kind: str, text: str) -> None:
        self._event_ring.put(EVENT.pack(stamp_ns, kind.encode(), text.encode()))

    def hand_on(self, segment: SegmentInfo | None = None) -> Measured:
        """The session finds all of it by itself; only the segment it belongs to is left to return."""
        self.put_waiting()
        return Measured(segments=() if segment is None else (segment,))


@dataclass
class SharedInbox:
    """The session's end: what the loop has put into ``memory``, as tables. ``lost`` counts records never read."""

    memory: SharedMemory
    lost: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._tables = {name: RingReader(ring) for name, ring in self.memory.tables.items()}
        self._frames, self._events = RingReader(self.memory.frames), RingReader(self.memory.events)

    @property
    def ticks(self) -> int:
        """How many there have been: a loop whose count stands still does not run."""
        return self._tables["ticks"].written

    def take(self) -> Measured:
        """What has come since the last call; without the segment it belongs to."""
        events, frames = tuple(self._new_events()), tuple(self._new_frames())
        tables: dict[str, Any] = {
            table.name: _table(self._all(self._tables[table.name]), table.kind.columns) for table in TABLES
        }
        return Measured(**tables, events=events, frames=frames)

    def skip(self) -> None:
        """Pass over what has not been taken."""
        for reader in (*self._tables.values(), self._frames, self._events):
            reader.skip()

    def _all(self, reader: RingReader) -> bytes:
        records, lost = reader.take()
        self.lost += lost
        return records

    def _new_frames(self) -> Iterator[RawFrame]:
        channels = self.memory.channels
        for stamp_ns, identifier, place, marks, size, data in FRAME.iter_unpack(self._all(self._frames)):
            sent, extended, remote = bool(marks & SENT), bool(marks & EXTENDED), bool(marks & REMOTE)
            yield RawFrame(stamp_ns, channels[place], sent, data[:size], identifier, extended, remote)

    def _new_events(self) -> Iterator[Event]:
        for stamp_ns, kind, text in EVENT.iter_unpack(self._all(self._events)):
            yield Event(stamp_ns, _text(kind), _text(text))


def _struct(kind: "np.dtype[np.void]") -> Struct:
    """A row of a table of this kind, packed as numpy packs it."""
    return Struct("<" + "".join(CODES[kind[name].str.lstrip("<|=")] for name in kind.names or ()))


def _table(records: bytes, kind: "np.dtype[np.void]") -> Table:
    """As any other table: code is compiled anew for those that cannot be written to."""
    return np.frombuffer(records, kind).copy()


def _text(padded: bytes) -> str:
    """A cut may have left half a letter."""
    return padded.rstrip(b"\0").decode(errors="ignore")
