"""A proxy between a driver and its port: counts what is sent, lets junk arrive, disconnects."""

from collections import deque
from collections.abc import Callable
from random import Random
from typing import Any, cast

import can

from norton_drivers.clock import Clock
from norton_drivers.codecs.can_errors import ErrorClass
from norton_drivers.ports import Backend, CanPort, SerialLine, SerialPort
from norton_drivers.wiring import CanBusSettings

JUNK_AT_A_TIME = 40


class FaultProxy:
    """A backend around ``inner``. ``sent`` counts frames and chunks that went out."""

    def __init__(self, inner: Backend) -> None:
        self.sent = 0
        self.unplugged = False
        self.clock: Clock = inner.clock
        self.lock_step = inner.lock_step
        self._inner = inner
        self._buses: list[_ProxiedBus] = []
        self._lines: list[_ProxiedLine] = []

    def open_can(self, settings: CanBusSettings) -> CanPort:
        port = self._inner.open_can(settings)
        bus = _ProxiedBus(port.bus, self)
        self._buses.append(bus)
        port.bus = cast(can.BusABC, bus)
        return port

    def open_serial(self, port: str, baud: int) -> SerialPort:
        opened = self._inner.open_serial(port, baud)
        line = _ProxiedLine(opened.line, self)
        self._lines.append(line)
        opened.line = line
        return opened

    def close(self) -> None:
        self._inner.close()

    def babble(self, random: Random) -> None:
        """Let frames of all kinds and bytes arrive that nobody sent, many with identifiers that were heard before."""
        now_s = self.clock.now_ns() * 1e-9
        for bus in self._buses:
            bus.junk.extend(_junk_frame(random, bus.heard, now_s) for _ in range(JUNK_AT_A_TIME))
        for line in self._lines:
            line.junk += _junk_bytes(random, line.heard)


class _ProxiedBus:
    """As much of a bus as a port uses; the rest is the inner one's."""

    def __init__(self, inner: can.BusABC, proxy: FaultProxy) -> None:
        self.junk: deque[can.Message] = deque()
        self.heard: dict[int, can.Message] = {}
        self._inner = inner
        self._meddler = proxy

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        _check_plug(self._meddler, lambda: can.CanOperationError("No such device"))
        self._meddler.sent += 1
        self._inner.send(message, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        _check_plug(self._meddler, lambda: can.CanOperationError("No such device"))
        if self.junk:
            return self.junk.popleft()
        message = self._inner.recv(timeout)
        if message is not None:
            self.heard[message.arbitration_id] = message
        return message


class _ProxiedLine:
    def __init__(self, inner: SerialLine, proxy: FaultProxy) -> None:
        self.junk = b""
        self.heard = b""  # the last that was read
        self._inner = inner
        self._meddler = proxy

    @property
    def in_waiting(self) -> int:
        _check_plug(self._meddler, lambda: OSError("Input/output error"))
        return len(self.junk) or self._inner.in_waiting

    def read(self, size: int = 1) -> bytes:
        if self.junk:
            data, self.junk = self.junk[:size], self.junk[size:]
            return data
        data = self._inner.read(size)
        self.heard = data or self.heard
        return data

    def write(self, data: bytes, /) -> int | None:
        _check_plug(self._meddler, lambda: OSError("Input/output error"))
        self._meddler.sent += 1
        return self._inner.write(data)

    def close(self) -> None:
        self._inner.close()


def _check_plug(proxy: FaultProxy, error: Callable[[], Exception]) -> None:
    if proxy.unplugged:
        raise error()


def _junk_frame(random: Random, heard: dict[int, can.Message], now_s: float) -> can.Message:
    extended = random.random() < 0.3
    identifier = random.randrange(1 << (29 if extended else 11))
    if heard and random.random() < 0.7:
        like = heard[random.choice(sorted(heard))]
        identifier, extended = like.arbitration_id, like.is_extended_id
    remote, error = random.random() < 0.1, random.random() < 0.1
    return can.Message(
        timestamp=now_s,
        # An error frame that says bus-off is no junk, but a lost bus.
        arbitration_id=identifier & ~ErrorClass.BUS_OFF if error else identifier,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=error,
        data=random.randbytes(random.randrange(9)),
    )


def _junk_bytes(random: Random, heard: bytes) -> bytes:
    """Noise, and pieces of what was really said with bits that flipped."""
    piece = bytearray(heard[: random.randrange(len(heard) + 1)])
    for _ in range(random.randrange(3)):
        if piece:
            piece[random.randrange(len(piece))] ^= 1 << random.randrange(8)
    return random.randbytes(random.randrange(60)) + bytes(piece) + random.randbytes(random.randrange(10))
