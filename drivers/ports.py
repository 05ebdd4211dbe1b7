"""One CAN bus or one serial line, shared by the drivers on it: sends, drains what arrived, hands it on, keeps a tap.

Nothing here blocks: :meth:`poll` takes what the transport already holds.
"""

from collections.abc import Callable
from typing import Protocol

import can

from drivers.clock import Clock
from drivers.errors import ConnectionFailedError
from drivers.readings import RawFrame

Tap = Callable[[RawFrame], None]
FrameHandler = Callable[[can.Message, int], None]
BytesHandler = Callable[[bytes, int], None]


class SerialLine(Protocol):
    """The part of pyserial's ``Serial`` that is used."""

    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1) -> bytes: ...
    def write(self, data: bytes, /) -> int | None: ...
    def close(self) -> None: ...


class CanPort:
    """A CAN bus with its listeners.

    Parameters: the open bus; ``arrival_ns(message)``, which puts a received message's time stamp on ``clock``.
    """

    def __init__(self, name: str, bus: can.BusABC, clock: Clock, arrival_ns: Callable[[can.Message], int]) -> None:
        self.name = name
        self.bus = bus
        self.tap: Tap | None = None
        self.error_frames = 0
        self._clock = clock
        self._arrival_ns = arrival_ns
        self._handlers: list[FrameHandler] = []

    def subscribe(self, handler: FrameHandler) -> None:
        """Call ``handler(message, arrival_ns)`` for every data or remote frame received."""
        self._handlers.append(handler)

    def send(self, arbitration_id: int, data: bytes, *, extended: bool = False, remote: bool = False) -> None:
        """Put one frame on the bus. Raises ConnectionFailedError where the transport refuses it."""
        # Positions: stamp, identifier, extended, remote, error frame, channel, length.
        message = can.Message(0.0, arbitration_id, extended, remote, False, None, 8 if remote else len(data), data)
        try:
            self.bus.send(message)
        except (can.CanError, OSError) as error:
            raise ConnectionFailedError(
                f"bus {self.name}: cannot send ({error}); is the adapter plugged in?"
            ) from error
        if self.tap is not None:
            self.tap(RawFrame(self._clock.now_ns(), self.name, True, data, arbitration_id, extended, remote))

    def poll(self) -> int:
        """Hand on every frame that has arrived; returns how many. Raises ConnectionFailedError for a lost bus."""
        count, receive = 0, self.bus.recv
        while True:
            try:
                message = receive(0)
            except (can.CanError, OSError, ValueError) as error:
                raise ConnectionFailedError(f"bus {self.name}: lost ({error}); check adapter and cable") from error
            if message is None:
                return count
            count += 1
            self._hand_on(message)

    def _hand_on(self, message: can.Message) -> None:
        if message.is_error_frame:
            self.error_frames += 1
            return
        arrival_ns = self._arrival_ns(message)
        if self.tap is not None:
            self.tap(
                RawFrame(
                    arrival_ns,
                    self.name,
                    False,
                    bytes(message.data),
                    message.arbitration_id,
                    message.is_extended_id,
                    message.is_remote_frame,
                )
            )
        for handler in self._handlers:
            handler(message, arrival_ns)

    def close(self) -> None:
        """Release the bus."""
        self.bus.shutdown()


class SerialPort:
    """A serial line with its one listener."""

    def __init__(self, name: str, line: SerialLine, clock: Clock, arrival_ns: Callable[[], int] | None = None) -> None:
        self.name = name
        self.line = line
        self.tap: Tap | None = None
        self._clock = clock
        self._arrival_ns = arrival_ns or clock.now_ns
        self._handler: BytesHandler | None = None

    def subscribe(self, handler: BytesHandler) -> None:
        """Call ``handler(data, arrival_ns)`` for what was received; arrival is that of the last byte."""
        self._handler = handler

    def send(self, data: bytes) -> None:
        """Write bytes. Raises ConnectionFailedError where the port refuses them."""
        try:
            self.line.write(data)
        except OSError as error:
            raise ConnectionFailedError(f"port {self.name}: cannot write ({error}); is it plugged in?") from error
        if self.tap is not None:
            self.tap(RawFrame(self._clock.now_ns(), self.name, True, data))

    def poll(self) -> int:
        """Hand on the bytes that have arrived; returns how many. Raises ConnectionFailedError for a lost port."""
        total = 0
        # A line that knows when its bytes came hands them out burst by burst, each with its own arrival.
        while data := self._read():
            total += len(data)
            arrival_ns = self._arrival_ns()
            if self.tap is not None:
                self.tap(RawFrame(arrival_ns, self.name, False, data))
            if self._handler is not None:
                self._handler(data, arrival_ns)
        return total

    def _read(self) -> bytes:
        try:
            waiting = self.line.in_waiting
            return self.line.read(waiting) if waiting else b""
        except OSError as error:
            raise ConnectionFailedError(f"port {self.name}: lost ({error}); check the cable") from error

    def close(self) -> None:
        """Release the line."""
        self.line.close()
