"""How long bytes travel: delay and jitter of one direction of a wire, on which nothing overtakes."""

import errno
import os
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import Protocol

import can
import serial

BITS_PER_BYTE = 10  # start, eight data bits, stop


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


class Trouble(Enum):
    """What can befall the host's own end of a wire, and how python-can and pyserial tell the host of it.

    Sources: python-can 4.5, ``interfaces/socketcan/socketcan.py`` (``_send_once``, ``capture_message``); pyserial
    3.5, ``serialposix.py``; Linux, ``Documentation/networking/can.rst`` and ``include/uapi/linux/can/error.h``.
    That a CAN interface takes ten frames more once nothing leaves it, its ``txqueuelen``, is python-can's issue
    310.

    What befalls it.
    """

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
