"""A half-duplex line: host and devices hear all that is said, one may speak at a time, and who speaks at once with
another garbles both.

Each device has its own plug on the line; the line has the one plug of the port. What a device says reaches the host
and the other devices when its last byte has left.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from norton_sim.connectors import BITS_PER_BYTE, SerialConnector

# What two drivers on one pair of wires come to is neither of what they send.
_GARBLED = bytes(byte ^ 0x55 for byte in range(256))


class Timeline(Protocol):
    """What a line needs of :class:`norton_sim.world.World`."""

    @property
    def now_ns(self) -> int: ...
    def at(self, stamp_ns: int, action: Callable[[int], None]) -> None: ...


@dataclass
class _Talk:
    """One burst of a device's."""

    tap: "Tap"
    data: bytes
    begun_ns: int
    end_ns: int
    garbled: bool = False


class HalfDuplexLine:
    """One line behind the one plug of its port. ``collisions`` counts."""

    def __init__(self, world: Timeline, port: SerialConnector) -> None:
        self.collisions = 0
        self.port = port
        self._world = world
        self._taps: list[Tap] = []
        self._talk: _Talk | None = None
        port.on_bytes(self._from_host)

    def connector(self, baud: int) -> SerialConnector:
        """A plug for one more device, which speaks at this rate."""
        tap = Tap(self, baud)
        self._taps.append(tap)
        return SerialConnector(tap)

    def say(self, data: bytes, tap: "Tap") -> None:
        """The device at ``tap`` begins to speak; it does not hear itself."""
        now_ns, talk = self._world.now_ns, self._talk
        said = _Talk(tap, data, now_ns, now_ns + tap.duration_ns(data))
        if talk is not None and now_ns < talk.end_ns:
            self.collisions += 1
            talk.garbled = said.garbled = True
        if talk is None or said.end_ns > talk.end_ns:
            self._talk = said
        self._world.at(said.end_ns, partial(self._said, said))

    def _said(self, talk: _Talk, _stamp_ns: int) -> None:
        data = talk.data.translate(_GARBLED) if talk.garbled else talk.data
        self.port.wire.to_host(data, talk.begun_ns)
        self._deliver(data, talk.tap)

    def _from_host(self, data: bytes) -> None:
        """The last byte of what the host wrote is here."""
        talk, begun_ns = self._talk, self._world.now_ns - self._written_in_ns(data)
        if talk is not None and talk.end_ns > begun_ns:
            self.collisions += 1
            talk.garbled = True
            data = data.translate(_GARBLED)
        self._deliver(data, None)

    def _written_in_ns(self, data: bytes) -> int:
        if not self.port.wire.paced:
            return 0  # it is here as soon as it was written
        baud = self.port.wire.host_baud or max(tap.baud for tap in self._taps)
        return round(len(data) * BITS_PER_BYTE * 1e9 / baud)

    def _deliver(self, data: bytes, but: "Tap | None") -> None:
        for tap in self._taps:
            if tap is not but and tap.plug is not None:
                tap.plug.deliver(data)


class Tap:
    """Where one device is connected to the line: see :class:`norton_sim.connectors.SerialWire`."""

    def __init__(self, line: HalfDuplexLine, baud: int) -> None:
        self.plug: SerialConnector | None = None
        self._line = line
        self.baud = baud

    def duration_ns(self, data: bytes) -> int:
        """How long the device takes to say it."""
        return round(len(data) * BITS_PER_BYTE * 1e9 / self.baud)

    @property
    def host_baud(self) -> int | None:
        return self._line.port.wire.host_baud

    @property
    def paced(self) -> bool:
        return self._line.port.wire.paced

    def attach(self, plug: SerialConnector) -> None:
        self.plug = plug

    def to_host(self, data: bytes, begun_ns: int | None = None) -> None:
        self._line.say(data, self)
