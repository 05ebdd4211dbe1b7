"""A serial port read as a real-time loop wants it: nothing waits for the system to hand bytes over.

Linux moves what a serial device has sent from one buffer to another in a thread of its own, of no priority at all. Who
reads, or asks by ``poll`` or ``select``, where nothing has been moved yet, waits for that thread: now and then for most
of a millisecond. Who asks for the count does not, and finds the bytes when he next looks.
"""

import os

import serial


class LowLatencySerial:
    """An open port of pyserial's for POSIX, without a timeout."""

    def __init__(self, line: serial.Serial) -> None:
        self._line = line
        self._descriptor: int = line.fileno()

    @property
    def in_waiting(self) -> int:
        """How many bytes can be read at once. Raises OSError for a lost port."""
        # A port that was pulled out reads as one on which nothing comes; asked for its count, it says so.
        return int(self._line.in_waiting)

    def read(self, size: int = 1) -> bytes:
        """At most ``size`` bytes, and no fewer than were counted. Raises OSError."""
        try:
            return os.read(self._descriptor, size)
        except BlockingIOError:
            return b""

    def write(self, data: bytes, /) -> int | None:
        """As pyserial does."""
        written: int | None = self._line.write(data)
        return written

    def close(self) -> None:
        """As pyserial does."""
        self._line.close()
