"""Where a device meets its wire. A plug can be pulled, and a wire is whatever carries its bytes to the host."""

from collections.abc import Callable
from typing import Protocol

import can


class CanWire(Protocol):
    """A CAN bus as the devices on it see it."""

    def to_host(self, arbitration_id: int, data: bytes, extended: bool) -> None:
        """Put a data frame on the bus."""
        ...

    def attach(self, plug: "CanPlug") -> None:
        """Deliver every frame from the host to ``plug``."""
        ...


class SerialWire(Protocol):
    """A serial line as the device at its far end sees it."""

    def to_host(self, data: bytes) -> None:
        """Write bytes towards the host."""
        ...

    def attach(self, plug: "SerialPlug") -> None:
        """Deliver what the host writes to ``plug``."""
        ...


class CanPlug:
    """Connects one device to a CAN bus."""

    def __init__(self, wire: CanWire) -> None:
        self.connected = True
        self._wire = wire
        self._receive: Callable[[can.Message], None] = _ignore
        wire.attach(self)

    def on_frame(self, receive: Callable[[can.Message], None]) -> None:
        """Call ``receive`` for every frame that the host sends on this bus."""
        self._receive = receive

    def send(self, arbitration_id: int, data: bytes, *, extended: bool = False) -> None:
        """Send a frame, where the plug is in."""
        if self.connected:
            self._wire.to_host(arbitration_id, data, extended)

    def deliver(self, message: can.Message) -> None:
        """Hand a frame to the device, where the plug is in."""
        if self.connected:
            self._receive(message)

    def cut(self) -> None:
        """Pull the plug: nothing passes either way."""
        self.connected = False

    def mend(self) -> None:
        """Put it back."""
        self.connected = True


class SerialPlug:
    """Connects one device to a serial line."""

    def __init__(self, wire: SerialWire) -> None:
        self.connected = True
        self._wire = wire
        self._receive: Callable[[bytes], None] = _ignore
        wire.attach(self)

    def on_bytes(self, receive: Callable[[bytes], None]) -> None:
        """Call ``receive`` for what the host writes, however it is cut."""
        self._receive = receive

    def send(self, data: bytes) -> None:
        """Send bytes, where the plug is in."""
        if self.connected:
            self._wire.to_host(data)

    def deliver(self, data: bytes) -> None:
        """Hand bytes to the device, where the plug is in."""
        if self.connected:
            self._receive(data)

    def cut(self) -> None:
        """Pull the plug: nothing passes any more."""
        self.connected = False

    def mend(self) -> None:
        """Put it back."""
        self.connected = True


def _ignore(_received: object) -> None:
    """A device that listens to nothing."""
