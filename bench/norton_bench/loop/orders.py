"""Messages between a session and a loop in a process of its own: orders and answers over a pipe, and a heartbeat.

Every order but :class:`Idle` gets one answer, :class:`Done` or :class:`Failed`. After :class:`Enable` is done, segments
are run until :class:`Idle`, or until one fails. In both cases the drives are idle when :class:`Idled` comes.
"""

import pickle
import select
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import RawArray
from typing import Any

from norton_bench.errors import SafetyStopError
from norton_bench.loop.bench_loop import Learned
from norton_bench.segments import Segment
from norton_drivers.ports import Clock


@dataclass(frozen=True)
class Identify:
    """Answered with the devices' identities."""


@dataclass(frozen=True)
class VerifyWatchdogs:
    """Answered with one finding for each drive."""


@dataclass(frozen=True)
class Learn:
    """Use these results from now on."""

    learned: Learned


@dataclass(frozen=True)
class ResetGuard:
    """Allow the drives to be enabled again: the operator has checked the bench."""

    word: str


@dataclass(frozen=True)
class Enable:
    """Enable the drives."""


@dataclass(frozen=True)
class Run:
    """Answered with the segment's :class:`norton_bench.records.SegmentInfo`."""

    segment: Segment


@dataclass(frozen=True)
class Idle:
    """Idle the drives at once, because of ``error`` or because all segments have been run."""

    error: Exception | None = None


@dataclass(frozen=True)
class Close:
    """The session needs the loop no more."""


Order = Identify | VerifyWatchdogs | Learn | ResetGuard | Enable | Run | Idle | Close


@dataclass(frozen=True)
class Done:
    """An order was carried out."""

    value: Any = None


@dataclass(frozen=True)
class Failed:
    """An order was not."""

    error: Exception


@dataclass(frozen=True)
class Idled:
    """The drives are idle; ``error`` is why, where it was not asked for."""

    error: Exception | None = None


class LeaveError(Exception):
    """In the loop's process: the session wants the drives idle, whatever runs."""

    def __init__(self, idle: Idle) -> None:
        super().__init__(idle)
        self.idle = idle


# Up to this, multiprocessing's pipes write a message and its length at once.
PIECE_BYTES = 16_000
# In one go: a tick has time for as many.
AT_ONCE = 8
MORE, LAST = b"\0", b"\1"


def send_in_pieces(pipe: "Connection[Any, Any]", message: object) -> None:
    """Write ``message`` to ``pipe`` in pieces, of which each is in the pipe as a whole or not at all.

    So the reader never waits for the writer. A long segment is more than a pipe holds: read at once, the loop would
    wait for its rest while other programs keep the writer from the processor.

    Returns when all of it is in the pipe. Raises OSError where the other end is closed.
    """
    data = pickle.dumps(message)
    for at in range(0, len(data), PIECE_BYTES):
        piece = data[at : at + PIECE_BYTES]
        pipe.send_bytes((LAST if at + PIECE_BYTES >= len(data) else MORE) + piece)


@dataclass
class PieceReader:
    """Reads what :func:`send_in_pieces` writes at the other end of ``pipe``."""

    pipe: "Connection[Any, Any]"
    _pieces: list[bytes] = field(default_factory=list, init=False)
    _whole: bool = field(default=False, init=False)  # a message, or the pipe's end

    def __post_init__(self) -> None:
        self._something_waits = _waiting_in(self.pipe)

    def ready(self) -> bool:
        """Read the pieces that are there; whether a message is complete, or the pipe has ended. Never waits."""
        for _ in range(AT_ONCE):
            if self._whole or not self._something_waits():
                break
            self._take()
        return self._whole

    def read(self) -> Any:
        """Wait for the next message. Raises EOFError where the pipe has ended, OSError where it is closed."""
        while not self._whole:
            self._take()
        pieces, self._pieces, self._whole = self._pieces, [], False
        if not pieces or not pieces[-1].startswith(LAST):
            raise EOFError
        return pickle.loads(b"".join([piece[1:] for piece in pieces]))

    def _take(self) -> None:
        try:
            self._pieces.append(self.pipe.recv_bytes())
        except (EOFError, ConnectionResetError):
            self._whole = True
        else:
            self._whole = self._pieces[-1].startswith(LAST)


def _waiting_in(pipe: "Connection[Any, Any]") -> Callable[[], bool]:
    """Tells whether the pipe has something to read, or has ended. Its own ``poll`` takes as long as half a tick."""
    if not hasattr(select, "poll"):  # Windows
        return pipe.poll
    poller = select.poll()
    poller.register(pipe, select.POLLIN)
    return lambda: bool(poller.poll(0))


# During a segment a session gives 25 heartbeats a second. Without any for so long it hangs, or was stopped.
SILENT_NS = 1_000_000_000
# How often the pipe is polled: it shows the death of a session earlier than the missing heartbeat.
LOOK_NS = 10_000_000


class Pulse:
    """The session's heartbeat, in memory that it shares with the loop's process; goes there as an argument."""

    def __init__(self) -> None:
        self.memory: Any = RawArray("B", 8)

    def view(self) -> "memoryview[int]":
        """One number: the time of the last heartbeat [ns]."""
        return memoryview(self.memory).cast("B").cast("Q")


@dataclass
class SessionWatch:
    """Watches the session while the drives are enabled: they do not stay so for a session that is gone."""

    pulse: Pulse
    orders: PieceReader
    clock: Clock
    _within_segment: bool = field(default=False, init=False)
    _look_ns: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._beat_ns = self.pulse.view()

    @contextmanager
    def segment(self) -> Iterator[None]:
        """Inside, any order means that the segment is to end."""
        self._within_segment = True
        try:
            yield
        finally:
            self._within_segment = False

    def look(self) -> None:
        """Called every tick. Raises SafetyStopError where the session is gone, LeaveError where it ends the segment.

        During a segment the session gives heartbeats, and the only order that it may send ends the segment. Between
        two segments it computes; the loop limits for how long.
        """
        if not self._within_segment:
            return
        now_ns = self._listen()
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            if self.orders.ready():
                order = self.read()
                raise LeaveError(order if isinstance(order, Idle) else Idle())

    def ordered(self) -> bool:
        """Called every tick between two segments: whether an order is there, or the session has died."""
        return self.orders.ready()

    def read(self) -> Order:
        """Wait for the next order. Raises SafetyStopError where the session's process has died."""
        try:
            order: Order = self.orders.read()
        except (EOFError, OSError):
            raise SafetyStopError("the session's process has died", "session") from None
        return order

    def _listen(self) -> int:
        """The time now [ns]. Raises SafetyStopError where the last heartbeat is too old."""
        now_ns = self.clock.now_ns()
        silent_ns = now_ns - self._beat_ns[0]
        if silent_ns > SILENT_NS:
            raise SafetyStopError(f"the session has not been heard for {silent_ns / 1e6:.0f} ms: it hangs", "session")
        return now_ns
