"""Ports and links: everything that arrives is handed on once, copied to the tap, and a lost port is told."""

import can
import pytest

from norton_drivers.codecs.can_errors import CanErrorFrame, ControllerError, ErrorClass
from norton_drivers.errors import ConnectionFailedError, WiringError
from norton_drivers.link import wait_until
from norton_drivers.ports import CanPort
from norton_drivers.readings import CAPACITY, ERROR_FRAME, Inbox, RawFrame
from norton_drivers.wiring import DeviceSettings


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def can_port(link, device):
    return link.can_port(device("actuator", "odrive"))


@pytest.fixture
def serial_port(link, device):
    return link.serial_port(device("torque_sensor", "bota"), 460_800)


def test_ports_are_shared(link, device, can_port, serial_port):
    assert link.can_port(device("load", "odrive")) is can_port
    assert link.serial_port(device("torque_sensor", "bota"), 460_800) is serial_port


def test_every_listener_gets_every_frame(world, link, can_port):
    first, second = [], []
    can_port.subscribe(lambda message, arrival_ns: first.append((message.arbitration_id, arrival_ns)))
    can_port.subscribe(lambda message, arrival_ns: second.append(message.arbitration_id))
    world.bus.arrive(1, b"\1")
    world.bus.arrive(2, b"\2")
    assert can_port.poll() == 2
    assert first == [(1, world.clock.ns), (2, world.clock.ns)]
    assert second == [1, 2]
    assert can_port.poll() == 0


def test_a_listener_may_name_the_identifiers_that_it_wants(world, can_port):
    heard = []
    can_port.subscribe(lambda message, _arrival_ns: heard.append(("all", message.arbitration_id)))
    can_port.subscribe(lambda message, _arrival_ns: heard.append(("some", message.arbitration_id)), {2, 3})
    can_port.subscribe(lambda message, _arrival_ns: heard.append(("last", message.arbitration_id)))
    for identifier in (1, 2, 4):
        world.bus.arrive(identifier, b"")
    assert can_port.poll() == 3
    assert heard == [("all", 1), ("last", 1), ("all", 2), ("some", 2), ("last", 2), ("all", 4), ("last", 4)]


def test_the_tap_sees_both_ways(world, link, can_port, serial_port):
    seen: list[RawFrame] = []
    link.set_tap(seen.append)
    now_ns = world.clock.ns
    can_port.send(0x21, b"\1\2")
    can_port.send(0x22, b"", remote=True)
    world.bus.arrive(0x123456, b"\3", extended=True)
    world.line.arriving = b"abc"
    link.poll()
    serial_port.send(b"out")
    assert seen == [
        RawFrame(now_ns, "can0", True, b"\1\2", 0x21),
        RawFrame(now_ns, "can0", True, b"", 0x22, remote=True),
        RawFrame(now_ns, "can0", False, b"\3", 0x123456, extended=True),
        RawFrame(now_ns, "fake", False, b"abc"),
        RawFrame(now_ns, "fake", True, b"out"),
    ]


def test_can_fd_frames_are_sent_and_received_where_the_bus_carries_them(world, link):
    heard, seen = [], []
    port = CanPort("can0", world.bus, world.clock, lambda _: 5, fd=True, switches_bitrate=True)
    port.subscribe(lambda message, _: heard.append(message.is_fd))
    port.tap = seen.append
    port.send(0x8001, bytes(32), extended=True, fd=True)
    port.send(0x21, b"\1")
    world.bus.arrive(0x100, bytes(12), fd=True)
    world.bus.arrive(0x101, bytes(8))
    assert port.poll() == 2
    assert [(each.is_fd, each.bitrate_switch, each.dlc) for each in world.bus.sent] == [
        (True, True, 32),
        (False, False, 1),
    ]
    assert heard == [True, False]
    assert [(frame.sent, frame.fd, frame.switched) for frame in seen] == [
        (True, True, True),
        (True, False, False),
        (False, True, False),
        (False, False, False),
    ]


