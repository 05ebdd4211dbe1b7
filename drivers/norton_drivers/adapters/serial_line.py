"""Serial ports read as a real-time loop wants them, and what to do where one cannot be opened.

Linux moves what a serial device has sent from one buffer to another in a thread of its own, of no priority at all. Who
reads, or asks by ``poll`` or ``select``, before anything has been moved waits for that thread: now and then for most
of a millisecond. Who asks for the count does not wait, and finds the bytes at the next look.
"""

import errno
import os
import socket
import struct
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path

import serial

if sys.platform != "win32":
    import fcntl
    import termios


def serial_mend(error: BaseException | None) -> str:
    """The half sentence after the failure; python-can wraps pyserial's error in one of its own."""
    numbers = set()
    while error is not None:
        numbers.add(getattr(error, "errno", None))
        error = error.__cause__
    if numbers & {errno.EACCES, errno.EPERM}:
        return "this user may not open it: `sudo usermod -aG dialout $USER`, then log in again"
    if numbers & {errno.EBUSY, errno.EAGAIN}:
        return "another program has it open: close that one (ModemManager and slcand are known to take such ports)"
    if errno.ENOENT in numbers:
        return "is it plugged in? `norton-bench devices` lists what is"
    return "is it a serial port, plugged in and free, and may this user open it (group dialout)?"


def hurry(line: serial.Serial) -> None:
    """Let a USB adapter hand bytes on at once, where its Linux driver heeds that: FTDI's then waits for 1 ms, not 16.

    Source: Linux, drivers/usb/serial/ftdi_sio.c (``write_latency_timer``, ``ASYNC_LOW_LATENCY``), which any user who
    has the port open may set. Other adapters have no such timer, or do not tell.
    """
    if hasattr(line, "set_low_latency_mode"):
        with suppress(OSError, ValueError):
            line.set_low_latency_mode(True)


COUNT = struct.Struct("i")


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


class EagerSocket(LowLatencySerial):
    """The same for ``socket://host:port``, a serial line behind TCP, of which pyserial hands out byte by byte.

    No thread of the system's stands between: a computer with other work hands on at once what has come. Nor does a
    second write wait until the far end has acknowledged the first (Nagle's algorithm), for which it may take 40 ms.
    """

    def __init__(self, line: serial.Serial) -> None:
        super().__init__(line)
        self._socket = socket.fromfd(self._descriptor, socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def in_waiting(self) -> int:
        """How many bytes can be read at once. Raises OSError where the other end has closed the line."""
        result: int = COUNT.unpack(fcntl.ioctl(self._descriptor, termios.FIONREAD, bytes(COUNT.size)))[0]
        if not result and self._ended():
            raise OSError("its far end has closed it")
        return result

    def _ended(self) -> bool:
        try:
            return not self._socket.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return False

    def close(self) -> None:
        """As pyserial does."""
        self._socket.close()
        super().close()


_PSEUDO_TERMINAL_BAUD = 115_200
# A device that takes no more bytes must not hold up the loop.
_WRITE_TIMEOUT_S = 0.2

Line = LowLatencySerial | serial.Serial


def open_line(port: str, baud: int) -> Line:
    """A serial port, or any of pyserial's URLs, as a loop wants it where it has a descriptor of its own.

    Raises serial.SerialException, OSError, ValueError.
    """
    line = _opened(port, baud)
    if os.name != "posix" or ("://" in port and not port.startswith("socket://")):
        return line
    if "://" in port:
        return EagerSocket(line)
    hurry(line)
    return LowLatencySerial(line)


def _opened(port: str, baud: int) -> serial.Serial:
    exclusive = None if "://" in port else True  # pyserial's URL handlers know no locks
    open_it = partial(serial.serial_for_url, port, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=exclusive)
    try:
        return open_it(baudrate=baud)
    except (serial.SerialException, OSError, ValueError):
        if not _is_pseudo_terminal(port):
            raise
    # A pseudo-terminal has no baud rate, but may refuse to be given an odd one.
    return open_it(baudrate=_PSEUDO_TERMINAL_BAUD)


def _is_pseudo_terminal(port: str) -> bool:
    return str(Path(port).resolve()).startswith("/dev/pts/")
