"""The hardware backend on what this machine has: multicast sockets and pseudo-terminals, met by python-can's own."""

import os
import pty
import select
import socket
import sys
import threading
import time
import tty
from contextlib import closing, contextmanager

import can
import pytest
from can.interfaces.slcan import slcanBus
from can.interfaces.udp_multicast.utils import pack_message
from hypothesis import given
from hypothesis import strategies as st

from norton_drivers.adapters.quiet_udp import QuietUdpBus
from norton_drivers.errors import ConnectionFailedError
from norton_drivers.hardware import HardwareBackend, _ArrivalTime, open_backend
from norton_drivers.ports import MonotonicClock
from norton_drivers.wiring import CanBusSettings, DeviceSettings, Wiring

# A group and a port of this process's own: python-can's bus hears every group that is joined on the machine.
GROUP = f"239.74.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"
UDP_PORT = 20_000 + os.getpid() % 10_000
pytestmark = pytest.mark.wall_time


@pytest.fixture
def backend():
    made = HardwareBackend()
    yield made
    made.close()


@pytest.fixture(scope="module")
def packing():
    bus = QuietUdpBus(GROUP, port=UDP_PORT, hop_limit=0)
    yield bus
    bus.shutdown()


def udp() -> CanBusSettings:
    return CanBusSettings("can0", "udp_multicast", GROUP, options={"port": UDP_PORT})


def stranger(group: str = GROUP) -> can.BusABC:
    return can.Bus(group, "udp_multicast", port=UDP_PORT)


def gather(port, count: int, within_s: float = 2.0) -> list[tuple[can.Message, int]]:
    """Poll until ``count`` messages came, and a little longer, so that one too many would show."""
    got: list[tuple[can.Message, int]] = []
    port.subscribe(lambda message, arrival_ns: got.append((message, arrival_ns)))
    deadline = time.monotonic() + within_s
    while len(got) < count and time.monotonic() < deadline:
        port.poll()
    time.sleep(0.02)
    port.poll()
    return got


def test_the_entry_points_backend():
    wiring = Wiring("rig", 1_000_000, (), DeviceSettings("actuator", "odrive"))
    made = open_backend(wiring, {}, seed=None, place="rig.toml")
    assert isinstance(made.clock, MonotonicClock)
    assert made.lock_step is False
    made.close()
    made.close()


# ---- UDP multicast --------------------------------------------------------------------------------------------------


def test_udp_both_ways_without_echo(backend):
    port = backend.open_can(udp())
    with stranger() as peer:
        port.send(0x21, b"\1\2")
        port.send(0x22, b"", remote=True)
        assert [(m.arbitration_id, bytes(m.data), m.is_remote_frame) for m in (peer.recv(1), peer.recv(1))] == [
            (0x21, b"\1\2", False),
            (0x22, b"", True),
        ]
        peer.send(can.Message(arbitration_id=0x23, data=b"\3", is_extended_id=False))
        # python-can echoes a sender's own frames, which is what is kept away here.
        assert peer.recv(1).arbitration_id == 0x23
        assert [message.arbitration_id for message, _ in gather(port, 1)] == [0x23]


def test_udp_between_two_ports_of_ours(backend):
    first, second = backend.open_can(udp()), backend.open_can(udp())
    first.send(0x1, b"\1")
    assert [message.arbitration_id for message, _ in gather(second, 1)] == [0x1]
    assert gather(first, 1, within_s=0.05) == []


def test_udp_stays_on_this_computer_unless_told_otherwise(backend):
    far = CanBusSettings("far", "udp_multicast", GROUP, options={"port": UDP_PORT, "hop_limit": 3})
    for settings, hops in ((udp(), 0), (far, 3)):
        sender = backend.open_can(settings).bus._sender
        assert sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == hops


@given(
    message=st.builds(
        can.Message,
        timestamp=st.floats(0, 2e9),
        arbitration_id=st.integers(0, 2**29 - 1),
        is_extended_id=st.booleans(),
        is_error_frame=st.booleans(),
        data=st.binary(max_size=8),
        is_rx=st.booleans(),
        channel=st.none() | st.just("can0"),
    )
)
def test_udp_frames_are_packed_as_python_can_packs_them(packing, message):
    assert packing._packed(message) == pack_message(message)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux drops them before they are read")
