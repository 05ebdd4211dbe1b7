"""Wires: how long bytes travel on them, what may go wrong, and where a device is connected."""

import errno
import os
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import NamedTuple, Protocol

import can
import serial

BITS_PER_BYTE = 10  # start, eight data bits, stop


# How long bytes travel: delay and jitter of one direction of a wire, on which nothing overtakes.
class Delay:
    """When a frame sent now arrives: ``delay_ns`` on average, uniformly within ± ``jitter_ns``, order preserved."""

    def __init__(self, delay_ns: int, jitter_ns: int, random: Random) -> None:
        self._least_ns = delay_ns - jitter_ns
        self._spread_ns = 2 * jitter_ns
        self._draw = random.random
        self._last_ns = 0

    def arrival_ns(self, sent_ns: int) -> int:
        travel_ns = self._least_ns + round(self._spread_ns * self._draw())
        arrival_ns = sent_ns + travel_ns if travel_ns > 0 else sent_ns
        if arrival_ns < self._last_ns:
            return self._last_ns
        self._last_ns = arrival_ns
        return arrival_ns


class ByteStream:
    """Bytes on a serial line: each takes ten bits of time, and the next can only follow the one before.

    What was sent at once is a burst; bytes are handed out one burst at a time, so that each has its own arrival.
    """

    def __init__(self, baud: int, delay: Delay) -> None:
        self._byte_ns = BITS_PER_BYTE * 1e9 / baud
        self._delay = delay
        self._after_ns: list[int] = []  # when a burst's first, second, ... byte has arrived, after its time began
        self._free_ns = 0
        self._bursts: deque[tuple[int, bytes]] = deque()  # when the first byte's time begins; the bytes
        self._read = 0  # bytes already taken from the first burst
        self.last_arrival_ns = 0

    def send(self, sent_ns: int, data: bytes) -> None:
        if not data:
            return
        while len(self._after_ns) < len(data):
            self._after_ns.append(round((len(self._after_ns) + 1) * self._byte_ns))
        start_ns = max(self._free_ns, self._delay.arrival_ns(sent_ns))
        self._free_ns = start_ns + self._after_ns[len(data) - 1]
        self._bursts.append((start_ns, data))

    def waiting(self, now_ns: int) -> int:
        """How many bytes of the burst that comes next have arrived by ``now_ns``."""
        if not self._bursts:
            return 0
        start_ns, data = self._bursts[0]
        return bisect_right(self._after_ns, now_ns - start_ns, 0, len(data)) - self._read

    def take(self, size: int, now_ns: int) -> bytes:
        """Up to ``size`` of those bytes; ``last_arrival_ns`` then tells when the last of them arrived."""
        size = min(size, self.waiting(now_ns))
        if size <= 0:
            return b""
        start_ns, data = self._bursts[0]
        first, self._read = self._read, self._read + size
        self.last_arrival_ns = start_ns + self._after_ns[self._read - 1]
        taken = data[first : self._read]
        if self._read == len(data):
            self._bursts.popleft()
            self._read = 0
        return taken


TRANSMIT_QUEUE = 10  # frames
CAN_ERR_PROTOCOL = 0x08  # error classes, in an error frame's identifier
CAN_ERR_BUS_OFF = 0x40


# What can go wrong at the host's own end of a wire, and how python-can and pyserial tell the host of it.
#
# Sources: python-can 4.5, ``interfaces/socketcan/socketcan.py`` (``_send_once``, ``capture_message``); pyserial 3.5,
# ``serialposix.py``; Linux, ``Documentation/networking/can.rst`` and ``include/uapi/linux/can/error.h``. That a CAN
# interface takes ten frames more once nothing leaves it, its ``txqueuelen``, is python-can's issue 310.
class Trouble(Enum):
    """What goes wrong at it."""

    UNPLUGGED = "unplugged"  # the adapter is gone: whoever uses it is told so
    BUS_OFF = "bus-off"  # the controller has left the bus: nothing comes, and nothing leaves its queue
    CROWDED = "crowded"  # others have the bus: the queue is full, but all is heard


class HostEnd(Protocol):
    """The host's own end of a bus or line."""

    def suffer(self, trouble: Trouble | None) -> None:
        """From now on; None ends it."""
        ...

    def report_error(self, error_class: int) -> None:
        """Let the adapter tell of an error on the bus, where it is one that does."""
        ...


