"""The ODrive driver, set to firmware 0.5, meets the mock of the package odrive-can speaking by the DBC file 0.5.6."""

import os
import time

import pytest

from norton_drivers.errors import DeviceError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.link import Link
from norton_drivers.odrive import ODrive, open_amplifier
from norton_drivers.readings import DriveState
from norton_drivers.wiring import CanBusSettings, DeviceSettings
from tests.drivers.odrive.odrive_mock import GROUP, NODE, mock_drive

UDP_PORT = 32_000 + os.getpid() % 2_000
pytestmark = pytest.mark.wall_time


@pytest.fixture(scope="module")
def mock():
    with mock_drive(UDP_PORT, "0.5.6") as process:
        yield process


@pytest.fixture
def open_drive(mock):
    """The mock knows no torque mode and no watchdog, and answers what its file has with zeros."""
    link = Link(HardwareBackend(), (CanBusSettings("can0", "udp_multicast", GROUP, options={"port": UDP_PORT}),))

    def opened(**options: object) -> tuple[ODrive, Link]:
        options = {"node": NODE, "heartbeat": 0.2, "watchdog": 0.0, **options}
        drive = open_amplifier(DeviceSettings("actuator", "odrive", bus="can0", options=options), link)
        deadline = time.monotonic() + 20
        while drive.status().state is DriveState.UNKNOWN and time.monotonic() < deadline:
            link.wait()
        return drive, link

    yield opened
    link.close()


def await_state(drive: ODrive, link: Link, state: DriveState, within_s: float) -> bool:
    deadline = time.monotonic() + within_s
    while drive.status().state is not state and time.monotonic() < deadline:
        link.wait()
    return drive.status().state is state


def test_a_stranger_is_known_enabled_and_stopped(open_drive):
    drive, link = open_drive(firmware="0.5")
    assert drive.identify().firmware == "0.5"
    drive.enable(timeout_s=5)
    assert drive.status().errors == ()
    drive.stop()
    assert await_state(drive, link, DriveState.IDLE, within_s=5)
    assert drive.malformed == 0


def test_a_stranger_is_asked_for_currents(open_drive):
    drive, link = open_drive(firmware="0.5", ask=True)
    drive.identify()
    deadline = time.monotonic() + 1.0
    currents = []
    while time.monotonic() < deadline:
        link.wait()
        currents += drive.take_current()
    # Zeros are what it answers; that it is asked, and asked again, is what shows.
    assert len(currents) > 20


def test_it_is_told_apart_from_firmware_06(open_drive):
    drive, _ = open_drive(firmware="0.6")
    with pytest.raises(DeviceError, match=r'answers as firmware 0\.5 does; write firmware = "0\.5"'):
        drive.identify(timeout_s=0.5)


def test_losing_it_shows(open_drive, mock):
    drive, link = open_drive(firmware="0.5")
    mock.kill()
    mock.wait()
    link.wait(300_000_000)
    heard_ns = drive.status().heartbeat_ns
    link.wait(drive.heartbeat_timeout_ns)
    assert drive.status().heartbeat_ns == heard_ns
    assert link.clock.now_ns() - heard_ns > drive.heartbeat_timeout_ns
