"""The moteus driver against a scripted controller, whose frames the maker's own package takes apart."""

import math
from struct import Struct

import can
import moteus
import pytest
from moteus.protocol import parse_registers

from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.link import Link
from norton_drivers.moteus import MoteusController, open_amplifier
from norton_drivers.readings import DriveState
from norton_drivers.wiring import CanBusSettings

NODE = 5
MS = 1_000_000
REGISTER, MODE = moteus.Register, moteus.Mode
BUS = CanBusSettings("can0", "scripted", "scripted", fd=True, data_bitrate_bit_s=5_000_000)


class ScriptedController:
    """Answers every frame that asks with the state before it. A starting motor takes two commands."""

    def __init__(self, world) -> None:
        self.bus, self.clock = world.bus, world.clock
        self.mode, self.fault = MODE.STOPPED, 0
        self.motion = (0.0, 0.0, 0.0, 0.0)  # turns, turns/s, N m, A
        self.register_map, self.refused = 5, b""
        self.deaf = False
        self.stubborn: int | None = None  # the fault that a start ends in
        self.watchdog_ns = math.inf
        self.commanded_ns = 0
        self.frames: list[can.Message] = []
        world.bus.peer = self.receive

    @property
    def commands(self) -> list[dict[int, float]]:
        return [parse_registers(each.data).command for each in self.frames if parse_registers(each.data).command]

    def receive(self, frame: can.Message) -> None:
        assert (frame.arbitration_id, frame.is_extended_id) == (0x8000 | NODE, True)
        assert (frame.is_fd, frame.bitrate_switch) == (True, True)
        self.frames.append(frame)
        if self.deaf:
            return
        if self.mode == MODE.POSITION and self.clock.ns - self.commanded_ns > self.watchdog_ns:
            self.mode = MODE.TIMEOUT
        asked = parse_registers(frame.data)
        if asked.query:
            self.bus.arrive(NODE << 8, self.reply(dict(asked.query)), fd=True)
        if asked.command:
            self.obey(asked.command)

    def reply(self, query: dict[int, int]) -> bytes:
        if REGISTER.MODEL_NUMBER in query:
            return b"\x2b\x80\x02" + Struct("<3i").pack(0x0604, 0x010304, self.register_map)
        head = self.refused + bytes((0x21, 0, self.mode)) + b"\x2c\x04\x01" + Struct("<4f").pack(*self.motion)
        return (head + b"\x27\x0d" + Struct("<3h").pack(241, 315, self.fault)).ljust(32, b"\x50")

    def obey(self, command: dict[int, float]) -> None:
        wanted = command[REGISTER.MODE]
        if wanted == MODE.STOPPED:
            self.mode, self.fault = MODE.STOPPED, 0
            return
        self.commanded_ns, self.watchdog_ns = self.clock.ns, command[REGISTER.COMMAND_TIMEOUT] * 1e9
        if self.mode == MODE.STOPPED:
            self.mode = 3  # calibrating
        elif self.mode == 3:
            self.mode = MODE.POSITION if self.stubborn is None else MODE.FAULT
            self.fault = self.stubborn or 0


@pytest.fixture
def controller(world):
    return ScriptedController(world)


@pytest.fixture
def link(world):
    return Link(world, (BUS,))


@pytest.fixture
def open_moteus(controller, link, device):
    def opened(direction: int = 1, **options: object) -> MoteusController:
        return open_amplifier(device("actuator", "moteus", direction=direction, node=NODE, **options), link)

    return opened


def wait(link, ms: int = 20) -> None:
    for _ in range(ms):
        link.wait()


# ---- who is there ---------------------------------------------------------------------------------------------------


def test_identity_without_a_command(controller, open_moteus):
    identity = open_moteus().identify()
    assert (identity.driver, identity.address) == ("moteus", "can0 node 5")
    assert (identity.hardware, identity.firmware) == ("model 0x0604", "1.3.4")
    assert controller.commands == []


def test_nobody_there(controller, open_moteus):
    controller.deaf = True
    with pytest.raises(DeviceTimeoutError, match=r"\[actuator\] moteus 5 on can0: does not answer .* its id.id"):
        open_moteus().identify(timeout_s=0.1)


def test_a_firmware_too_old_is_refused(controller, open_moteus):
    controller.register_map = 3
    with pytest.raises(DeviceError, match=r"its firmware \(1.3.4\) is too old; update it"):
        open_moteus().identify()


