"""python-can buses whose own reader is not fit for a 1 kHz loop, or dies of one bad line: the same buses, mended."""

import select
import socket
import struct
import sys
import time
from typing import Any

import can
import serial
from can.interfaces.slcan import slcanBus
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message, unpack_message

from drivers.codecs.slcan import SlcanFrame, SlcanStream

_TIMESTAMP = struct.Struct("@ll")
_ANCILLARY_SPACE = socket.CMSG_SPACE(_TIMESTAMP.size)
_DATAGRAM_MAX = 4096
# Linux' <linux/in.h> and <linux/in6.h>; Python has no names for them.
_MULTICAST_ALL = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}


class QuietUdpBus(UdpMulticastBus):
    """UDP multicast without the echo of one's own frames or other groups' traffic, and with a receive that never waits.

    python-can sends from the socket it receives on, whose address every peer on this machine shares, so that its own
    frames cannot be told from theirs. Here frames leave by a socket of their own, whose address is ours alone. And
    Linux hands a socket the datagrams of every group that any program on the machine has joined, unless told not to.
    ``malformed`` counts datagrams that are no frames.
    """

    def __init__(self, channel: str, **options: Any) -> None:
        try:
            super().__init__(channel, **options)
        except Exception:
            self._is_shutdown = True  # else python-can complains on standard error that it was not shut down
            raise
        self.malformed = 0
        self._receiver = self._multicast._socket  # python-can gives no other way to it
        self._receiver.setblocking(False)  # it is read without waiting, or after a select
        if sys.platform == "linux":
            self._receiver.setsockopt(*_MULTICAST_ALL[self._receiver.family], 0)
        self._sender = socket.socket(self._receiver.family, socket.SOCK_DGRAM)
        try:
            self._own_address = self._join(self._sender)
        except OSError:
            self.shutdown()
            raise

    def _join(self, sender: socket.socket) -> tuple[Any, ...]:
        """Point ``sender`` at the group, as far-reaching as the receiving socket; returns its own address."""
        level, option = (
            (socket.IPPROTO_IP, socket.IP_MULTICAST_TTL)
            if sender.family == socket.AF_INET
            else (socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS)
        )
        sender.setsockopt(level, option, self._receiver.getsockopt(level, option))
        sender.connect((self._multicast.group, self._multicast.port))
        return tuple(sender.getsockname()[:2])

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        try:
            self._sender.send(pack_message(msg))
        except OSError as error:
            raise can.CanOperationError(f"cannot send: {error}") from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if timeout != 0:
            select.select([self._receiver], [], [], timeout)
        while (datagram := self._read_datagram()) is not None:
            payload, stamp_s = datagram
            try:
                return unpack_message(payload, replace={"timestamp": stamp_s}), False
            except Exception:  # msgpack and python-can raise many kinds for bytes that are no frame
                self.malformed += 1
        return None, False

    def _read_datagram(self) -> tuple[bytes, float] | None:
        """The next datagram of somebody else's, with the kernel's time stamp [s]."""
        while True:
            try:
                payload, ancillary, _, sender = self._receiver.recvmsg(_DATAGRAM_MAX, _ANCILLARY_SPACE)
            except BlockingIOError:
                return None
            except OSError as error:
                raise can.CanOperationError(f"cannot receive: {error}") from error
            if sender[:2] != self._own_address:
                return payload, _kernel_stamp_s(ancillary)

    def shutdown(self) -> None:
        super().shutdown()
        self._sender.close()


def _kernel_stamp_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    for _, _, data in ancillary:
        if len(data) == _TIMESTAMP.size:
            seconds, nanoseconds = _TIMESTAMP.unpack(data)
            return float(seconds + nanoseconds * 1e-9)
    return time.time()


class SteadySlcanBus(slcanBus):
    """slcan (a serial line of ASCII frames) read in whole chunks, and alive after a malformed line.

    python-can reads byte by byte, with two system calls each, and raises for a line that it cannot parse.
    ``malformed`` counts those.
    """

    def __init__(self, channel: str, **options: Any) -> None:
        self._stream = SlcanStream()
        super().__init__(channel, **{"sleep_after_open": 0.0, **options})

    @property
    def malformed(self) -> int:
        return self._stream.malformed

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._stream.frames:
            self._fill(timeout)
        if not self._stream.frames:
            return None, False
        return _message(self._stream.frames.popleft()), False

    def _fill(self, timeout: float | None) -> None:
        line = self.serialPortOrig
        try:
            if timeout != 0:
                line.timeout = timeout
                self._stream.feed(line.read(1))
            self._stream.feed(line.read(line.in_waiting))
        except (serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"cannot receive: {error}") from error

    def _write(self, string: str) -> None:
        # Without python-can's flush: it waits until the last byte has left, which is an adapter's latency each frame.
        try:
            self.serialPortOrig.write(string.encode() + self.LINE_TERMINATOR)
        except (serial.SerialException, OSError) as error:
            raise can.CanOperationError(f"cannot send: {error}") from error


def _message(frame: SlcanFrame) -> can.Message:
    return can.Message(
        timestamp=time.time(),
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=frame.length,
        data=None if frame.remote else frame.data,
    )