def test_without_a_second_bit_rate_nothing_is_switched(world):
    port = CanPort("can0", world.bus, world.clock, lambda _: 5, fd=True)
    port.send(0x8001, bytes(32), extended=True, fd=True)
    assert (world.bus.sent[0].is_fd, world.bus.sent[0].bitrate_switch) == (True, False)


def test_can_fd_frames_on_a_bus_that_is_not_said_to_carry_them_are_counted(world, can_port):
    heard = []
    can_port.subscribe(lambda message, _: heard.append(message))
    world.bus.arrive(0x100, bytes(12), fd=True)
    can_port.poll()
    assert heard == []
    ((words, count),) = can_port.troubles().items()
    assert (count, "add fd = true" in words) == (1, True)


def test_error_frames_are_counted_and_not_handed_on(world, can_port):
    got = []
    can_port.subscribe(lambda message, arrival_ns: got.append(message))
    world.bus.arriving.append(can.Message(is_error_frame=True))
    can_port.poll()
    assert (can_port.error_frames, got) == (1, [])


def error_frame(classes: ErrorClass, **details: int) -> can.Message:
    arbitration_id, data = CanErrorFrame(classes, **details).encode()
    return can.Message(arbitration_id=arbitration_id, data=data, is_error_frame=True, is_extended_id=False)


def test_the_tap_tells_error_frames_by_a_flag(world, link, can_port):
    seen = []
    link.set_tap(seen.append)
    world.bus.arriving.append(error_frame(ErrorClass.NO_ACKNOWLEDGEMENT))
    link.poll()
    (frame,) = seen
    assert frame.arbitration_id == ERROR_FRAME | ErrorClass.NO_ACKNOWLEDGEMENT
    assert (frame.channel, frame.sent, len(frame.data)) == (can_port.name, False, 8)


def test_error_frames_are_counted_by_what_they_say(world, link, can_port):
    for _ in range(3):
        world.bus.arriving.append(error_frame(ErrorClass.NO_ACKNOWLEDGEMENT))
    world.bus.arriving.append(error_frame(ErrorClass.CONTROLLER, controller=ControllerError.RX_OVERFLOW))
    link.poll()
    assert link.troubles() == {("bus can0", "no acknowledgement"): 3, ("bus can0", "receive overrun"): 1}


def test_error_frames_of_another_layout_are_only_counted(world):
    port = CanPort("can0", world.bus, world.clock, lambda _: 0, linux_error_frames=False)
    world.bus.arriving.append(error_frame(ErrorClass.BUS_OFF))
    port.poll()
    assert port.troubles() == {"error frame": 1}


def test_bus_off_is_a_lost_bus_until_the_controller_restarts(world, can_port):
    world.bus.arriving.append(error_frame(ErrorClass.BUS_OFF))
    for _ in range(2):
        with pytest.raises(ConnectionFailedError, match=r"bus can0: the controller has left the bus.*check bitrate"):
            can_port.poll()
    world.bus.arriving.append(error_frame(ErrorClass.RESTARTED))
    assert can_port.poll() == 1


def test_what_arrived_with_the_bus_off_is_still_handed_on(world, can_port):
    got = []
    can_port.subscribe(lambda message, _arrival_ns: got.append(message.arbitration_id))
    world.bus.arriving.append(error_frame(ErrorClass.BUS_OFF))
    world.bus.arrive(7)
    with pytest.raises(ConnectionFailedError):
        can_port.poll()
    assert got == [7]


def test_a_state_of_error_is_a_lost_bus(world, link, can_port, monkeypatch):
    link.ask_adapters()
    monkeypatch.setattr(type(world.bus), "state", can.BusState.ERROR)
    with pytest.raises(ConnectionFailedError, match=r"bus-off: its state is ERROR"):
        link.ask_adapters()


