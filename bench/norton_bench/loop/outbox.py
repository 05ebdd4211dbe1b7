"""Where every tick leaves what it saw and did. Handed on in parts, after the tick's commands were sent."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from norton_bench.loop.devices import Arrivals, add
from norton_bench.records import (
    PLAIN_CHAIN,
    STREAMS,
    TICK,
    Chain,
    Event,
    Kind,
    Measured,
    SegmentInfo,
    Table,
)
from norton_drivers.readings import RawFrame

Consumer = Callable[[Measured], None]

# Parts of 100 ms: what a crash may lose, and what the live identifier digests at a time.
PART_TICKS = 100


class Outlet(Protocol):
    """What the loop asks of its outbox."""

    def put(self, row: tuple[float, ...], arrivals: Arrivals) -> bool:
        """One tick's row (in the order of TICK) and what arrived; True where it is time to hand on."""
        ...

    def put_frame(self, frame: RawFrame) -> None: ...
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
    _rows: list[tuple[float, ...]] = field(default_factory=list, init=False)
    _arrivals: Arrivals = field(default_factory=dict, init=False)
    _events: list[Event] = field(default_factory=list, init=False)
    _frames: list[RawFrame] = field(default_factory=list, init=False)

    def put(self, row: tuple[float, ...], arrivals: Arrivals) -> bool:
        """Keep one tick's row (in the order of TICK) and what arrived; True once a part is full."""
        self._rows.append(row)
        add(self._arrivals, arrivals)
        return len(self._rows) >= self.part_ticks

    def put_frame(self, frame: RawFrame) -> None:
        self._frames.append(frame)

    def put_waiting(self) -> None:
        """What has been collected is handed on in parts."""

    def put_event(self, stamp_ns: int, kind: str, text: str) -> None:
        self._events.append(Event(stamp_ns, kind, text))

    def hand_on(self, segment: SegmentInfo | None = None) -> Measured:
        """Give what has been collected to the consumers; returns it too. ``segment`` is what it belongs to so far."""
        tables: dict[str, Any] = {
            stream.name: _table(self._arrivals.get(stream.name, ()), stream.kind) for stream in STREAMS
        }
        part = Measured(
            ticks=np.array(self._rows, TICK),
            **tables,
            segments=() if segment is None else (segment,),
            events=tuple(self._events),
            frames=tuple(self._frames),
            chain=self.chain,
        )
        self._rows, self._arrivals, self._events, self._frames = [], {}, [], []
        for consumer in self.consumers:
            consumer(part)
        return part


def _table(readings: Sequence[Any], kind: Kind) -> Table:
    """Column by column, which takes a third of the time that rows take."""
    table = np.empty(len(readings), kind.columns)
    for name, column in zip(kind.columns.names or (), zip(*map(kind.row, readings), strict=True), strict=False):
        table[name] = column
    return table