def test_udp_own_frames_do_not_even_wait_to_be_read():
    bus = QuietUdpBus(GROUP, port=UDP_PORT)
    try:
        with stranger() as peer:
            bus.send(can.Message(arbitration_id=1))
            peer.send(can.Message(arbitration_id=2))
            assert select.select([bus._receiver], [], [], 1.0)[0]
            assert can.Message(arbitration_id=2).equals(bus.recv(0), check_direction=False, timestamp_delta=None)
        assert not select.select([bus._receiver], [], [], 0.0)[0]
    finally:
        bus.shutdown()


def test_udp_groups_are_apart(backend):
    port = backend.open_can(udp())
    other = GROUP.replace("239.74", "239.76")
    with stranger(other) as neighbour, stranger() as peer:
        neighbour.send(can.Message(arbitration_id=1, is_extended_id=False))
        peer.send(can.Message(arbitration_id=2, is_extended_id=False))
        assert [message.arbitration_id for message, _ in gather(port, 2, within_s=0.1)] == [2]


def test_udp_version_6():
    group = "ff15:7079:7468:6f6e:6465:6d6f:6d63:6173"
    bus = QuietUdpBus(group, port=UDP_PORT)
    try:
        bus.send(can.Message(arbitration_id=1))
        assert bus.recv(0.05) is None
        with stranger(group) as peer:
            peer.send(can.Message(arbitration_id=2))
            assert bus.recv(1).arbitration_id == 2
    finally:
        bus.shutdown()


def test_udp_arrival_is_the_kernels_stamp_not_the_polls(backend):
    port = backend.open_can(udp())
    with stranger() as peer:
        before_ns = time.monotonic_ns()
        peer.send(can.Message(arbitration_id=1, is_extended_id=False))
        after_ns = time.monotonic_ns()
        time.sleep(0.1)
        ((_, arrival_ns),) = gather(port, 1)
    # A tenth of a second passed before the poll; the wall clock may be slewed against the other by a little.
    assert before_ns - 1_000_000 <= arrival_ns <= after_ns + 50_000_000


def test_udp_survives_datagrams_that_are_no_frames(backend):
    port = backend.open_can(udp())
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
        for junk in (b"", b"\xc1", b"hello", b"\x81\xa1a\x01"):
            sender.sendto(junk, (GROUP, UDP_PORT))
    with stranger() as peer:
        peer.send(can.Message(arbitration_id=5, is_extended_id=False))
        assert [message.arbitration_id for message, _ in gather(port, 1)] == [5]
    assert port.troubles() == {"malformed datagrams": 4}


def test_udp_carries_error_frames(backend):
    port = backend.open_can(udp())
    with stranger() as peer:
        peer.send(can.Message(arbitration_id=0x20, is_error_frame=True, is_extended_id=False, data=bytes(8)))
        gather(port, 0, within_s=0.05)
    assert port.troubles() == {"no acknowledgement": 1}


# ---- Time stamps ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset_s", [-1e9, -11.0, 0.5, 1e9])
def test_an_implausible_stamp_is_replaced_by_now(offset_s):
    before_ns = time.monotonic_ns()
    arrival_ns = _ArrivalTime()(can.Message(timestamp=time.time() + offset_s))
    assert before_ns <= arrival_ns <= time.monotonic_ns()


def test_stamps_keep_their_distance_and_their_order():
    arrival = _ArrivalTime()
    now_s = time.time()
    first, second, third = (arrival(can.Message(timestamp=now_s - ago_s)) for ago_s in (0.5, 0.2, 0.3))
    assert abs(second - first - 300_000_000) < 20_000_000
    assert third == second


# ---- slcan ----------------------------------------------------------------------------------------------------------


@contextmanager
def relayed_terminals():
    """Two pseudo-terminals whose far ends are wired to each other, and a way to slip bytes to the first."""
    (near_a, far_a), (near_b, far_b) = pty.openpty(), pty.openpty()
    for end in (near_a, far_a, near_b, far_b):
        tty.setraw(end)
    running = threading.Event()
    running.set()

    def relay(source: int, sink: int) -> None:
        os.set_blocking(source, False)
        while running.is_set():
            try:
                os.write(sink, os.read(source, 4096))
            except BlockingIOError:
                time.sleep(0.0005)

    threads = [threading.Thread(target=relay, args=pair) for pair in ((near_a, near_b), (near_b, near_a))]
    for thread in threads:
        thread.start()
    try:
        yield os.ttyname(far_a), os.ttyname(far_b), lambda data: os.write(near_a, data)
    finally:
        running.clear()
        for thread in threads:
            thread.join()
        for end in (near_a, far_a, near_b, far_b):
            os.close(end)