def test_a_bus_without_can_fd_is_refused(world, device):
    with pytest.raises(WiringError, match=r'write fd = true and data_bitrate = "5 Mbit/s" in \[bus.can0\]'):
        open_amplifier(device("actuator", "moteus", node=NODE), world.link())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"node": 0}, "node = 0"),
        ({"node": 1, "watchdog": 0.001}, "at least 20 ms"),
        ({"node": 1, "mode": "position"}, 'mode = "position" needs it'),
        ({"node": 1, "mode": "velocity"}, 'damping = 0.0: mode = "velocity" needs it'),
        ({"node": 1, "mode": "velocity", "damping": 0.1, "stiffness": 1.0}, 'mode = "velocity" has none'),
        ({"node": 1, "prefix": 0x2000}, "prefix = 8192"),
    ],
)
def test_wrong_options(link, device, options, words):
    with pytest.raises(WiringError, match=words):
        open_amplifier(device("actuator", "moteus", **options), link)


# ---- enabled, commanded, stopped -------------------------------------------------------------------------------------


def test_it_is_stopped_then_started_with_a_torque_of_zero(controller, open_moteus):
    amplifier = open_moteus(watchdog=0.3)
    controller.mode, controller.fault = MODE.FAULT, 33
    amplifier.enable()
    assert amplifier.status().state is DriveState.ENABLED
    stops = [each for each in controller.commands if each == {REGISTER.MODE: MODE.STOPPED}]
    others = [each for each in controller.commands if each not in stops]
    assert controller.commands[: len(stops)] == stops
    (command,) = {str(each): each for each in others}.values()
    assert math.isnan(command.pop(REGISTER.COMMAND_POSITION))
    assert command == {
        REGISTER.MODE: MODE.POSITION,
        REGISTER.COMMAND_FEEDFORWARD_TORQUE: 0.0,
        REGISTER.COMMAND_KP_SCALE: 0.0,
        REGISTER.COMMAND_KD_SCALE: 0.0,
        REGISTER.COMMAND_TIMEOUT: pytest.approx(0.3),
        REGISTER.COMMAND_ILIMIT_SCALE: 0.0,
    }


@pytest.mark.parametrize("direction", [1, -1])
def test_torques_and_readings_have_the_benchs_sense(controller, open_moteus, link, direction):
    amplifier = open_moteus(direction)
    amplifier.enable()
    amplifier.take_motion(), amplifier.take_current()
    controller.motion = (0.25, -0.5, 0.1, 2.0)
    sent = amplifier.command(0.1)
    assert sent == pytest.approx(0.1)
    link.poll()
    assert controller.commands[-1][REGISTER.COMMAND_FEEDFORWARD_TORQUE] == pytest.approx(direction * 0.1)
    (motion,), (current,) = amplifier.take_motion(), amplifier.take_current()
    assert motion.position_rad == pytest.approx(direction * math.pi / 2)
    assert motion.velocity_rad_s == pytest.approx(-direction * math.pi)
    assert current.current_a == direction * 2.0
    assert amplifier.status().bus_voltage_v == pytest.approx(24.1)
    assert amplifier.status().transistor_temperature_c == pytest.approx(31.5)


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        ({"stubborn": 39}, "cannot be enabled: outside servopos.position_min and position_max: set both to nan"),
        ({"refused": b"\x30\x2b\x01"}, "its firmware is too old for a torque without integral; update it"),
        ({"deaf": True}, "does not stop"),
    ],
)
def test_what_cannot_be_enabled_is_told_and_left_stopped(controller, open_moteus, link, harm, words):
    amplifier = open_moteus()
    for name, value in harm.items():
        setattr(controller, name, value)
    with pytest.raises(DeviceError, match=words):
        amplifier.enable(timeout_s=0.2)
    wait(link)
    assert controller.mode in (MODE.STOPPED, MODE.FAULT)


def test_a_stop_that_is_lost_is_sent_again(controller, open_moteus, link):
    amplifier = open_moteus()
    amplifier.enable()
    controller.deaf = True
    amplifier.stop()
    controller.deaf = False
    wait(link)
    assert controller.mode == MODE.STOPPED
    assert amplifier.status().state is DriveState.IDLE


def test_a_stop_never_raises(world, open_moteus):
    amplifier = open_moteus()
    world.bus.broken = True
    amplifier.stop()
    with pytest.raises(ConnectionFailedError):
        amplifier.command(0.0)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_no_number_is_not_commanded(controller, open_moteus, value):
    amplifier = open_moteus()
    with pytest.raises(DeviceError, match="cannot command"):
        amplifier.command(value)
    assert controller.frames == []


