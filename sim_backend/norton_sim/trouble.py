"""What can befall the host's own end of a wire, and how python-can and pyserial tell the host of it.

Sources: python-can 4.5, ``interfaces/socketcan/socketcan.py`` (``_send_once``, ``capture_message``); pyserial 3.5,
``serialposix.py``; Linux, ``Documentation/networking/can.rst`` and ``include/uapi/linux/can/error.h``. That a CAN
interface takes ten frames more once nothing leaves it, its ``txqueuelen``, is python-can's issue 310.
"""

import errno
import os
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import can
import serial

TRANSMIT_QUEUE = 10  # frames
CAN_ERR_PROTOCOL = 0x08  # error classes, in an error frame's identifier
CAN_ERR_BUS_OFF = 0x40


class Trouble(Enum):
    """What befalls it."""

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