def test_slcan_survives_garbage(backend):
    with relayed_terminals() as (ours, theirs, slip):
        port = backend.open_can(CanBusSettings("can0", "slcan", ours))
        with slcanBus(theirs, sleep_after_open=0) as peer:
            port.send(0x21, b"\1\2")
            port.send(0x22, b"", remote=True)
            received = []
            while len(received) < 2:
                message = peer.recv(1)
                if message is not None:
                    received.append((message.arbitration_id, bytes(message.data), message.is_remote_frame))
            assert received == [(0x21, b"\1\2", False), (0x22, b"", True)]

            slip(b"tXYZ3zz\r\xff\xfe\xfd\rt12\r")
            sent = [
                can.Message(arbitration_id=i, data=bytes(range(8)), is_extended_id=i > 0x7FF) for i in (0x7F, 0x800)
            ]
            for message in sent:
                peer.send(message)
            got = [message for message, _ in gather(port, 2)]
            assert [(m.arbitration_id, bytes(m.data), m.is_extended_id) for m in got] == [
                (m.arbitration_id, bytes(m.data), m.is_extended_id) for m in sent
            ]
            # The peer's own commands (close, open) are no frames to us either.
            assert port.troubles()["malformed lines"] >= 3
        backend.close()


# ---- Serial ---------------------------------------------------------------------------------------------------------


@contextmanager
def terminal():
    near, far = pty.openpty()
    tty.setraw(near)
    try:
        yield near, os.ttyname(far)
    finally:
        os.close(near)
        os.close(far)


@pytest.mark.parametrize("baud", [460_800, 12_345])
def test_serial_on_a_pseudo_terminal_at_any_baud(backend, baud):
    with terminal() as (near, path):
        port = backend.open_serial(path, baud)
        got: list[bytes] = []
        port.subscribe(lambda data, arrival_ns: got.append(data))
        assert port.poll() == 0
        os.write(near, b"\xaa\x00\x11\x13")
        deadline = time.monotonic() + 1
        while not got and time.monotonic() < deadline:
            port.poll()
        assert b"".join(got) == b"\xaa\x00\x11\x13"
        port.send(b"abc")
        assert os.read(near, 10) == b"abc"
        backend.close()


def test_serial_in_two_hands_is_refused(backend):
    with terminal() as (_, path):
        backend.open_serial(path, 460_800)
        with pytest.raises(ConnectionFailedError, match="another program has it open"):
            HardwareBackend().open_serial(path, 460_800)
        backend.close()


def test_a_lost_serial_port_is_told(backend):
    near, far = pty.openpty()
    port = backend.open_serial(os.ttyname(far), 460_800)
    os.close(far)
    os.close(near)
    with pytest.raises(ConnectionFailedError, match=r"lost.*check the cable"):
        port.poll()


def test_serial_by_url(backend):
    port = backend.open_serial("loop://", 460_800)
    got: list[bytes] = []
    port.subscribe(lambda data, arrival_ns: got.append(data))
    port.send(b"hello")
    port.poll()
    assert got == [b"hello"]


# ---- What cannot be opened ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (
            CanBusSettings("arm", "nonsense", "x"),
            r"\[bus\.arm\] nonsense on x: python-can has no such interface; known:",
        ),
        (CanBusSettings("arm", "udp_multicast", "10.0.0.1"), r"the channel must be a multicast address"),
        (CanBusSettings("arm", "slcan", "/dev/no-such"), r"is it plugged in\? `norton-bench devices` lists"),
        (CanBusSettings("arm", "socketcan", "can9"), r"this kernel has no CAN sockets|there is no CAN link can9"),
        (CanBusSettings("arm", "slcan", "/dev/null", 123), r"Invalid bitrate|cannot open it"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_one_sentence_with_the_mend(backend, settings, sentence):
    with pytest.raises(ConnectionFailedError, match=sentence) as caught:
        backend.open_can(settings)
    assert "\n" not in str(caught.value)


def test_a_port_that_cannot_be_opened(backend):
    with pytest.raises(
        ConnectionFailedError,
        match=r"port /dev/no-such: cannot open it at 460800 baud.*is it plugged in\? `norton-bench devices`",
    ):
        backend.open_serial("/dev/no-such", 460_800)