@pytest.mark.parametrize("marks", [True, False])
def test_own_frames_are_left_out_where_the_interface_marks_them(world, marks):
    port = CanPort("can0", world.bus, world.clock, lambda _: 0, marks_own_frames=marks)
    got = []
    port.subscribe(lambda message, _arrival_ns: got.append(message.arbitration_id))
    world.bus.arriving.append(can.Message(arbitration_id=1, is_rx=False))
    world.bus.arriving.append(can.Message(arbitration_id=2))
    port.poll()
    assert (got, port.own_frames) == (([2], 1) if marks else ([1, 2], 0))


@pytest.mark.parametrize("error", [can.CanOperationError("gone"), OSError("gone"), ValueError("gone")])
def test_a_lost_bus_is_told(world, can_port, error):
    def fail(timeout):
        raise error

    world.bus._recv_internal = fail
    with pytest.raises(ConnectionFailedError, match=r"bus can0: lost \(gone\)"):
        can_port.poll()


def test_a_lost_line_is_told(world, serial_port):
    def fail(*_):
        raise OSError("gone")

    world.line.arriving = b"x"
    world.line.read = world.line.write = fail
    with pytest.raises(ConnectionFailedError, match=r"port fake: lost \(gone\); check the cable"):
        serial_port.poll()
    with pytest.raises(ConnectionFailedError, match=r"port fake: cannot write"):
        serial_port.send(b"x")


def test_wiring_that_names_no_bus_or_port(link):
    with pytest.raises(WiringError, match=r"\[load\] bus = 'can7' is not a bus of this rig \(known: can0\)"):
        link.can_port(DeviceSettings("load", "odrive", bus="can7"))
    with pytest.raises(WiringError, match=r"\[torque_sensor\] driver = 'bota' needs a serial port"):
        link.serial_port(DeviceSettings("torque_sensor", "bota"), 460_800)


def test_waiting_moves_time_and_keeps_others_alive(world, link, can_port):
    kept, meant = [], []
    link.keep_alive = lambda: kept.append(world.clock.ns)
    start_ns = world.clock.ns
    assert not wait_until(lambda: False, link, 0.01, meanwhile=lambda: meant.append(1))
    assert world.clock.ns - start_ns == 10_000_000
    assert len(kept) == len(meant) == 10
    assert wait_until(lambda: True, link, 0.0)


def test_an_inbox_that_nobody_empties_loses_the_oldest_and_shows_it():
    inbox: Inbox[int] = Inbox()
    for number in range(CAPACITY + 5):
        inbox.put(number)
    assert inbox.take() == list(range(5, CAPACITY + 5))
    assert (inbox.count, inbox.take()) == (CAPACITY + 5, [])


def test_what_speaks_only_when_spoken_to_is_asked_before_every_poll(world, link, can_port):
    heard = []
    world.bus.peer = lambda message: world.bus.arrive(message.arbitration_id + 1)
    can_port.subscribe(lambda message, _arrival_ns: heard.append(message.arbitration_id))
    link.questions.append(lambda: can_port.send(0x10, b""))
    link.poll()
    assert heard == [0x11]


def test_what_is_shared_is_made_once(link):
    first = link.shared("master of can0", list)
    assert link.shared("master of can0", list) is first
    assert link.shared("master of can1", list) is not first


def test_what_is_on_one_port_is_heard_though_another_is_lost(world, link, can_port, serial_port):
    heard = []
    serial_port.subscribe(lambda data, _arrival_ns: heard.append(data))

    def lost(timeout=None):
        raise OSError("No such device")

    def ask() -> None:
        raise ConnectionFailedError("nobody to ask")

    can_port.bus.recv = lost
    link.questions.append(ask)
    world.line.arriving = b"alive"
    with pytest.raises(ConnectionFailedError, match="bus can0: lost"):
        link.poll()
    assert heard == [b"alive"]
