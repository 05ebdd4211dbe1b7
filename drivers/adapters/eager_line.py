"""A serial port read as a fast loop wants it: one system call for all that is there, instead of four."""

import os

import serial

# More than any driver of the system keeps.
READ_MAX = 65536


class EagerLine:
    """An open port of pyserial's for POSIX, without a timeout. Reads ahead when it is asked how much there is."""

    def __init__(self, line: serial.Serial) -> None:
        self._line = line
        self._descriptor: int = line.fileno()
        self._ahead = b""

    @property
    def in_waiting(self) -> int:
        """How many bytes can be read at once. Raises OSError for a lost port."""
        if not self._ahead:
            try:
                self._ahead = os.read(self._descriptor, READ_MAX)
            except BlockingIOError:
                return 0
        # A port that was pulled out reads as one that has ended; asked for its count, it says so.
        return len(self._ahead) or int(self._line.in_waiting)

    def read(self, size: int = 1) -> bytes:
        """At most ``size`` of the bytes that are there. Raises OSError."""
        if not self.in_waiting:
            return b""
        data, self._ahead = self._ahead[:size], self._ahead[size:]
        return data

    def write(self, data: bytes, /) -> int | None:
        """As pyserial does."""
        written: int | None = self._line.write(data)
        return written

    def close(self) -> None:
        """As pyserial does."""
        self._line.close()