@dataclass
class TroubledAdapter:
    """A CAN adapter in trouble: what sending and receiving come to."""

    trouble: Trouble
    _queued: int = field(default=0, init=False)

    @property
    def hears(self) -> bool:
        return self.trouble is Trouble.CROWDED

    def send(self) -> None:
        """Raises can.CanOperationError where the frame is not even taken."""
        if self.trouble is Trouble.UNPLUGGED:
            raise _refused("Failed to transmit", errno.ENODEV)
        self._queued += 1
        if self.trouble is Trouble.CROWDED or self._queued > TRANSMIT_QUEUE:
            raise _refused("Failed to transmit", errno.ENOBUFS)

    def receive(self) -> None:
        """Raises can.CanOperationError where the adapter is gone."""
        if self.trouble is Trouble.UNPLUGGED:
            raise _refused("Error receiving", errno.ENODEV)


def lost_line() -> OSError:
    """What reading a serial port whose adapter is gone raises."""
    return OSError(errno.EIO, os.strerror(errno.EIO))


def unwritable_line() -> OSError:
    """What writing to it raises."""
    return serial.SerialException(f"write failed: {lost_line()}")


def _refused(what: str, code: int) -> can.CanOperationError:
    return can.CanOperationError(f"{what}: {os.strerror(code)}", code)


FrameSender = Callable[[int, bytes, bool, bool], None]  # identifier, data, extended, CAN FD
MessageReceiver = Callable[[can.Message], None]
BytesPassage = Callable[[bytes], None]


# Where a device is connected to its wire. A connector can be pulled or tampered with.
class Piece(NamedTuple):
    """How faults reach what passes a plug: each direction is a chain of functions, its end the wire or the device.

    One frame's payload, or the bytes of one write, on its way through a plug.

    ``forward`` lets it pass, or something else in its place, now or later. The host's frames come to every plug on
    the bus: those know by the ``token`` that it is one frame.
    """

    data: bytes
    forward: BytesPassage
    token: object = None


Tamper = Callable[[Piece], None]


class Tampers:
    """Who tampers with what passes one plug; the first to come meets it first."""

    def __init__(self, changed: Callable[[], None]) -> None:
        self.to_host: list[Tamper] = []
        self.to_device: list[Tamper] = []
        self._changed = changed

    def add(self, to_host: Tamper | None, to_device: Tamper | None) -> Callable[[], None]:
        """Returns what takes them away again."""
        sides = [(self.to_host, to_host), (self.to_device, to_device)]
        added = [(chain, tamper) for chain, tamper in sides if tamper is not None]
        for chain, tamper in added:
            chain.append(tamper)
        self._changed()

        def remove() -> None:
            for chain, tamper in added:
                chain.remove(tamper)
            self._changed()

        return remove


def tampered_frames(send: FrameSender, tampers: list[Tamper]) -> FrameSender:
    """``send`` behind all of them."""
    for tamper in reversed(tampers):
        send = _frames_through(tamper, send)
    return send


def tampered_messages(receive: MessageReceiver, tampers: list[Tamper]) -> MessageReceiver:
    """``receive`` behind all of them."""
    for tamper in reversed(tampers):
        receive = _messages_through(tamper, receive)
    return receive


def tampered_bytes(passage: BytesPassage, tampers: list[Tamper]) -> BytesPassage:
    """``passage`` behind all of them."""
    for tamper in reversed(tampers):
        passage = _bytes_through(tamper, passage)
    return passage


def _frames_through(tamper: Tamper, send: FrameSender) -> FrameSender:
    return lambda arbitration_id, data, extended, fd: tamper(
        Piece(data, lambda passed: send(arbitration_id, passed, extended, fd))
    )


def _messages_through(tamper: Tamper, receive: MessageReceiver) -> MessageReceiver:
    return lambda message: tamper(
        Piece(bytes(message.data), lambda passed: receive(_with_data(message, passed)), message)
    )


def _bytes_through(tamper: Tamper, passage: BytesPassage) -> BytesPassage:
    return lambda data: tamper(Piece(data, passage))


