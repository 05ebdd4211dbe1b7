"""What a loop in a process of its own sees of its session: drives are not left enabled for a session that is gone."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.sharedctypes import RawArray
from typing import Any

from norton_bench.errors import SafetyStopError
from norton_bench.loop.orders import Idle, LeaveError, Order
from norton_bench.loop.pieces import PieceReader
from norton_drivers.ports import Clock

# During a segment a session beats 25 times a second; one that does not for so long hangs, or was stopped.
SILENT_NS = 1_000_000_000
# How often the pipe is looked at: it tells sooner of a session that has died.
LOOK_NS = 10_000_000


class Pulse:
    """When the session was last seen alive, in memory that it shares with the loop; goes to it as an argument."""

    def __init__(self) -> None:
        self.memory: Any = RawArray("B", 8)

    def view(self) -> "memoryview[int]":
        """One number [ns]: the clock's when it beat."""
        return memoryview(self.memory).cast("B").cast("Q")


@dataclass
class SessionWatch:
    """The session as long as the drives are enabled: during a segment, and between two."""

    pulse: Pulse
    orders: PieceReader
    clock: Clock
    _within_segment: bool = field(default=False, init=False)
    _look_ns: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._beat_ns = self.pulse.view()

    @contextmanager
    def segment(self) -> Iterator[None]:
        """Inside, an order means that the session wants no more of the segment."""
        self._within_segment = True
        try:
            yield
        finally:
            self._within_segment = False

    def look(self) -> None:
        """Asked every tick. Raises SafetyStopError where the session is gone, LeaveError where it wants them idle.

        During a segment a session beats, and says nothing but that it wants no more of it. Between two it computes: how
        long it may is the loop's to say.
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
        """Asked every tick between two segments: whether :meth:`read` has something to read, or the session's end."""
        return self.orders.ready()

    def read(self) -> Order:
        """The order that is there, or comes. Raises SafetyStopError where the session's process has died."""
        try:
            order: Order = self.orders.read()
        except (EOFError, OSError):
            raise SafetyStopError("the session's process has died", "session") from None
        return order

    def _listen(self) -> int:
        """The time [ns], if the session's heart still beats."""
        now_ns = self.clock.now_ns()
        silent_ns = now_ns - self._beat_ns[0]
        if silent_ns > SILENT_NS:
            raise SafetyStopError(f"the session has not been heard for {silent_ns / 1e6:.0f} ms: it hangs", "session")
        return now_ns
