"""The ODrive driver on firmware 0.5: what it does otherwise, what it asks for, and what it makes of counts."""

import math
from functools import partial

import can
import pytest

from norton_drivers.codecs import odrive, odrive_05
from norton_drivers.codecs.odrive import AxisState, MessageId
from norton_drivers.codecs.odrive_05 import Command05
from norton_drivers.errors import DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.odrive import ODrive, open_amplifier
from norton_drivers.readings import DriveState

NODE = 5
TURN = 2 * math.pi
CPR = 8192


class ScriptedDrive05:
    """Answers as firmware 0.5.6's source says, through the codec that was held against its DBC file."""

    def __init__(self, world) -> None:
        self.bus, self.clock = world.bus, world.clock
        self.state = AxisState.IDLE
        self.axis_errors = 0
        self.errors = dict.fromkeys(
            (
                Command05.MOTOR_ERROR,
                Command05.ENCODER_ERROR,
                Command05.CONTROLLER_ERROR,
                Command05.SENSORLESS_ERROR,
            ),
            0,
        )
        self.count = 0
        self.current_a = 1.5
        self.refuses = self.deaf = self.mute = False
        self.flags = True
        self.cyclic_counts = False
        self.commands: list[tuple[int, bytes]] = []
        self.asked: list[int] = []
        self.next_heartbeat_ns = self.clock.ns + 50_000_000
        world.bus.peer = self.receive
        world.clock.alarms.append(self.tick)

    def say(self, command: int, data: bytes) -> None:
        self.bus.arrive(odrive.arbitration_id(NODE, command), data)

    def tick(self, now_ns: int) -> None:
        if self.deaf:
            return
        if not self.mute:
            self.say(MessageId.ENCODER_ESTIMATES, odrive.estimates_value(0.25, -2.0))
        if self.cyclic_counts:
            self.answer(Command05.ENCODER_COUNT)
        if now_ns >= self.next_heartbeat_ns:
            self.next_heartbeat_ns = now_ns + 100_000_000
            self.heartbeat()

    def heartbeat(self) -> None:
        failed = [self.flags and self.errors[part] != 0 for part in list(self.errors)[:3]]
        self.say(MessageId.HEARTBEAT, odrive_05.Heartbeat05(self.axis_errors, self.state, *failed).encode())

    def receive(self, frame: can.Message) -> None:
        node, command = odrive.split_id(frame.arbitration_id)
        assert node == NODE
        if self.deaf:
            return
        if frame.is_remote_frame:
            self.asked.append(command)
            self.answer(command)
            return
        self.commands.append((command, bytes(frame.data)))
        if command == Command05.CLEAR_ERRORS and not self.refuses:
            self.axis_errors = 0
            self.errors = dict.fromkeys(self.errors, 0)
        elif command == MessageId.SET_AXIS_STATE and not self.refuses:
            self.state = odrive.SetAxisState.decode(frame.data).axis_state

    def answer(self, command: int) -> None:
        if command in self.errors:
            self.say(command, odrive_05.errors_value(self.errors[command]))
        elif command == Command05.ENCODER_COUNT:
            self.say(command, odrive_05.EncoderCount(self.count, self.count % CPR).encode())
        elif command == MessageId.IQ:
            self.say(command, odrive.Iq(self.current_a, self.current_a).encode())


@pytest.fixture
def drive(world):
    return ScriptedDrive05(world)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_drive(link, device):
    def opened(direction: int = 1, **options: object) -> ODrive:
        options = {"node": NODE, "firmware": "0.5", **options}
        return open_amplifier(device("actuator", "odrive", direction=direction, **options), link)

    return opened


