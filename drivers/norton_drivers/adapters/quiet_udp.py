"""UDP multicast as a CAN bus between processes: python-can's own, without the echo of one's own frames."""

import ctypes
import select
import socket
import struct
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import can
import msgpack
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import unpack_message

_TIMESTAMP = struct.Struct("@ll")
_ANCILLARY_SPACE = socket.CMSG_SPACE(_TIMESTAMP.size)
_DATAGRAM_MAX = 4096
# Linux' <linux/in.h> and <linux/in6.h>; Python has no names for them.
_MULTICAST_ALL = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}
# Linux' <linux/filter.h>: an instruction is a code, two jumps and a number; a program, how many and where they are.
_INSTRUCTION, _ATTACH_FILTER, _IP_HEADER = struct.Struct("=HBBI"), 26, 0xFFF00000
_LOAD_HALF, _LOAD_WORD, _IF_EQUAL, _RETURN = 0x28, 0x20, 0x15, 0x06


class _Program(ctypes.Structure):
    _fields_ = (("count", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


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
        self._packer = msgpack.Packer(use_bin_type=True)
        self._sender = socket.socket(self._receiver.family, socket.SOCK_DGRAM)
        try:
            self._own_address = self._join(self._sender)
            if sys.platform == "linux" and self._sender.family == socket.AF_INET:
                _leave_out(self._receiver, self._own_address)
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
            self._sender.send(self._packed(msg))
        except OSError as error:
            raise can.CanOperationError(f"cannot send: {error}") from error

    def _packed(self, msg: can.Message) -> bytes:
        """As python-can packs it, which makes a packer for every frame."""
        frame = {
            "timestamp": msg.timestamp,
            "arbitration_id": msg.arbitration_id,
            "is_extended_id": msg.is_extended_id,
            "is_remote_frame": msg.is_remote_frame,
            "is_error_frame": msg.is_error_frame,
            "channel": msg.channel,
            "dlc": msg.dlc,
            "data": msg.data,
            "is_fd": msg.is_fd,
            "bitrate_switch": msg.bitrate_switch,
            "error_state_indicator": msg.error_state_indicator,
        }
        packed: bytes = self._packer.pack(frame)
        return packed

    def ask(self) -> None:
        """There is no adapter to ask."""

    def troubles(self) -> Mapping[str, int]:
        return {"malformed datagrams": self.malformed}

    @property
    def off_bus(self) -> str | None:
        return None

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As python-can's own, which takes a third longer to find that there is nothing to wait for or to filter."""
        if timeout != 0 or self._filters:
            return super().recv(timeout)
        return self._recv_internal(0)[0]

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


def _leave_out(receiver: socket.socket, address: tuple[Any, ...]) -> None:
    """Let the kernel drop what comes from ``address``, if it will: else one's own frames are read, and left out."""
    host, port = address
    lines = (
        (_LOAD_HALF, 0, 0, 0),  # the source port: a program of a UDP socket begins at its header
        (_IF_EQUAL, 0, 3, port),
        (_LOAD_WORD, 0, 0, _IP_HEADER + 12),  # the source address
        (_IF_EQUAL, 0, 1, int.from_bytes(socket.inet_aton(host), "big")),
        (_RETURN, 0, 0, 0),
        (_RETURN, 0, 0, _DATAGRAM_MAX),
    )
    program = _Program(len(lines), b"".join(_INSTRUCTION.pack(*line) for line in lines))
    with suppress(OSError):
        receiver.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, bytes(program))


def _kernel_stamp_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    for _, _, data in ancillary:
        if len(data) == _TIMESTAMP.size:
            seconds, nanoseconds = _TIMESTAMP.unpack(data)
            return float(seconds + nanoseconds * 1e-9)
    return time.time()