def _with_data(message: can.Message, data: bytes) -> can.Message:
    if data == message.data:
        return message
    return can.Message(
        message.timestamp,
        message.arbitration_id,
        message.is_extended_id,
        data=data,
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )


class CanWire(Protocol):
    """A CAN bus as the devices on it see it."""

    def to_host(self, arbitration_id: int, data: bytes, extended: bool, fd: bool) -> None:
        """Put a data frame on the bus, classical or CAN FD."""
        ...

    def attach(self, plug: "CanConnector") -> None:
        """Deliver every frame from the host to ``plug``."""
        ...

    def report_error(self, error_class: int) -> None:
        """Let the host's adapter tell of an error on the bus, where it is one that does."""
        ...


class SerialWire(Protocol):
    """A serial line as the device at its far end sees it."""

    def to_host(self, data: bytes, begun_ns: int | None = None) -> None:
        """Write bytes towards the host; the first of them left now, or at ``begun_ns``."""
        ...

    def attach(self, plug: "SerialConnector") -> None:
        """Deliver what the host writes to ``plug``."""
        ...

    @property
    def host_baud(self) -> int | None:
        """The rate at which the host has the line open; None where nobody can say."""
        ...

    @property
    def paced(self) -> bool:
        """Whether bytes take their time on it; else the host may have them before they can have been sent."""
        ...


class Plug(ABC):
    """What every plug can suffer. One that nobody tampers with calls its wire and its device directly."""

    def __init__(self) -> None:
        self.connected = True
        self._tampers = Tampers(self._connect)

    def cut(self) -> None:
        """Pull the plug: nothing passes either way."""
        self.connected = False

    def mend(self) -> None:
        """Put it back."""
        self.connected = True

    def tamper(self, *, to_host: Tamper | None = None, to_device: Tamper | None = None) -> Callable[[], None]:
        """From now on let these decide what becomes of each piece that passes; returns what takes them away again."""
        return self._tampers.add(to_host, to_device)

    @abstractmethod
    def _connect(self) -> None:
        """Put what tampers between the wire and the device."""


class CanConnector(Plug):
    """Connects one device to a CAN bus."""

    def __init__(self, wire: CanWire) -> None:
        super().__init__()
        self.wire = wire
        self._receive: Callable[[can.Message], None] = _ignore
        self._connect()
        wire.attach(self)

    def on_frame(self, receive: Callable[[can.Message], None]) -> None:
        """Call ``receive`` for every frame that the host sends on this bus."""
        self._receive = receive
        self._connect()

    def send(self, arbitration_id: int, data: bytes, *, extended: bool = False, fd: bool = False) -> None:
        """Send a frame, where the plug is in."""
        if self.connected:
            self._to_host(arbitration_id, data, extended, fd)

    def deliver(self, message: can.Message) -> None:
        """Hand a frame to the device, where the plug is in."""
        if self.connected:
            self._to_device(message)

    def overhear(self, message: can.Message) -> None:
        """As :meth:`deliver`, for a frame of another node's, which nobody tampers with."""
        if self.connected:
            self._receive(message)

    def _connect(self) -> None:
        self._to_host = tampered_frames(self.wire.to_host, self._tampers.to_host)
        self._to_device = tampered_messages(self._receive, self._tampers.to_device)


class SerialConnector(Plug):
    """Connects one device to a serial line."""

    def __init__(self, wire: SerialWire) -> None:
        super().__init__()
        self.wire = wire
        self._receive: Callable[[bytes], None] = _ignore
        self._connect()
        wire.attach(self)

    def on_bytes(self, receive: Callable[[bytes], None]) -> None:
        """Call ``receive`` for what the host writes, however it is cut."""
        self._receive = receive
        self._connect()

    def send(self, data: bytes) -> None:
        """Send bytes, where the plug is in."""
        if self.connected:
            self._to_host(data)

    def deliver(self, data: bytes) -> None:
        """Hand bytes to the device, where the plug is in."""
        if self.connected:
            self._to_device(data)

    def _connect(self) -> None:
        self._to_host = tampered_bytes(self.wire.to_host, self._tampers.to_host)
        self._to_device = tampered_bytes(self._receive, self._tampers.to_device)


def _ignore(_received: object) -> None:
    """A device that listens to nothing."""
