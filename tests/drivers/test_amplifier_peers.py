"""VESC, MIT mode and moteus in wall time, over real sockets, against programs that share no code with this project.

The peers of MIT mode and of moteus pack and unpack their frames with packages that drive such motors. No package speaks
as a VESC does, so that peer's bytes are made by hand from the firmware's source; its commands are checked against a
package elsewhere.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from norton_drivers.devices import Amplifier
from norton_drivers.errors import DeviceTimeoutError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.link import Link
from norton_drivers.readings import DriveState
from norton_drivers.registry import open_amplifier
from norton_drivers.wiring import CanBusSettings, DeviceSettings

HERE = Path(__file__).parent
NODE = 11
pytestmark = pytest.mark.wall_time

RANGES = {"position_range": 12.5, "velocity_range": 50.0, "torque_range": 18.0, "beyond_range": "wraps"}
VESC = ("vesc", {"node": NODE, "pole_pairs": 7, "watchdog": 0.5}, "peer_vesc.py", ["0.5"])
MIT = {"node": NODE, "master": 3, **RANGES}
CHEETAH = ("mit", MIT, "peer_mit.py", ["3", "mini-cheetah"])
CUBEMARS = ("mit", MIT, "peer_mit.py", ["3", "TMotorCANControl"])
MOTEUS = ("moteus", {"node": NODE, "watchdog": 0.5}, "peer_moteus.py", [])
PEERS = [VESC, CHEETAH, CUBEMARS, MOTEUS]
NAMES = ["vesc", "cheetah", "cubemars", "moteus"]
WHO = {"vesc": ("5.03", "410"), "mit": ("", ""), "moteus": ("1.3.4", "model 0x0604")}


@contextmanager
def peer(script: str, port: int, arguments: list[str]) -> Iterator["subprocess.Popen[bytes]"]:
    process = subprocess.Popen([sys.executable, str(HERE / script), group(), str(port), str(NODE), *arguments])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def group() -> str:
    return f"239.76.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"


def eventually(link: Link, happened: Callable[[], bool], within_s: float = 20.0) -> bool:
    deadline = time.monotonic() + within_s
    while not happened() and time.monotonic() < deadline:
        link.wait()
    return happened()


def drive(amplifier: Amplifier, link: Link, command: float, duration_s: float) -> list[float]:
    """Velocities while the same is commanded at 500 Hz."""
    velocities, end = [], time.monotonic() + duration_s
    while time.monotonic() < end:
        amplifier.command(command)
        link.wait(2_000_000)
        velocities += [reading.velocity_rad_s for reading in amplifier.take_motion()]
    return velocities


@pytest.mark.parametrize(
    ("driver", "options", "script", "arguments"), PEERS, ids=["vesc", "cheetah", "cubemars", "moteus"]
)
def test_a_stranger_is_identified_enabled_driven_stopped_and_lost(driver, options, script, arguments):
    port = 32_000 + os.getpid() % 2_000 + 2_000 * PEERS.index((driver, options, script, arguments))
    bus = CanBusSettings("can0", "udp_multicast", group(), options={"port": port}, fd=driver == "moteus")
    link = Link(HardwareBackend(), (bus,))
    amplifier = open_amplifier(DeviceSettings("actuator", driver, bus="can0", options=options), link)
    try:
        with pytest.raises(DeviceTimeoutError, match="does not answer"):
            amplifier.identify(timeout_s=0.1)
        with peer(script, port, arguments) as process:
            assert eventually(link, lambda: amplifier.status().state is DriveState.IDLE)
            identity = amplifier.identify()
            assert identity.driver == driver
            assert (identity.firmware, identity.hardware) == WHO[driver]
            amplifier.enable()
            assert amplifier.status().state is DriveState.ENABLED
            velocities = drive(amplifier, link, 1.0, 0.5)
            assert len(velocities) > 50
            assert velocities[-1] > 3.0
            assert drive(amplifier, link, -1.0, 1.0)[-1] < -3.0
            amplifier.stop()
            assert eventually(link, lambda: amplifier.status().state is DriveState.IDLE, 3.0)
            amplifier.enable()
            process.kill()
            process.wait()
            lost_ns = link.clock.now_ns()
            drive(amplifier, link, 0.0, 0.4)
            heartbeat_ns = amplifier.status().heartbeat_ns
            assert heartbeat_ns is not None
            assert heartbeat_ns <= lost_ns + 50_000_000
            assert link.clock.now_ns() - heartbeat_ns > amplifier.heartbeat_timeout_ns
    finally:
        link.close()
