"""The socketcan bus on a datagram socket in the place of the kernel's CAN socket, with frames as the kernel lays them
out; `make socketcan` runs it on real ones."""

import errno
import socket
import struct
from collections.abc import Iterator

import can
import pytest
from can.interfaces.socketcan import socketcan as python_can

from norton_drivers.adapters.steady_socketcan import SteadySocketcanBus
from norton_drivers.errors import ConnectionFailedError
from norton_drivers.ports import CanPort, MonotonicClock

STAMP = (1_700_000_000, 250_000_000)  # s, ns
FRAME = struct.Struct("=IB3x8s")  # <linux/can.h>: identifier and flags, length, padding, data


class Socket:
    """Of a pair of datagram sockets ours, with what a CAN socket adds: a time stamp for each frame, and errors."""

    def __init__(self, ours: socket.socket) -> None:
        self._ours = ours
        self.failure: int | None = None

    def recvmsg(self, size: int, _space: int) -> tuple[bytes, list[tuple[int, int, bytes]], int, str]:
        self._fail()
        stamp = (socket.SOL_SOCKET, python_can.constants.SO_TIMESTAMPNS, struct.pack("@ll", *STAMP))
        return self._ours.recv(size), [stamp], 0, "can0"

    def send(self, data: bytes) -> int:
        self._fail()
        return self._ours.send(data)

    def _fail(self) -> None:
        if self.failure is not None:
            raise OSError(self.failure, "as the kernel says")

    def setsockopt(self, *_: object) -> None: ...

    def setblocking(self, flag: bool) -> None:
        self._ours.setblocking(flag)

    def fileno(self) -> int:
        return self._ours.fileno()

    def close(self) -> None:
        self._ours.close()


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[SteadySocketcanBus, Socket, socket.socket]]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    kernel = Socket(ours)
    monkeypatch.setattr(python_can, "create_socket", lambda: kernel)
    monkeypatch.setattr(python_can, "bind_socket", lambda *_: None)
    bus = SteadySocketcanBus("can0", bitrate=500_000)
    yield bus, kernel, theirs
    bus.shutdown()
    theirs.close()


def test_frames_both_ways(wire):
    bus, _, peer = wire
    bus.send(can.Message(arbitration_id=0x21, is_extended_id=False, data=b"\1\2"))
    assert FRAME.unpack(peer.recv(72)) == (0x21, 2, b"\1\2".ljust(8, b"\0"))
    assert bus.recv(0) is None
    for frame in (0x21, 0x8012_3456, 0x4000_0021, 0x2000_0040):
        peer.send(FRAME.pack(frame, 8, b"12345678"))
    got = [bus.recv(0) for _ in range(5)]
    assert [
        (m.arbitration_id, m.is_extended_id, m.is_remote_frame, m.is_error_frame) for m in got if m is not None
    ] == [
        (0x21, False, False, False),
        (0x12_3456, True, False, False),
        (0x21, False, True, False),
        (0x40, False, False, True),
    ]
    assert got[0].timestamp == 1_700_000_000.25
    assert bytes(got[0].data) == b"12345678"


def test_who_waits_is_woken(wire):
    bus, _, peer = wire
    assert bus.recv(0.001) is None
    peer.send(FRAME.pack(0x21, 0, b""))
    assert bus.recv(1.0).arbitration_id == 0x21


def test_a_full_buffer_is_told_and_never_waited_for(wire):
    bus, _, _ = wire
    port = CanPort("arm", bus, MonotonicClock(), lambda _message: 0)

    def fill() -> None:
        for _ in range(100_000):
            port.send(0x21, bytes(8))

    with pytest.raises(ConnectionFailedError, match=r"bus arm: cannot send \(the kernel's transmit queue is full\)"):
        fill()


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOBUFS, r"\(the kernel's transmit queue is full\); .* `sudo ip link set can0 txqueuelen 100`"),
        (errno.ENETDOWN, r"\(the link is down\); `sudo ip link set can0 up`"),
        (errno.ENODEV, r"\(the link has gone\); is the adapter plugged in\?"),
        (errno.EPERM, r"\(Operation not permitted\); see `ip -details link show can0`"),
    ],
)
def test_what_the_kernel_refuses_is_one_sentence_with_the_mend(wire, number, words):
    bus, kernel, _ = wire
    port = CanPort("arm", bus, MonotonicClock(), lambda _message: 0)
    kernel.failure = number
    with pytest.raises(ConnectionFailedError, match="bus arm: cannot send " + words):
        port.send(0x21, b"")
    with pytest.raises(ConnectionFailedError, match="bus arm: lost " + words):
        port.poll()
