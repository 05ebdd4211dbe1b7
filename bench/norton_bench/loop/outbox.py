"""Where a tick puts what it saw and did: into lists, or into memory that the loop's process shares with its session."""

import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.sharedctypes import RawArray
from struct import Struct
from threading import Lock
from typing import Any, NamedTuple, Protocol

import numpy as np

from norton_bench.loop.devices import Arrivals
from norton_bench.records import (
    PLAIN_CHAIN,
    STREAMS,
    TABLES,
    TICK,
    Chain,
    Event,
    Measured,
    SegmentInfo,
    Stream,
    Table,
    Tick,
)
from norton_bench.rig.rig import Rig
from norton_drivers.readings import RawFrame

Consumer = Callable[[Measured], None]

# Parts of 100 ms: what a crash may lose, and what the live identifier digests at a time.
PART_TICKS = 100


class Outlet(Protocol):
    """What the loop asks of its outbox."""

    @property
    def put_frame(self) -> Callable[[RawFrame], None]:
        """Takes every frame of both directions, until the next tick or wait."""
        ...

    def put(self, row: Tick, arrivals: Arrivals) -> bool:
        """A tick's row and what arrived; True where it is time to hand on."""
        ...

    def put_waiting(self) -> None:
        """Put away what has come so far: called while the loop waits, and nothing waits for it."""
        ...

    def put_event(self, stamp_ns: int, kind: str, text: str) -> None: ...
    def hand_on(self, segment: SegmentInfo | None = None) -> Measured:
        """Let go of what has been collected; ``segment`` is what it belongs to so far."""
        ...


@dataclass
class Outbox:
    """Collects rows and readings; every ``part_ticks`` ticks it hands one part to each consumer, in order.

    Consumers must return quickly: whoever needs time takes the part elsewhere (a queue, a process).
    """

    consumers: Sequence[Consumer] = ()
    part_ticks: int = PART_TICKS
    chain: Chain = PLAIN_CHAIN  # of the devices whose readings these are
    put_frame: Callable[[RawFrame], None] = field(init=False)
    _rows: list[Tick] = field(default_factory=list, init=False)
    _arrivals: list[Arrivals] = field(default_factory=list, init=False)
    _events: list[Event] = field(default_factory=list, init=False)
    _frames: list[RawFrame] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.put_frame = self._frames.append

    def put(self, row: Tick, arrivals: Arrivals) -> bool:
        """True once a part is full."""
        self._rows.append(row)
        self._arrivals.append(arrivals)
        return len(self._rows) >= self.part_ticks

    def put_waiting(self) -> None:
        """What has been collected is handed on in parts."""

    def put_event(self, stamp_ns: int, kind: str, text: str) -> None:
        self._events.append(Event(stamp_ns, kind, text))

    def hand_on(self, segment: SegmentInfo | None = None) -> Measured:
        """Give what has been collected to the consumers; returns it too. ``segment`` is what it belongs to so far."""
        tables: dict[str, Any] = {stream.name: _table(stream, self._arrivals) for stream in STREAMS}
        part = Measured(
            ticks=np.array([tuple(row.values()) for row in self._rows], TICK),
            **tables,
            segments=() if segment is None else (segment,),
            events=tuple(self._events),
            frames=tuple(self._frames),
            chain=self.chain,
        )
        for collected in (self._rows, self._arrivals, self._events, self._frames):
            collected.clear()
        for consumer in self.consumers:
            consumer(part)
        return part


def _table(stream: Stream, arrivals: Iterable[Arrivals]) -> Table:
    """What the stream brought. Column by column, which takes a third of the time that rows take."""
    kind, readings = stream.kind, [each for new in arrivals for each in new.get(stream.name, ())]
    table = np.empty(len(readings), kind.columns)
    if readings:
        names, rows = kind.reading._fields, readings
        if kind.convert is not None:
            names, rows = kind.columns.names, [kind.convert(each) for each in readings]
        for name, column in zip(names, zip(*rows, strict=True), strict=True):
            table[name] = column
    return table


HEAD_BYTES = 64  # a cache line of its own
# These show another core our stores in the order in which they were made.
ORDERED_MACHINES = {"x86_64", "amd64", "i386", "i686"}


class Ring:
    """Records of one size in shared memory: one process writes and never waits, another reads what it finds.

    The writer copies a record into its slot, then publishes it by counting up the head, which is one store of eight
    aligned bytes. The reader copies slots and looks at the head again: whatever the writer may have been overwriting
    meanwhile is thrown away and counted. So a record is read whole or not at all, each once, and in order.

    This is the memory itself, which goes to spawned processes as an argument.
    """

    def __init__(self, slots: int, record_bytes: int) -> None:
        self.slots, self.record_bytes = slots, record_bytes
        self.memory: Any = RawArray("B", HEAD_BYTES + slots * record_bytes)


class RingWriter:
    """The only one that writes to ``ring``."""

    def __init__(self, ring: Ring) -> None:
        self._slots, self._size = ring.slots, ring.record_bytes
        self._head, self._bytes = _views(ring)
        self._count = self._head[0]
        self._in_order = _fence()

    def put(self, record: bytes) -> None:
        """One record, of exactly ``record_bytes``. Raises ValueError for any other."""
        at = self._count % self._slots * self._size
        self._bytes[at : at + self._size] = record
        self._in_order()
        self._count += 1
        self._head[0] = self._count  # as one store: struct.pack_into writes byte by byte, and readers see halves


class Taken(NamedTuple):
    """Whole records, one after the other, and how many were overwritten before they could be read."""

    records: bytes
    lost: int


