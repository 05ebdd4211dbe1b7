"""The CANopen drivers meet devices that nobody here wrote: python-canopen's LocalNode, in wall time, over ports."""

import os
import select
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from math import tau

import canopen
import pytest
from canopen.profiles.p402 import State402

from norton_drivers.canopen.cia402 import Cia402Drive, open_amplifier
from norton_drivers.canopen.node import SHIPPED
from norton_drivers.canopen.sensor import CanopenSensor, open_torque_sensor
from norton_drivers.errors import DeviceTimeoutError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.link import Link
from norton_drivers.readings import DriveState, MotionReading, TorqueReading
from norton_drivers.wiring import CanBusSettings, DeviceSettings

pytestmark = pytest.mark.wall_time

NODE, SENSOR = 5, 7
SCALES = {"torque_per_unit": 1e-3, "counts_per_turn": 4096, "velocity_per_unit": 0.01}


class LocalDrive:
    """A LocalNode with a motor: SDO, NMT, heartbeat and PDO maps are python-canopen's, and so is the table of states.

    It sends no process data by itself: that, and obeying the controlword, is done here.
    """

    def __init__(self, network: canopen.Network) -> None:
        self.network = network
        self.node = network.create_node(NODE, str(SHIPPED / "cia402.eds"))
        self.state = "SWITCH ON DISABLED"
        self.target = 0
        self.mode = 0
        self.position = 0
        self.started = False
        network.subscribe(0x80, lambda *_: self.on_sync())
        network.subscribe(0x200 + NODE, lambda _id, data, _stamp: self.on_command(data))
        network.subscribe(0x000, lambda *_: setattr(self, "started", False))
        self.node.nmt.state = "INITIALISING"
        self.node.nmt.state = "PRE-OPERATIONAL"

    def begin(self) -> None:
        """Take the PDO maps as the master has written them."""
        if not self.started:
            self.node.rpdo.read()
            self.node.tpdo.read()
            self.started = True

    def on_command(self, data: bytes) -> None:
        if self.node.nmt.state != "OPERATIONAL":
            return
        self.begin()
        pdo = self.node.rpdo[1]
        pdo.data = bytearray(data)
        controlword, self.mode, self.target = (variable.raw for variable in pdo.map)
        for (before, after), word in State402.TRANSITIONTABLE.items():
            if before == self.state and word == controlword and "NOT READY" not in before + after:
                self.state = after
                return

    def on_sync(self) -> None:
        if self.node.nmt.state == "OPERATIONAL":
            self.begin()
            self.report(lambda pdo: pdo.trans_type is not None and pdo.trans_type <= 240)

    def on_timer(self) -> None:
        if self.node.nmt.state == "OPERATIONAL":
            self.begin()
            self.report(lambda pdo: pdo.trans_type == 255 and bool(pdo.event_timer))

    def report(self, is_due: Callable[[canopen.pdo.PdoMap], bool]) -> None:
        due = [pdo for pdo in self.node.tpdo.values() if pdo.enabled and is_due(pdo)]
        self.position += bool(due)
        _, bits = State402.SW_MASK[self.state]
        values = {0x6041: bits, 0x6061: self.mode, 0x6077: self.target, 0x6064: self.position, 0x606C: 100}
        for pdo in due:
            for variable in pdo.map:
                variable.raw = values[variable.index]
            pdo.transmit()


@contextmanager
def virtual(name: str) -> Iterator[tuple[CanBusSettings, canopen.Network]]:
    channel = f"{name} {os.getpid()}"
    yield from joined(CanBusSettings("can0", "virtual", channel), interface="virtual", channel=channel)


@contextmanager
def slcan(name: str) -> Iterator[tuple[CanBusSettings, canopen.Network]]:
    """Two pseudo-terminals, each what the other writes: an adapter at both ends."""
    ends = [os.openpty() for _ in range(2)]
    for end in ends:
        tty.setraw(end[1])
    (ours, our_slave), (theirs, their_slave) = ends
    done = threading.Event()
    relay = threading.Thread(target=carry, args=(ours, theirs, done))
    relay.start()
    try:
        settings = CanBusSettings("can0", "slcan", os.ttyname(our_slave))
        yield from joined(settings, interface="slcan", channel=os.ttyname(their_slave), sleep_after_open=0)
    finally:
        done.set()
        relay.join()
        for end in ends:
            for each in end:
                os.close(each)


def carry(first: int, second: int, done: threading.Event) -> None:
    other = {first: second, second: first}
    while not done.is_set():
        for ready in select.select([first, second], [], [], 0.02)[0]:
            os.write(other[ready], os.read(ready, 65536))


def joined(settings: CanBusSettings, **theirs: object) -> Iterator[tuple[CanBusSettings, canopen.Network]]:
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.02
    network.connect(bitrate=1_000_000, **theirs)
    try:
        yield settings, network
    finally:
        network.disconnect()


