"""Two servos on one line and their drivers: who is asked when, what is said of a wrong one, and what a line carries."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from norton_bench.guard.check import Commands
from norton_bench.loop.devices import Devices, open_devices
from norton_bench.rig.load import parse_rig
from norton_drivers.codecs import dynamixel as protocol
from norton_drivers.dynamixel.options import DynamixelOptions
from norton_drivers.dynamixel.servo import DynamixelServo, share_of
from norton_drivers.errors import DeviceError, WiringError
from norton_drivers.half_duplex.line import LineTiming, check_line
from norton_drivers.readings import DriveState
from norton_drivers.registry import load_backend
from norton_drivers.wiring import DeviceSettings
from norton_sim.backend import SimulatedBackend
from norton_sim.faults.schema import Dropout

RIGS = Path(__file__).parents[3] / "rigs"
PAIR = (RIGS / "sim-feetech.toml").read_text(encoding="utf-8")
DYNAMIXEL = """driver = "dynamixel"
port = "socket://localhost:7714"
type = "XM430-W210"
baud = 4_000_000
watchdog = "300 ms"
"""


def dynamixel_pair(**changes: str) -> str:
    """The rig of two Feetech servos with Dynamixels in their place."""
    text = PAIR.replace('rate = "400 Hz"', 'rate = "500 Hz"').replace("limit = 0.5", 'limit = "1 A"')
    text = text.replace('unit = "1"', 'unit = "A"').replace('"2.3 A"', '"0.98 A/A"')
    head, actuator, load = text.split('driver = "feetech"')
    for old, mode in (("actuator", 'mode = "current"'), ("load", 'mode = "torque"\ntorque_constant = "1.3 N*m/A"')):
        part = actuator if old == "actuator" else load
        kept = [
            line
            for line in part.split("\n")
            if not line.startswith(('port = "socket://localhost:7714', "type =", "baud =", "mode =", "stall_torque ="))
        ]
        part = "\n" + DYNAMIXEL + mode + "\n".join(kept)
        actuator, load = (part, load) if old == "actuator" else (actuator, part)
    text = head.rstrip("\n") + actuator + load.lstrip("\n")
    for old, new in changes.items():
        text = text.replace(old, new)
    return text


Opened = Callable[..., tuple[Devices, SimulatedBackend]]


@pytest.fixture
def opened() -> Iterator[Opened]:
    backends: list[SimulatedBackend] = []

    def open_it(text: str) -> tuple[Devices, SimulatedBackend]:
        rig = parse_rig(text, place="pair.toml")
        backend = load_backend("simulated")(rig.wiring, rig.simulated, seed=1, place=rig.place)
        assert isinstance(backend, SimulatedBackend)
        backends.append(backend)
        return open_devices(rig, backend), backend

    yield open_it
    for backend in backends:
        backend.close()


def run(devices: Devices, tick_ms: float, ticks: int) -> None:
    for _ in range(ticks):
        devices.send(Commands(0.05, 0.05, 0, 0.0))
        devices.link.wait(round(tick_ms * 1e6))


@pytest.mark.parametrize(("text", "tick_ms"), [(PAIR, 2.5), (dynamixel_pair(), 2.0)])
def test_both_are_commanded_and_read_in_every_tick_and_nothing_collides(
    opened: Opened, text: str, tick_ms: float
) -> None:
    devices, backend = opened(text)
    assert devices.load is not None
    devices.identify()
    devices.enable()
    (line,) = backend.world.lines.values()
    collisions = line.collisions
    devices.receive()
    run(devices, tick_ms, 100)
    motion, load_motion = devices.actuator.take_motion(), devices.load.take_motion()
    assert (len(motion), len(load_motion)) == (100, 100)
    periods_ms = [(later.arrival_ns - first.arrival_ns) * 1e-6 for first, later in pairwise(motion)]
    assert all(abs(period - tick_ms) < 0.25 for period in periods_ms), "they come with the jitter of the adapter"
    assert line.collisions == collisions
    assert devices.stop() == ()


@pytest.mark.parametrize("text", [PAIR, dynamixel_pair()])
def test_one_is_set_up_while_the_other_is_fed_faster_than_the_line_is_free(opened: Opened, text: str) -> None:
    """By an adapter that is faster than the rig file says: answers come before a goal could go out without them."""
    text = re.sub(r"rate = .*", 'rate = "150 Hz"', text, count=1)
    text = re.sub(r"latency = .*\n", "", text).replace("node = ", 'latency = "3 ms"\nnode = ')
    devices, _ = opened(text)
    devices.identify()
    devices.enable()
    assert [drive.status().state for drive in devices.drives] == [DriveState.ENABLED] * 2


@pytest.mark.parametrize(("text", "tick_ms"), [(PAIR, 2.5), (dynamixel_pair(), 2.0)])
def test_one_that_falls_silent_is_told_from_the_other(opened: Opened, text: str, tick_ms: float) -> None:
    devices, backend = opened(text)
    assert devices.load is not None
    devices.identify()
    devices.enable()
    backend.world.wires["actuator"].cut()
    cut_ns = devices.clock.now_ns()
    devices.load.take_motion()
    run(devices, tick_ms, 80)
    heard = devices.load.take_motion()
    assert heard[-1].arrival_ns > cut_ns + 100_000_000
    assert next(each.arrival_ns for each in heard if each.arrival_ns > cut_ns + 3e6) < cut_ns + 100e6
    heartbeat_ns = devices.actuator.status().heartbeat_ns
    assert heartbeat_ns is not None
    assert heartbeat_ns < cut_ns + 3e6
    assert len(devices.stop()) == 1, "only the silent one is complained of"
    assert devices.load.status().state is DriveState.IDLE


@pytest.mark.parametrize("silent_ms", [30, 60])
def test_one_that_was_silent_for_a_while_is_heard_again_soon(opened: Opened, silent_ms: int) -> None:
    """Before stale_after has passed: at the latest half as long after it has come back, and two lost answers."""
    devices, backend = opened(PAIR)
    devices.identify()
    devices.enable()
    backend.inject(Dropout(on="actuator", lasts_s=silent_ms * 1e-3))
    back_ns = devices.clock.now_ns() + silent_ms * 1_000_000
    run(devices, 2.5, 60)
    heard = [each.arrival_ns for each in devices.actuator.take_motion() if each.arrival_ns > back_ns]
    assert heard[0] < back_ns + silent_ms * 0.5e6 + 20e6


def test_a_watchdog_is_tested_in_silence_with_both_on_the_line(opened: Opened) -> None:
    devices, _ = opened(dynamixel_pair())
    devices.identify()
    found = devices.verify_watchdogs()
    assert all(each.safe_after_s is not None and 0.3 <= each.safe_after_s < 0.36 for each in found), found
    devices.enable()
    assert [drive.status().state for drive in devices.drives] == [DriveState.ENABLED] * 2


def test_a_servo_that_shut_itself_down_is_rebooted_on_enabling(opened: Opened) -> None:
    devices, backend = opened(dynamixel_pair())
    devices.identify()
    firmware = backend.world.devices["actuator"]
    firmware.registers.put(70, 4)  # type: ignore[attr-defined]
    for _ in range(20):
        devices.link.wait()
    assert devices.actuator.status().errors == ("overheating",)
    devices.enable()
    assert devices.actuator.status().state is DriveState.ENABLED


@pytest.mark.parametrize(
    ("device", "sentence"),
    [
        ('{ type = "XL330-M288" }', "is XL330-M288, not the XM430-W210 of the rig file, .* correct type"),
        ('{ return_delay = "500 us" }', "return delay time is 500 us, not 0 us; set register 9 in it"),
        ("{ node = 7 }", r"does not answer; check its supply, its wiring, its id \(node = 1\) and its baud rate"),
        ("{ baud = 57600 }", "does not answer"),
    ],
)
def test_a_servo_that_is_set_up_otherwise_is_told(opened: Opened, device: str, sentence: str) -> None:
    text = dynamixel_pair().replace("[simulated.actuator] ", f"[simulated.actuator]\ndevice = {device} ")
    devices, _ = opened(text)
    with pytest.raises(DeviceError, match=r"^\[actuator\] Dynamixel 1 on socket://localhost:7714: .*" + sentence):
        devices.actuator.identify(0.3)
    assert devices.load is not None
    devices.load.identify()


def test_a_profile_or_a_gain_that_is_left_over_is_cleared_and_read_back(opened: Opened) -> None:
    text = (RIGS / "sim-dynamixel.toml").read_text(encoding="utf-8")
    text = text.replace('mode = "current"', POSITION).replace(
        'unit = "A", limit = "1.2 A"', 'unit = "rad", limit = "1 rad"'
    )
    text = text.replace('position = "unlimited" ', 'position = "2 rad" ').replace('"0.98 A/A"', '"11 A/rad"')
    devices, backend = opened(text)
    registers = backend.world.devices["actuator"].registers  # type: ignore[attr-defined]
    for address, size, value in ((108, 4, 50), (112, 4, 100), (82, 2, 30), (80, 2, 7), (88, 2, 9)):
        registers.put(address, value, size)
    devices.actuator.identify()
    devices.actuator.enable()
    assert [
        registers.get(address, size) for address, size in ((108, 4), (112, 4), (80, 2), (82, 2), (84, 2), (88, 4))
    ] == [
        0,
        0,
        0,
        0,
        800,
        0,
    ]
    assert registers.get(102, 2) == 371, "1 A in units of 2.69 mA"
    assert devices.actuator.command(0.25) == pytest.approx(0.25, abs=0.8e-3)
    servo = devices.actuator
    assert isinstance(servo, DynamixelServo)
    assert servo.command_unit == "rad"


POSITION = """mode = "current-based position"
torque_constant = "1.3 N*m/A"
position_gain = 800
greatest_current = "1 A"
"""


def test_what_a_line_carries_is_worked_out_by_hand() -> None:
    """Two in current mode at 1 Mbit/s: goals 20 bytes, question 16, answers 2 x 27, and the adapter's millisecond."""
    options = [
        DynamixelOptions.model_validate({"node": node, "type": "XM430-W210", "return_delay": 50e-6}) for node in (1, 2)
    ]
    shares = [share_of(each) for each in options]
    timing = LineTiming(1_000_000, 1e-3)
    assert timing.cycle_s(protocol.Dialect(), shares) == pytest.approx((20 + 16 + 54) * 10e-6 + 2 * 50e-6 + 1e-3)
    settings = [DeviceSettings("actuator", "dynamixel", port="/dev/ttyUSB0")]
    check_line(protocol.Dialect(), timing, shares, settings, 2_000_000)
    with pytest.raises(WiringError, match=r'2 ms in all|500 Hz at most, not 1000 Hz; write rate = "500 Hz"'):
        check_line(protocol.Dialect(), timing, shares, settings, 1_000_000)
    by_different_registers = [shares[0], replace(shares[1], reading=replace(shares[1].reading, address=208))]
    assert timing.cycle_s(protocol.Dialect(), by_different_registers) == pytest.approx(
        (20 + 2 * 15 + 54) * 10e-6 + 2 * 50e-6 + 2e-3
    )


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            ('rate = "400 Hz"', 'rate = "1 kHz"'),
            "at 1000000 baud one cycle .* 1 ms in the adapter: .* not 1000 Hz;",
        ),
        (("node = 2", "node = 1"), r"\[load\]: node 1 on the port .* belongs to \[actuator\] already"),
        (("localhost:7715", "localhost:7714"), r"\[torque_sensor\] port: .* is a line that servos share"),
        (('type = "STS3215"', 'type = "STS9"'), r"\[actuator\] type: .*not a model that is known here"),
    ],
)
def test_what_cannot_be_is_refused_when_the_rig_file_is_read(change: tuple[str, str], sentence: str) -> None:
    with pytest.raises(Exception, match=sentence):
        parse_rig(PAIR.replace(*change), place="pair.toml")
