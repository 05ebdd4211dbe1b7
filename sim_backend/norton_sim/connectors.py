"""Where a device meets its wire. A plug can be pulled or tampered with; a wire carries its bytes to the host."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple, Protocol

import can

FrameSender = Callable[[int, bytes, bool], None]
MessageReceiver = Callable[[can.Message], None]
BytesPassage = Callable[[bytes], None]


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
    return lambda arbitration_id, data, extended: tamper(
        Piece(data, lambda passed: send(arbitration_id, passed, extended))
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
    return can.Message(message.timestamp, message.arbitration_id, message.is_extended_id, data=data)


class CanWire(Protocol):
    """A CAN bus as the devices on it see it."""

    def to_host(self, arbitration_id: int, data: bytes, extended: bool) -> None:
        """Put a data frame on the bus."""
        ...

    def attach(self, plug: "CanConnector") -> None:
        """Deliver every frame from the host to ``plug``."""
        ...

    def report_error(self, error_class: int) -> None:
        """Let the host's adapter tell of an error on the bus, where it is one that does."""
        ...


class SerialWire(Protocol):
    """A serial line as the device at its far end sees it."""

    def to_host(self, data: bytes) -> None:
        """Write bytes towards the host."""
        ...

    def attach(self, plug: "SerialConnector") -> None:
        """Deliver what the host writes to ``plug``."""
        ...

    @property
    def host_baud(self) -> int | None:
        """The rate at which the host has the line open; None where nobody can say."""
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

    def send(self, arbitration_id: int, data: bytes, *, extended: bool = False) -> None:
        """Send a frame, where the plug is in."""
        if self.connected:
            self._to_host(arbitration_id, data, extended)

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