@dataclass
class RingReader:
    """Reads ``ring`` from what is written next on."""

    ring: Ring

    def __post_init__(self) -> None:
        self._head, self._bytes = _views(self.ring)
        self._next = self._head[0]
        self._in_order = _fence()

    @property
    def written(self) -> int:
        """How many records there have been since the ring was made."""
        head: int = self._head[0]
        return head

    def skip(self) -> None:
        """Pass over what has not been read."""
        self._next = self._head[0]

    def take(self) -> Taken:
        """All that has been written since the last call, or what is left of it."""
        head = self._head[0]
        if head == self._next:
            return Taken(b"", 0)
        self._in_order()
        first = self._oldest(head)
        copied = self._copy(first, head)
        self._in_order()
        kept = min(self._oldest(self._head[0]), head)
        lost, self._next = kept - self._next, head
        return Taken(copied[(kept - first) * self.ring.record_bytes :], lost)

    def _oldest(self, head: int) -> int:
        """The first record that the writer cannot be overwriting; it may have begun the one after ``head``."""
        return max(self._next, head - self.ring.slots + 1)

    def _copy(self, first: int, end: int) -> bytes:
        size, slots = self.ring.record_bytes, self.ring.slots
        begin, count = first % slots, end - first
        to_the_end = min(count, slots - begin)
        straight = self._bytes[begin * size : (begin + to_the_end) * size]
        return bytes(straight) + bytes(self._bytes[: (count - to_the_end) * size])


def _views(ring: Ring) -> tuple["memoryview[int]", memoryview]:
    """The head, as a number of eight bytes, and the slots."""
    memory = memoryview(ring.memory).cast("B")
    return memory[:8].cast("Q"), memory[HEAD_BYTES:]


def _fence() -> Callable[[], None]:
    """What keeps loads and stores before it from being seen after those that follow it."""
    if platform.machine().lower() in ORDERED_MACHINES:
        return _nothing
    lock = Lock()

    def fence() -> None:
        # A lock's release may be passed by what follows, and its taking by what precedes; a second taking by neither.
        for _ in range(2):
            lock.acquire()
            lock.release()

    return fence


def _nothing() -> None:
    """The machine keeps the order by itself."""


# A session that looks away for this long loses nothing; what it may lose is counted.
KEPT_S = 8.0
# Of each stream, for a sensor faster than the loop, and of frames, for both directions of every device.
READINGS_A_TICK, FRAMES_A_TICK = 4, 16
EVENTS = 256

CODES = {"i8": "q", "i4": "i", "u4": "I", "f8": "d", "b1": "?"}
# A frame's stamp, identifier, channel by its place, marks, count of bytes, bytes. Longer chunks take several records.
FRAME = Struct("<qiBBB64s")
FRAME_BYTES = 64
MARKS = SENT, EXTENDED, REMOTE, FD, SWITCHED = 1, 2, 4, 8, 16
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
    """An outlet in shared memory, for a loop in a process of its own: nothing piles up here.

    What the loop has put there survives the loop: killed in the middle of a tick, it takes that tick with it and no
    other. Frames wait for the tick's end, or the next wait: a command that waits for its turn is worth more.
    """

    def __init__(self, memory: SharedMemory) -> None:
        rings = {name: RingWriter(ring) for name, ring in memory.tables.items()}
        self._pack_tick, self._put_tick = _struct(TICK).pack, rings["ticks"].put
        # Of each stream: what makes a row of a reading, packs it, and puts it into its ring.
        self._streams = {
            stream.name: (stream.kind.row, _struct(stream.kind.columns).pack, rings[stream.name].put)
            for stream in STREAMS
        }
        self._frame_ring, self._event_ring = RingWriter(memory.frames), RingWriter(memory.events)
        self._places = {channel: place for place, channel in enumerate(memory.channels)}
        self._frames: list[RawFrame] = []
        self.put_frame: Callable[[RawFrame], None] = self._frames.append

    def put(self, row: Tick, arrivals: Arrivals) -> bool:
        """What arrived, its frames and those of the commands, and the row, by which the session knows of the tick."""
        for name, readings in arrivals.items():
            values, pack, put = self._streams[name]
            for reading in readings:
                put(pack(*values(reading)))
        self.put_waiting()
        self._put_tick(self._pack_tick(*row.values()))
        return False

    def put_waiting(self) -> None:
        """The frames so far."""
        put, places, pack = self._frame_ring.put, self._places, FRAME.pack
        for stamp_ns, channel, sent, data, identifier, extended, remote, fd, switched in self._frames:
            marks = SENT * sent | EXTENDED * extended | REMOTE * remote | FD * fd | SWITCHED * switched
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
            table.name: _read_table(self._all(self._tables[table.name]), table.kind.columns) for table in TABLES
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
            sent, extended, remote, fd, switched = (bool(marks & mark) for mark in MARKS)
            yield RawFrame(stamp_ns, channels[place], sent, data[:size], identifier, extended, remote, fd, switched)

    def _new_events(self) -> Iterator[Event]:
        for stamp_ns, kind, text in EVENT.iter_unpack(self._all(self._events)):
            yield Event(stamp_ns, _text(kind), _text(text))


def _struct(kind: "np.dtype[np.void]") -> Struct:
    """A row of a table of this kind, packed as numpy packs it."""
    return Struct("<" + "".join(CODES[kind[name].str.lstrip("<|=")] for name in kind.names or ()))


def _read_table(records: bytes, kind: "np.dtype[np.void]") -> Table:
    """As any other table: code is compiled anew for those that cannot be written to."""
    return np.frombuffer(records, kind).copy()


def _text(padded: bytes) -> str:
    """A cut may have left half a letter."""
    return padded.rstrip(b"\0").decode(errors="ignore")
