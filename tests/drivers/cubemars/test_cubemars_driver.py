"""The driver of CubeMars' actuators in servo mode against a scripted one, whose bytes are packed by hand."""

import math
import struct

import can
import pytest

from norton_drivers.cubemars import CubeMars, CubeMarsOptions, open_amplifier
from norton_drivers.errors import DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.readings import DriveState

NODE = 104
GIVEN = {"node": NODE, "pole_pairs": 21, "gear_ratio": 9.0, "minimum_current": 0.05}
RAD_S_PER_ERPM = math.tau / 60 / 21 / 9


class ScriptedActuator:
    """Sends its state every 2 ms; ``current_a`` follows the commands until it is told otherwise."""

    def __init__(self, world) -> None:
        self.bus = world.bus
        self.position_deg = self.erpm = self.current_a = 0.0
        self.temperature_c, self.error = 31, 0
        self.deaf = False
        self.period_ns, self.next_ns = 2_000_000, 0
        self.commands: list[float] = []
        world.bus.peer = self.receive
        world.clock.alarms.append(self.tick)

    def receive(self, frame: can.Message) -> None:
        assert frame.is_extended_id
        assert frame.arbitration_id == 1 << 8 | NODE
        (milliamperes,) = struct.unpack(">i", frame.data)
        self.commands.append(milliamperes / 1000)
        self.current_a = self.commands[-1]

    def tick(self, now_ns: int) -> None:
        if now_ns >= self.next_ns and not self.deaf:
            self.next_ns = now_ns + self.period_ns
            numbers = int(self.position_deg * 10), int(self.erpm / 10), int(self.current_a * 100)
            data = struct.pack(">hhhbB", *numbers, self.temperature_c, self.error)
            self.bus.arrive(0x2900 | NODE, data, extended=True)


@pytest.fixture
def actuator(world):
    return ScriptedActuator(world)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_drive(actuator, link, device):
    def opened(direction: int = 1, **options: object) -> CubeMars:
        return open_amplifier(device("actuator", "cubemars", direction=direction, **{**GIVEN, **options}), link)

    return opened


def wait(link, ms: int) -> None:
    for _ in range(ms):
        link.wait()


def test_identity(actuator, open_drive):
    identity = open_drive().identify()
    assert (identity.driver, identity.address) == ("cubemars", "can0 node 104")
    assert actuator.commands == []


def test_nobody_there(actuator, open_drive):
    actuator.deaf = True
    with pytest.raises(DeviceTimeoutError, match=r"CubeMars actuator 104 on can0: sends nothing.*servo mode.*upload"):
        open_drive().identify(timeout_s=0.1)


def test_two_with_one_id(actuator, open_drive):
    actuator.period_ns = 1_000_000
    with pytest.raises(DeviceError, match="times a second, oftener than one can; do two have this CAN id"):
        open_drive().identify()


@pytest.mark.parametrize("direction", [1, -1])
def test_readings_in_si_units(actuator, open_drive, link, direction):
    drive = open_drive(direction)
    actuator.position_deg, actuator.erpm, actuator.current_a = 123.45, 4321.0, -1.234
    wait(link, 5)
    motion, current = drive.take_motion()[-1], drive.take_current()[-1]
    # Each is cut off, and read as the middle of what it may have been.
    assert motion.position_rad == pytest.approx(direction * math.radians(123.45))
    assert motion.velocity_rad_s == pytest.approx(direction * 4325 * RAD_S_PER_ERPM)
    assert current.current_a == pytest.approx(direction * -1.235)
    assert drive.status().transistor_temperature_c == 31


def test_an_angle_is_followed_where_it_wraps(actuator, open_drive, link):
    drive = open_drive(beyond_range="wraps")
    actuator.position_deg = 3276.0
    wait(link, 4)
    actuator.position_deg = -3276.0
    wait(link, 4)
    turned = drive.take_motion()
    assert turned[-1].position_rad - turned[0].position_rad == pytest.approx(math.radians(1.6), abs=1e-6)


def test_at_the_end_of_its_angle_there_is_a_fault_and_no_reading(actuator, open_drive, link):
    drive = open_drive()
    drive.enable()
    drive.take_motion()
    actuator.position_deg = 3200.0
    wait(link, 5)
    assert drive.take_motion() == []
    assert drive.status().state is DriveState.FAULT
    assert "±3200 degrees" in drive.status().errors[0]


def test_currents_and_torques(actuator, open_drive):
    drive = open_drive()
    drive.enable()
    assert actuator.commands == [0.0]
    assert drive.command(1.2345) == 1.234
    assert drive.command(0.04) == 0.0  # below the least current
    torque = open_drive(mode="torque", torque_constant=0.8)
    assert (torque.command_unit, torque.command(1.6)) == ("N*m", 1.6)
    assert actuator.commands[-1] == 2.0
    with pytest.raises(DeviceError, match="cannot command nan N"):
        torque.command(math.nan)


def test_an_error_refuses_and_stays_until_it_is_enabled_again(actuator, open_drive, link):
    drive = open_drive()
    actuator.error = 4
    with pytest.raises(DeviceError, match="refuses to drive its motor: supply voltage too low"):
        drive.enable()
    actuator.error = 0
    drive.enable()
    assert drive.status().state is DriveState.ENABLED
    actuator.error = 5
    wait(link, 4)
    actuator.error = 0
    wait(link, 4)
    assert (drive.status().state, drive.status().errors) == (DriveState.FAULT, ("encoder fault",))


def test_a_stop_is_seen_in_the_current(actuator, open_drive, link):
    drive = open_drive()
    drive.enable()
    drive.command(1.0)
    wait(link, 5)
    drive.stop()
    assert drive.status().state is DriveState.ENABLED
    wait(link, 10)
    assert drive.status().state is DriveState.IDLE
    assert actuator.commands[-2:] == [0.0, 0.0]


def test_the_watchdog_is_seen_by_a_probe(actuator, open_drive, link):
    drive = open_drive(watchdog=0.2, watchdog_probe=0.1)
    assert drive.watchdog_s == pytest.approx(0.21)
    drive.enable()
    drive.provoke_watchdog()
    wait(link, 5)
    assert drive.made_itself_safe() is False
    actuator.current_a = 0.0
    wait(link, 5)
    assert drive.made_itself_safe() is True


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mode": "torque"}, r'torque_constant = None: mode = "torque" needs it'),
        ({"watchdog_probe": 0.01}, r"watchdog_probe = 0.01: cannot be told from nothing in steps of 0.01 A"),
        ({"node": 254}, r"node = 254"),
    ],
)
def test_options_that_cannot_be(open_drive, options, words):
    with pytest.raises(WiringError, match=words):
        open_drive(**options)


def test_how_far_it_sees():
    assert CubeMarsOptions.model_validate(GIVEN).greatest_position_rad == pytest.approx(math.radians(3200))
    assert CubeMarsOptions.model_validate({**GIVEN, "beyond_range": "wraps"}).greatest_position_rad == math.inf
