"""The simulated world: the plant, the devices bolted to it, and one clock that makes all of them move in order."""

from collections.abc import Callable
from heapq import heappop, heappush, heapreplace
from itertools import count
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from norton_sim.connectors import CanConnector, SerialConnector
    from norton_sim.half_duplex import HalfDuplexLine
    from norton_sim.plant import Plant

# Called with the instant [ns] at which it happens; the plant stands at that instant.
Action = Callable[[int], None]


class Firmware(Protocol):
    """An emulated device. It sends only through its connector; tests can break it."""

    def freeze(self) -> None:
        """From now on report the values of this instant, in ever new messages."""
        ...


class Timeline:
    """Events in simulated time, and mechanics between them: ``move_to`` lets these go on until an instant [ns].

    The same calls give the same order of events.
    """

    def __init__(self, move_to: Action) -> None:
        self.now_ns = 0
        self._move_to = move_to
        self._events: list[tuple[int, int, Action, int]] = []
        self._order = count()

    def at(self, stamp_ns: int, action: Action) -> None:
        """Do ``action`` once, at ``stamp_ns`` or now where that has passed; ties in the order they were asked for."""
        heappush(self._events, (max(stamp_ns, self.now_ns), next(self._order), action, 0))

    def every(self, period_ns: int, action: Action, *, first_ns: int) -> None:
        """Do ``action`` at ``first_ns`` and every ``period_ns`` thereafter."""
        heappush(self._events, (max(first_ns, self.now_ns), next(self._order), action, period_ns))

    @property
    def next_event_ns(self) -> int | None:
        """When something happens next; None where nothing is planned."""
        return self._events[0][0] if self._events else None

    def advance(self, to_ns: int) -> None:
        """Let everything happen, in order, up to and including ``to_ns``; the past is left as it is."""
        events = self._events
        move_to = self._move_to
        while events and events[0][0] <= to_ns:
            stamp_ns, order, action, period_ns = events[0]
            # In place, and before the action: what the action plans can then not be taken for this event.
            if period_ns:
                heapreplace(events, (stamp_ns + period_ns, order, action, period_ns))
            else:
                heappop(events)
            self.now_ns = stamp_ns
            move_to(stamp_ns)
            action(stamp_ns)
        if to_ns > self.now_ns:
            self.now_ns = to_ns
            move_to(to_ns)


class World:
    """One bench: its plant, the devices bolted to it, and the time in which it lives.

    ``devices`` and ``wires`` hold, by role ("actuator", "load", "torque_sensor"), each device's firmware and the plug
    that connects it; ``lines``, by port, those that several devices share. Benches whose mechanics are joined have one
    ``timeline``. The same seed and the same calls give the same bytes.
    """

    def __init__(self, plant: "Plant", timeline: Timeline | None = None) -> None:
        self.plant = plant
        self.timeline = timeline or Timeline(plant.advance)
        self.devices: dict[str, Firmware] = {}
        self.wires: dict[str, CanConnector | SerialConnector] = {}
        self.lines: dict[str, HalfDuplexLine] = {}
        self.at, self.every, self.advance = self.timeline.at, self.timeline.every, self.timeline.advance

    @property
    def now_ns(self) -> int:
        return self.timeline.now_ns

    @property
    def next_event_ns(self) -> int | None:
        """When something happens next; None where nothing is planned."""
        return self.timeline.next_event_ns