def test_the_enable_sequence_has_no_parameters(drive, open_drive):
    amplifier = open_drive(watchdog=0.1)
    amplifier.enable()
    first = drive.commands.index((Command05.CLEAR_ERRORS, b""))
    assert drive.commands[first : first + 4] == [
        (Command05.CLEAR_ERRORS, b""),
        (MessageId.SET_CONTROLLER_MODE, bytes.fromhex("0100000001000000")),
        (MessageId.SET_INPUT_TORQUE, bytes(8)),
        (MessageId.SET_AXIS_STATE, bytes.fromhex("0800000000000000")),
    ]
    assert MessageId.RX_SDO not in {command for command, _ in drive.commands}
    assert amplifier.status().state is DriveState.ENABLED
    assert (amplifier.watchdog_s, amplifier.command_unit) == (0.1, "N*m")


def test_an_idle_drive_whose_watchdog_has_run_out_is_no_fault(drive, link, open_drive):
    amplifier = open_drive()
    drive.axis_errors = odrive_05.ERROR_WATCHDOG
    drive.heartbeat()
    link.poll()
    assert amplifier.status().state is DriveState.IDLE
    amplifier.enable()
    assert amplifier.status().errors == ()
    assert amplifier.made_itself_safe() is False
    drive.state, drive.axis_errors = AxisState.IDLE, odrive_05.ERROR_WATCHDOG
    drive.heartbeat()
    link.poll()
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ("watchdog expired: no command arrived in time",)
    assert amplifier.made_itself_safe() is True


@pytest.mark.parametrize("flags", [True, False])
def test_the_part_that_failed_is_asked_of_what(drive, link, open_drive, flags):
    amplifier = open_drive()
    amplifier.enable()
    # Before 0.5.6 a heartbeat shows nothing of a failed motor but that the loop is open.
    drive.flags, drive.state = flags, AxisState.IDLE
    drive.errors[Command05.MOTOR_ERROR] = 1 << 35 | 1 << 3
    drive.errors[Command05.ENCODER_ERROR] = 1 << 4
    drive.heartbeat()
    link.poll()
    link.poll()
    status = amplifier.status()
    assert status.state is DriveState.FAULT
    assert status.errors == ("gate driver fault", "phases unbalanced", "illegal Hall state")


def test_a_failure_before_enabling_and_after_clearing(drive, link, open_drive):
    amplifier = open_drive()
    drive.errors[Command05.CONTROLLER_ERROR] = 1
    for _ in range(2):
        drive.heartbeat()
        link.poll()
    assert amplifier.status().state is DriveState.FAULT
    assert amplifier.status().errors == ("the drive's velocity limit was violated",)
    drive.errors[Command05.CONTROLLER_ERROR] = 0
    drive.heartbeat()
    link.poll()
    assert (amplifier.status().state, amplifier.status().errors) == (DriveState.IDLE, ())


def test_a_refusal_is_told_in_the_drives_words(drive, open_drive):
    drive.refuses, drive.axis_errors = True, odrive_05.ERROR_INVALID_STATE
    with pytest.raises(DeviceError, match="refuses to close its torque loop: the state asked for is not possible"):
        open_drive().enable()


def test_identity(drive, open_drive):
    identity = open_drive().identify()
    assert (identity.driver, identity.address, identity.hardware, identity.firmware) == (
        "odrive",
        "can0 node 5",
        "",
        "0.5",
    )


def test_a_drive_that_says_nothing(drive, open_drive):
    drive.deaf = True
    with pytest.raises(DeviceTimeoutError, match=r"does not answer; is it powered .*\(0\.3 s waited\)"):
        open_drive().identify(timeout_s=0.3)


def test_a_drive_that_sends_no_estimates(drive, open_drive):
    drive.mute = True
    with pytest.raises(DeviceTimeoutError, match=r"no encoder estimates; set axis0\.config\.can\.encoder_rate_ms = 1"):
        open_drive().identify(timeout_s=0.3)


