"""The ODrive driver meets a drive that nobody here wrote: the mock of the package odrive-can, over real sockets."""

import os
import time
from itertools import pairwise

import can
import pytest

from norton_drivers.errors import DeviceError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.link import Link
from norton_drivers.odrive import open_amplifier
from norton_drivers.readings import DriveState
from norton_drivers.wiring import CanBusSettings, DeviceSettings
from tests.drivers.odrive.odrive_mock import GROUP, NODE, mock_drive

UDP_PORT = 30_000 + os.getpid() % 2_000
pytestmark = pytest.mark.wall_time


@pytest.fixture(scope="module")
def drive():
    """The mock knows no torque mode, no watchdog, and answers every question with zeros."""
    backend = HardwareBackend()
    link = Link(backend, (CanBusSettings("can0", "udp_multicast", GROUP, options={"port": UDP_PORT}),))
    settings = DeviceSettings(
        "actuator", "odrive", bus="can0", options={"node": NODE, "watchdog": 0.0, "heartbeat": 0.2}
    )
    with mock_drive(UDP_PORT, "0.6.10") as process:
        amplifier = open_amplifier(settings, link)
        deadline = time.monotonic() + 20
        while amplifier.status().state is DriveState.UNKNOWN and time.monotonic() < deadline:
            link.wait()
        yield amplifier, link, process
    link.close()


def test_a_stranger_is_heard(drive):
    amplifier, link, _ = drive
    link.wait(500_000_000)
    status = amplifier.status()
    assert (status.state, status.errors) == (DriveState.IDLE, ())
    assert 0 <= link.clock.now_ns() - status.heartbeat_ns < amplifier.heartbeat_timeout_ns
    readings = amplifier.take_motion()
    assert len(readings) >= 3
    intervals_ns = [b.arrival_ns - a.arrival_ns for a, b in pairwise(readings)]
    assert 0.09e9 < sorted(intervals_ns)[len(intervals_ns) // 2] < 0.15e9  # it sends every 0.1 s
    assert amplifier.malformed == 0


def test_a_stranger_is_enabled_and_stopped(drive):
    amplifier, link, _ = drive
    amplifier.enable(timeout_s=5)
    assert amplifier.status().state is DriveState.ENABLED
    amplifier.stop()
    deadline = time.monotonic() + 5
    while amplifier.status().state is not DriveState.IDLE and time.monotonic() < deadline:
        link.wait()
    assert amplifier.status().state is DriveState.IDLE


def test_a_strangers_motion(drive):
    amplifier, link, _ = drive
    with can.Bus(GROUP, "udp_multicast", port=UDP_PORT) as bus:
        for command, data in ((0x0B, "0300000001000000"), (0x0C, "0000403f00000000")):  # position control, 0.75 turns
            frame = can.Message(arbitration_id=NODE << 5 | command, data=bytes.fromhex(data), is_extended_id=False)
            bus.send(frame)
    deadline = time.monotonic() + 5
    position_rad = 0.0
    while abs(position_rad - 0.75 * 6.283185307) > 1e-6 and time.monotonic() < deadline:
        link.wait()
        for reading in amplifier.take_motion():
            position_rad = reading.position_rad
    assert position_rad == pytest.approx(0.75 * 6.283185307, abs=1e-6)


def test_a_stranger_with_another_firmware_is_refused(drive):
    amplifier, _, _ = drive
    with pytest.raises(DeviceError, match=r'says it runs firmware 0\.0\.0; the rig file has firmware = "0\.6"'):
        amplifier.identify()


def test_a_stranger_that_is_lost_shows(drive):
    amplifier, link, process = drive
    process.kill()
    process.wait()
    link.wait(300_000_000)
    heard_ns = amplifier.status().heartbeat_ns
    amplifier.take_motion()
    link.wait(amplifier.heartbeat_timeout_ns)
    assert link.clock.now_ns() - heard_ns > amplifier.heartbeat_timeout_ns
    assert amplifier.status().heartbeat_ns == heard_ns
    assert amplifier.take_motion() == []