# ---- what goes wrong ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "fault", "words"),
    [
        (MODE.FAULT, 33, "motor driver fault: most often the supply broke down"),
        (MODE.TIMEOUT, 0, "its watchdog has expired: no command came in time"),
        (MODE.STOPPED, 0, "left position mode without a fault (now stopped)"),
        (MODE.POSITION, 103, "its torque is limited by servopos.position_min or position_max: set both to nan in the "
                             "drive"),
        (MODE.POSITION, 100, "its torque is limited by its temperature"),
    ],
)  # fmt: skip
def test_an_enabled_one_that_obeys_no_more_is_in_fault_until_it_is_enabled_again(
    controller, open_moteus, link, mode, fault, words
):
    amplifier = open_moteus()
    amplifier.enable()
    controller.mode, controller.fault = mode, fault
    amplifier.command(0.0)
    link.poll()
    controller.mode, controller.fault = MODE.POSITION, 0
    amplifier.command(0.0)
    link.poll()
    assert (amplifier.status().state, amplifier.status().errors) == (DriveState.FAULT, (words,))
    amplifier.enable()
    assert (amplifier.status().state, amplifier.status().errors) == (DriveState.ENABLED, ())


@pytest.mark.parametrize("fault", [98, 99, 102])
def test_a_torque_at_its_limit_is_no_fault(controller, open_moteus, link, fault):
    amplifier = open_moteus()
    amplifier.enable()
    controller.fault = fault
    amplifier.command(0.0)
    link.poll()
    assert (amplifier.status().state, amplifier.status().errors) == (DriveState.ENABLED, ())


def test_the_watchdog_is_seen_at_work_by_questions_that_do_not_feed_it(controller, open_moteus, link):
    amplifier = open_moteus(watchdog=0.1)
    amplifier.enable()
    amplifier.provoke_watchdog()
    before = len(controller.commands)
    wait(link, 90)
    assert not amplifier.made_itself_safe()
    wait(link, 40)
    assert amplifier.made_itself_safe()
    assert len(controller.commands) == before


def test_what_a_host_left_behind_is_stopped(controller, open_moteus, link):
    controller.mode = MODE.TIMEOUT
    open_moteus()
    wait(link)
    assert controller.mode == MODE.STOPPED


def test_garbage_is_counted_and_moves_nothing(world, open_moteus, link):
    amplifier = open_moteus()
    for data in (b"", b"\x2c\x04", bytes(12), b"\x2c\x04\x01" + b"\xff" * 16):
        world.bus.arrive(NODE << 8, data, fd=True)
    link.poll()
    assert amplifier.take_motion()[1:] == []
    assert amplifier.malformed == 1


def test_two_on_one_bus_hear_their_own_replies(world, link, device):
    one, other = (open_amplifier(device(role, "moteus", node=node), link) for role, node in
                  (("actuator", 5), ("load", 6)))  # fmt: skip
    reply = ScriptedController(world).reply({})
    world.bus.peer = lambda _frame: None
    world.bus.arrive(6 << 8, reply, fd=True)
    link.poll()
    assert (len(one.take_motion()), len(other.take_motion())) == (0, 1)


# ---- position as a command -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
def test_goals_are_led_from_where_the_shaft_stands(controller, open_moteus, link, direction):
    amplifier = open_moteus(direction, mode="position", stiffness=2.0, watchdog=0.3)
    assert amplifier.command_unit == "rad"
    controller.motion = (0.02, 0.0, 0.0, 0.0)
    wait(link)
    amplifier.enable()
    first = next(each for each in controller.commands if each[REGISTER.MODE] == MODE.POSITION)
    assert first[REGISTER.COMMAND_POSITION] == pytest.approx(0.02, abs=2e-3)
    assert (first[REGISTER.COMMAND_VELOCITY_LIMIT], first[REGISTER.COMMAND_ACCEL_LIMIT]) == (-1.0, -1.0)
    for _ in range(400):
        amplifier.command(0.5)
        link.wait()
    assert controller.commands[-1][REGISTER.COMMAND_POSITION] == pytest.approx(direction * 0.5 / math.tau, rel=1e-6)
    assert amplifier.command(0.5) == pytest.approx(0.5, rel=1e-6)


def test_a_shaft_far_from_zero_is_not_enabled(controller, open_moteus, link):
    amplifier = open_moteus(mode="position", stiffness=2.0)
    controller.motion = (0.3, 0.0, 0.0, 0.0)
    wait(link)
    with pytest.raises(DeviceError, match=r"cannot be enabled: the shaft stands 1.88 rad from the drive's zero"):
        amplifier.enable()
    assert controller.mode == MODE.STOPPED
