"""python-can's socketcan bus with one system call for a frame in place of three, and errors that name their remedy."""

import errno
import os

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan.socketcan import build_can_frame, capture_message

from norton_drivers.adapters.adapter import FullQueueError, LinkError

_FULL = (errno.ENOBUFS, errno.EAGAIN)  # of the link's queue, or of the socket's own buffer
_GONE = (errno.ENODEV, errno.ENXIO)


class SteadySocketcanBus(SocketcanBus):
    """SocketCAN whose ``recv(0)`` and ``send`` never wait.

    python-can asks for the time and whether the socket is ready before every frame, and once more to find that no
    further one is there.
    """

    def __init__(self, channel: str, **options: object) -> None:
        super().__init__(channel, **options)  # type: ignore[arg-type]
        self.socket.setblocking(False)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Raises LinkError for a link that went down or was unplugged."""
        try:
            return capture_message(self.socket) if timeout == 0 else super().recv(timeout)
        except can.CanOperationError as error:
            if error.error_code == errno.EAGAIN:
                return None
            raise self._explained(error.error_code or 0) from error

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Raises LinkError, also where the kernel's queue is full."""
        try:
            self.socket.send(build_can_frame(msg))
        except OSError as error:
            raise self._explained(error.errno or 0) from error

    def _explained(self, code: int) -> LinkError:
        if code in _FULL:
            return FullQueueError(
                "the kernel's transmit queue is full",
                "is another device switched on, to acknowledge the frames? If so, lengthen the queue: "
                f"`sudo ip link set {self.channel} txqueuelen 100`",
            )
        if code == errno.ENETDOWN:
            return LinkError("the link is down", f"`sudo ip link set {self.channel} up`")
        if code in _GONE:
            return LinkError("the link has gone", "is the adapter plugged in?")
        return LinkError(os.strerror(code), f"see `ip -details link show {self.channel}`")
