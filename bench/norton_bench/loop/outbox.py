"""Where every tick leaves what it saw and did. Handed on in parts, after the tick's commands were sent."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from norton_bench.loop.devices import Arrivals
from norton_bench.records import (
    CURRENT,
    MOTION,
    NO_DEVICE_TIME,
    PLAIN_CHAIN,
    TICK,
    TORQUE,
    Chain,
    Event,
    Measured,
    SegmentInfo,
    Table,
)
from norton_drivers.readings import CurrentReading, MotionReading, RawFrame, TorqueReading

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
    _arrivals: Arrivals = field(default_factory=Arrivals, init=False)
    _events: list[Event] = field(default_factory=list, init=False)
    _frames: list[RawFrame] = field(default_factory=list, init=False)

    def put(self, row: tuple[float, ...], arrivals: Arrivals) -> bool:
        """Keep one tick's row (in the order of TICK) and what arrived; True once a part is full."""
        self._rows.append(row)
        self._arrivals.add(arrivals)
        return len(self._rows) >= self.part_ticks

    def put_frame(self, frame: RawFrame) -> None:
        self._frames.append(frame)

    def put_waiting(self) -> None:
        """What has been collected is handed on in parts."""

    def put_event(self, stamp_ns: int, kind: str, text: str) -> None:
        self._events.append(Event(stamp_ns, kind, text))

    def hand_on(self, segment: SegmentInfo | None = None) -> Measured:
        """Give what has been collected to the consumers; returns it too. ``segment`` is what it belongs to so far."""
        part = Measured(
            ticks=np.array(self._rows, TICK),
            motion=_table(self._arrivals.motion, MOTION),
            load_motion=_table(self._arrivals.load_motion, MOTION),
            torque=_torque_table(self._arrivals.torque),
            current=_table(self._arrivals.current, CURRENT),
            load_current=_table(self._arrivals.load_current, CURRENT),
            modulator_motion=_table(self._arrivals.modulator_motion, MOTION),
            modulator_current=_table(self._arrivals.modulator_current, CURRENT),
            segments=() if segment is None else (segment,),
            events=tuple(self._events),
            frames=tuple(self._frames),
            chain=self.chain,
        )
        self._rows, self._arrivals, self._events, self._frames = [], Arrivals(), [], []
        for consumer in self.consumers:
            consumer(part)
        return part


def _table(readings: Sequence[MotionReading] | Sequence[CurrentReading], dtype: "np.dtype[np.void]") -> Table:
    """Column by column: a reading's fields are named like the table's."""
    table = np.empty(len(readings), dtype)
    if readings:
        for name, column in zip(readings[0]._fields, zip(*readings, strict=True), strict=True):
            table[name] = column
    return table


def _torque_table(readings: list[TorqueReading]) -> Table:
    return np.array(
        [
            (r.arrival_ns, NO_DEVICE_TIME if r.device_ns is None else r.device_ns, r.sequence, r.torque_nm, r.valid)
            for r in readings
        ],
        TORQUE,
    )