@contextmanager
def beating(action: Callable[[], None], period_s: float) -> Iterator[None]:
    """Meanwhile do something again and again, as a device's timer does."""
    done = threading.Event()

    def beat() -> None:
        while not done.wait(period_s):
            action()

    thread = threading.Thread(target=beat)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def wait_for(link: Link, arrived: Callable[[], bool], meanwhile: Callable[[], None] = lambda: None) -> None:
    deadline = time.monotonic() + 5
    while not arrived():
        assert time.monotonic() < deadline
        meanwhile()
        link.wait()


@contextmanager
def linked(settings: CanBusSettings) -> Iterator[Link]:
    link = Link(HardwareBackend(), (settings,))
    try:
        yield link
    finally:
        link.close()


def open_drive(link: Link, **options: object) -> Cia402Drive:
    return open_amplifier(
        DeviceSettings("actuator", "cia402", bus="can0", options={"node": NODE, **SCALES, **options}), link
    )


def open_sensor(link: Link, **options: object) -> CanopenSensor:
    given = {"node": SENSOR, "scale": 1e-3, "heartbeat": 0.02, **options}
    return open_torque_sensor(DeviceSettings("torque_sensor", "canopen", bus="can0", options=given), link)


@pytest.mark.parametrize(("transport", "feedback"), [(virtual, "sync"), (virtual, "timer"), (slcan, "timer")])
def test_a_strange_drive_is_enabled_commanded_and_lost(transport, feedback):
    with transport(f"drive {feedback}") as (settings, network), linked(settings) as link:
        peer = LocalDrive(network)
        with beating(peer.on_timer, 5e-3):
            drive = open_drive(link, feedback=feedback, period=5e-3, heartbeat=0.05)
            assert drive.identify().hardware == "generic -"
            drive.enable()
            assert peer.state == "OPERATION ENABLED"
            assert drive.status().state is DriveState.ENABLED
            command_and_hear(peer, drive, link)
            drive.stop()
            wait_for(link, lambda: drive.status().state is DriveState.IDLE)
            assert (peer.state, peer.target) == ("SWITCH ON DISABLED", 0)
            lose(peer.node, drive, link)
        assert drive.node.malformed == 0


def command_and_hear(peer: LocalDrive, drive: Cia402Drive, link: Link) -> None:
    def command() -> None:
        drive.command(0.123)
        readings.extend(drive.take_motion())

    readings: list[MotionReading] = []
    wait_for(link, lambda: peer.target == 123, meanwhile=command)
    wait_for(link, lambda: drive.actual_torque_nm == pytest.approx(0.123) and len(readings) > 20, meanwhile=command)
    assert {reading.velocity_rad_s for reading in readings[1:]} == {1.0}
    steps = [round((b.position_rad - a.position_rad) * 4096 / tau) for a, b in pairwise(readings)]
    assert set(steps) == {1}


def lose(peer: canopen.LocalNode, drive: Cia402Drive, link: Link) -> None:
    """The device's processor stops."""
    peer.nmt.stop_heartbeat()
    peer.nmt._state = 0
    before_ns = link.clock.now_ns()
    wait_for(link, lambda: link.clock.now_ns() - before_ns > 2 * drive.heartbeat_timeout_ns)
    assert link.clock.now_ns() - drive.status().heartbeat_ns > drive.heartbeat_timeout_ns
    drive.take_motion()
    link.wait(50_000_000)
    assert drive.take_motion() == []


def test_a_strange_drive_that_is_not_there():
    with (
        virtual("nobody") as (settings, _),
        linked(settings) as link,
        pytest.raises(DeviceTimeoutError, match="CANopen node 5 on can0: does not answer for parameter 1000h"),
    ):
        open_drive(link)


@pytest.mark.parametrize("transport", [virtual, slcan])
def test_a_strange_sensor(transport):
    with transport("sensor") as (settings, network), linked(settings) as link:
        node = local_sensor(network)
        sensor = open_sensor(link)
        assert node.nmt.state == "OPERATIONAL"
        network.send_message(0x180 + SENSOR, (-250).to_bytes(4, "little", signed=True))
        assert sensor.identify().address == "can0 node 7"
        taken: list[TorqueReading] = []
        wait_for(link, lambda: len(taken) >= 50, meanwhile=lambda: taken.extend(sensor.take_torque()))
        assert {reading.torque_nm for reading in taken} == {-0.25}
        node.nmt.stop_heartbeat()

        def silent() -> bool:
            link.wait(20_000_000)
            return sensor.take_torque() == []

        assert any(silent() for _ in range(100))  # its last heartbeat may come late on a busy machine


def test_a_strange_sensor_is_told_when_to_send():
    with virtual("timed sensor") as (settings, network), linked(settings) as link:
        node = local_sensor(network)
        open_sensor(link, send="timer", period=5e-3)
        assert (node.sdo[0x1800][2].raw, node.sdo[0x1800][5].raw) == (255, 5)
        assert node.sdo[0x1017].raw == 20


def local_sensor(network: canopen.Network) -> canopen.LocalNode:
    node = network.create_node(SENSOR, str(SHIPPED / "torque-sensor.eds"))
    node.nmt.state = "INITIALISING"
    node.nmt.state = "PRE-OPERATIONAL"
    return node
