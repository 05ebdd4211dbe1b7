"""A ring of records of one size in shared memory: one process writes and never waits, another reads what it finds.

The writer copies a record into its slot, then publishes it by counting up the head, which is one store of eight aligned
bytes. The reader copies slots and looks at the head again: whatever the writer may have been overwriting meanwhile is
thrown away and counted. So a record is read whole or not at all, each once, and in order.
"""

import platform
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.sharedctypes import RawArray
from threading import Lock
from typing import Any, NamedTuple

HEAD_BYTES = 64  # a cache line of its own
# These show another core our stores in the order in which they were made.
ORDERED_MACHINES = {"x86_64", "amd64", "i386", "i686"}


class Ring:
    """The memory itself, which goes to spawned processes as an argument."""

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