def test_firmware_06_that_is_written_as_05(drive, world, open_drive):
    def answer_version(frame: can.Message) -> None:
        if odrive.split_id(frame.arbitration_id)[1] == MessageId.VERSION:
            drive.say(MessageId.VERSION, odrive.Version(2, (4, 4, 58), (0, 6, 10)).encode())

    world.bus.peer = answer_version
    with pytest.raises(DeviceError, match=r'says it runs firmware 0\.6\.10; the rig file has firmware = "0\.5"'):
        open_drive().identify()


def test_firmware_05_that_is_written_as_06(drive, open_drive):
    with pytest.raises(DeviceError, match=r'answers as firmware 0\.5 does; write firmware = "0\.5"'):
        open_drive(firmware="0.6").identify()


def test_temperatures_are_none_and_sensorless_estimates_are_not_taken_for_them(drive, link, open_drive):
    amplifier = open_drive()
    drive.say(MessageId.TEMPERATURE, odrive.estimates_value(99.0, 99.0))
    drive.heartbeat()
    link.poll()
    assert math.isnan(amplifier.status().transistor_temperature_c)
    assert amplifier.malformed == 0


# ---- Counts ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def open_counting(open_drive):
    return partial(open_drive, position="counts", counts_per_turn=CPR)


@pytest.mark.parametrize("direction", [1, -1])
def test_counts_are_exact_however_far_it_turns(drive, link, open_counting, direction):
    amplifier = open_counting(direction)
    drive.cyclic_counts = True
    drive.count = 1000 * CPR + 1  # where a float32 of turns has steps of half a count
    link.wait()
    (reading,) = amplifier.take_motion()
    assert reading.position_rad == direction * TURN * (1000 * CPR + 1) / CPR
    assert reading.velocity_rad_s == pytest.approx(-direction * 2 * TURN)
    assert amplifier.position_resolution_rad == TURN / CPR


def test_counts_go_on_where_32_bits_wrap(drive, link, open_counting):
    amplifier = open_counting()
    drive.cyclic_counts = True
    positions = []
    for count in (2**31 - 3, -(2**31) + 2, 2**31 - 1):
        drive.count = count
        link.wait()
        positions += [reading.position_rad * CPR / TURN for reading in amplifier.take_motion()]
    assert positions == pytest.approx([2**31 - 3, 2**31 + 2, 2**31 - 1], abs=1e-6)


def test_a_count_without_a_velocity_is_no_reading_yet(drive, link, open_counting):
    amplifier = open_counting()
    drive.cyclic_counts, drive.mute = True, True
    link.wait()
    assert amplifier.take_motion() == []
    drive.mute = False
    link.wait()
    link.wait()
    assert len(amplifier.take_motion()) >= 1


def test_counts_that_do_not_come_are_told_with_the_mend(drive, open_counting):
    with pytest.raises(DeviceTimeoutError, match=r"encoder_count_rate_ms = 1, which firmware before 0\.5\.6 has not"):
        open_counting().identify(timeout_s=0.3)


def test_old_firmware_is_asked_for_currents(drive, link, open_drive):
    amplifier = open_drive(ask=True)
    for _ in range(200):
        link.wait()
    current = amplifier.take_current()
    assert len(current) in range(15, 22)
    assert current[0].current_a == 1.5
    assert set(drive.asked) == {MessageId.IQ}


def test_counts_are_not_asked_for(open_counting):
    with pytest.raises(WiringError, match=r"ask = True: counts that are asked for come too irregularly"):
        open_counting(ask=True)


def test_who_is_not_to_ask_does_not(drive, link, open_drive):
    open_drive()
    for _ in range(50):
        link.wait()
    assert drive.asked == []


def test_a_lost_answer_does_not_end_the_asking(drive, link, open_drive):
    amplifier = open_drive(ask=True)
    for _ in range(20):
        link.wait()
    drive.deaf = True
    for _ in range(50):
        link.wait()
    drive.deaf = False
    amplifier.take_current()
    for _ in range(100):
        link.wait()
    assert len(amplifier.take_current()) >= 5
