"""The VESC driver against a scripted drive, whose bytes are packed by hand from comm_can.c."""

import math
import random
import struct

import can
import pytest
from crccheck.crc import CrcXmodem

from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.readings import DriveState
from norton_drivers.vesc import Vesc, open_amplifier

NODE, HOST = 23, 254
POLE_PAIRS = 7
TURN = 2 * math.pi
SET_DUTY, SET_CURRENT, SHORT, STATUS, STATUS_4, PING, PONG, STATUS_5 = 0, 1, 8, 9, 16, 17, 18, 27
MS = 1_000_000


class ScriptedVesc:
    """``drawn`` is in tenths of an ampere, ``duty`` in thousandths, ``angle`` in fiftieths of a degree."""

    def __init__(self, world) -> None:
        self.bus, self.clock = world.bus, world.clock
        self.erpm = self.drawn = self.angle = self.tachometer = self.fault = self.hardware_type = 0
        self.duty = 100
        self.version = bytes((0, 6, 5)) + b"60\0" + bytes(16)
        self.mute: set[int] = set()
        self.every_ns = MS
        self.answers_ping = self.answers_fault = self.answers_version = True
        self.commands: list[tuple[int, int]] = []  # packet and the number in it
        self.fault_asked_ns: list[int] = []
        world.bus.peer = self.receive
        world.clock.alarms.append(self.tick)

    def say(self, packet: int, data: bytes, to: int = NODE) -> None:
        if packet not in self.mute:
            self.bus.arrive(packet << 8 | to, data, extended=True)

    def tick(self, now_ns: int) -> None:
        if now_ns % self.every_ns:
            return
        self.say(STATUS, struct.pack(">ihh", self.erpm, self.drawn, self.duty))
        self.say(STATUS_4, struct.pack(">hhhh", 315, 402, 12, self.angle))
        self.say(STATUS_5, struct.pack(">ihh", self.tachometer, 241, 0))

    def receive(self, frame: can.Message) -> None:
        assert frame.is_extended_id
        packet, node = frame.arbitration_id >> 8, frame.arbitration_id & 0xFF
        assert node == NODE
        if packet == PING:
            assert bytes(frame.data) == bytes((HOST,))
            if self.answers_ping:
                self.say(PONG, bytes((NODE, self.hardware_type)), to=HOST)
        elif packet == SHORT:
            assert frame.data[:2] == bytes((HOST, 0))
            self.answer(bytes(frame.data[2:]))
        else:
            assert packet in (SET_DUTY, SET_CURRENT)
            assert len(frame.data) == 4
            self.commands.append((packet, struct.unpack(">i", frame.data)[0]))

    def answer(self, asked: bytes) -> None:
        if asked == bytes.fromhex("3200008000"):
            self.fault_asked_ns.append(self.clock.ns)
            if self.answers_fault:
                self.say(SHORT, bytes((NODE, 1)) + asked + bytes((self.fault,)), to=HOST)
        elif asked == b"\0" and self.answers_version:
            for at in range(0, len(self.version), 7):
                self.say(5, bytes((at,)) + self.version[at : at + 7], to=HOST)
            self.say(7, struct.pack(">BBHH", NODE, 1, len(self.version), CrcXmodem.calc(self.version)), to=HOST)


@pytest.fixture
def drive(world):
    return ScriptedVesc(world)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_drive(drive, link, device):
    def opened(direction: int = 1, **options: object) -> Vesc:
        options = {"node": NODE, "pole_pairs": POLE_PAIRS, **options}
        return open_amplifier(device("actuator", "vesc", direction=direction, **options), link)

    return opened


# ---- who is there ---------------------------------------------------------------------------------------------------


def test_identity(open_drive):
    identity = open_drive().identify()
    assert (identity.driver, identity.address) == ("vesc", "can0 VESC ID 23")
    assert (identity.hardware, identity.firmware) == ("60", "6.05")


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        ({"answers_ping": False}, r"\[actuator\] VESC 23 on can0: does not answer a ping; is it powered.*CAN Mode"),
        ({"answers_version": False}, "does not tell its firmware's version"),
        ({"answers_fault": False}, "does not tell its fault code; update its firmware"),
        ({"mute": {STATUS}}, "sends no STATUS; in VESC Tool, App Settings.*Message 1 on"),
        ({"mute": {STATUS_4}}, "sends no STATUS_4; .*Message 4 on too"),
    ],
)
def test_what_is_missing_is_told_with_its_mend(drive, open_drive, harm, words):
    for name, value in harm.items():
        setattr(drive, name, value)
    with pytest.raises(DeviceTimeoutError, match=words):
        open_drive().identify(timeout_s=0.1)


def test_the_tachometer_is_missed_where_it_is_wanted(drive, open_drive):
    drive.mute = {STATUS_5}
    with pytest.raises(DeviceTimeoutError, match="sends no STATUS_5"):
        open_drive(position="tachometer").identify(timeout_s=0.1)


def test_a_battery_monitor_is_no_motor_controller(drive, open_drive):
    drive.hardware_type = 1
    with pytest.raises(DeviceError, match=r"is no motor controller \(hardware type 1\)"):
        open_drive().identify()


# ---- enabling and faults --------------------------------------------------------------------------------------------


def test_enabling_sees_that_there_is_no_fault_and_commands_zero(drive, open_drive):
    amplifier = open_drive()
    assert amplifier.status().state is DriveState.UNKNOWN
    amplifier.enable()
    assert drive.commands == [(SET_CURRENT, 0)]
    assert amplifier.status().state is DriveState.ENABLED


def test_a_fault_that_passes_is_waited_for(world, drive, open_drive):
    drive.fault = 2
    started_ns = world.clock.ns
    world.clock.alarms.append(lambda now: setattr(drive, "fault", 0) if now > started_ns + 300 * MS else None)
    amplifier = open_drive()
    amplifier.enable()
    assert amplifier.status().state is DriveState.ENABLED
    assert amplifier.status().errors == ()


def test_a_fault_that_stays_refuses(drive, open_drive):
    drive.fault = 2
    with pytest.raises(DeviceError, match="refuses to drive its motor: supply voltage too low: is the supply on"):
        open_drive().enable(timeout_s=0.3)
    assert drive.commands == []


def test_a_drive_that_says_nothing(drive, open_drive):
    drive.answers_fault = False
    with pytest.raises(DeviceTimeoutError, match=r"does not tell its fault code \(0\.2 s waited\)"):
        open_drive().enable(timeout_s=0.2)


def test_a_fault_is_seen_soon_and_stays_though_it_clears_itself(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.fault = 5
    for _ in range(25):
        link.wait()
    status = amplifier.status()
    assert (status.state, status.errors) == (DriveState.FAULT, ("transistors too hot",))
    drive.fault = 0
    for _ in range(600):
        link.wait()
    assert amplifier.status().state is DriveState.FAULT
    amplifier.enable()
    assert (amplifier.status().state, amplifier.status().errors) == (DriveState.ENABLED, ())


def test_the_fault_code_is_asked_for_fifty_times_a_second_however_often_the_ports_are_polled(
    world, drive, link, open_drive
):
    open_drive()
    for _ in range(1000):
        link.wait()
    assert len(drive.fault_asked_ns) == pytest.approx(50, abs=1)


@pytest.mark.parametrize("harm", [{"mute": {STATUS}}, {"answers_fault": False}])
def test_either_silence_is_a_lost_heartbeat(world, drive, link, open_drive, harm):
    amplifier = open_drive()
    amplifier.enable()
    for name, value in harm.items():
        setattr(drive, name, value)
    for _ in range(400):
        link.wait()
    assert world.clock.ns - amplifier.status().heartbeat_ns > amplifier.heartbeat_timeout_ns


def test_stopping_lets_go_of_the_motor_and_is_idle_when_the_drive_shows_it(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.drawn = 30
    link.wait()
    amplifier.stop()
    assert drive.commands[-1] == (SET_CURRENT, 0)
    for _ in range(10):
        link.wait()
    assert amplifier.status().state is DriveState.ENABLED
    drive.drawn = 0
    link.wait()
    assert amplifier.status().state is DriveState.IDLE


def test_a_drive_that_falls_silent_at_the_stop_is_not_taken_for_idle(drive, link, open_drive):
    amplifier = open_drive()
    amplifier.enable()
    drive.mute = {STATUS}
    amplifier.stop()
    for _ in range(10):
        link.wait()
    assert amplifier.status().state is DriveState.ENABLED


def test_a_lost_bus_does_not_keep_it_from_stopping(world, open_drive):
    amplifier = open_drive()
    world.bus.broken = True
    amplifier.stop()
    with pytest.raises(ConnectionFailedError, match="can0"):
        amplifier.command(0.0)


# ---- commands -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "unit", "value", "sent", "carried"),
    [
        ({}, "A", 51.0, (SET_CURRENT, 51_000), 51.0),
        ({}, "A", 0.12345, (SET_CURRENT, 123), 0.123),
        ({}, "A", 0.049, (SET_CURRENT, 0), 0.0),  # below the drive's minimum
        ({"minimum_current": 0.0}, "A", 0.049, (SET_CURRENT, 49), 0.049),
        ({"mode": "torque", "torque_constant": 0.05}, "N*m", 0.2, (SET_CURRENT, 4000), 0.2),
        ({"mode": "torque", "torque_constant": 0.05}, "N*m", 0.100_03, (SET_CURRENT, 2001), 0.100_05),
        ({"mode": "duty"}, "1", 0.123_456, (SET_DUTY, 12_346), 0.123_46),
        ({"mode": "duty"}, "1", 7.0, (SET_DUTY, 100_000), 1.0),
    ],
)
@pytest.mark.parametrize("direction", [1, -1])
def test_commands_and_what_is_said_to_have_been_sent(drive, open_drive, options, unit, value, sent, carried, direction):
    amplifier = open_drive(direction, **options)
    assert amplifier.command_unit == unit
    assert amplifier.command(value) == pytest.approx(carried, rel=1e-12)
    assert drive.commands[-1] == (sent[0], direction * sent[1])
    assert amplifier.command(-value) == pytest.approx(-carried, rel=1e-12)


@pytest.mark.parametrize("mode", ["current", "duty"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_no_number_is_never_sent(drive, open_drive, mode, value):
    amplifier = open_drive(mode=mode)
    with pytest.raises(DeviceError, match="cannot command"):
        amplifier.command(value)
    assert drive.commands == []


def test_stopping_a_duty_cycle_does_not_leave_the_motor_braked(drive, open_drive):
    open_drive(mode="duty").stop()
    assert drive.commands == [(SET_DUTY, 0), (SET_CURRENT, 0)]


# ---- readings -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
def test_signs_and_units(drive, link, open_drive, direction):
    amplifier = open_drive(direction)
    drive.erpm, drive.drawn, drive.duty, drive.angle = 7000, -25, -300, 4500
    link.wait()
    (motion,), (current,) = amplifier.take_motion(), amplifier.take_current()
    assert motion.position_rad == pytest.approx(direction * TURN / 4)
    # 1000 turns a minute, of which the cast cut off half an ERPM on average.
    assert motion.velocity_rad_s == pytest.approx(direction * TURN * 1000.0714 / 60, rel=1e-7)
    # Generating while the voltage is negative: a positive torque; the middle of 2.5 to 2.6 A.
    assert current.current_a == pytest.approx(direction * 2.55)
    status = amplifier.status()
    assert (status.transistor_temperature_c, status.motor_temperature_c, status.bus_voltage_v) == (31.5, 40.2, 24.1)


def test_a_current_without_a_sign_is_left_out(drive, link, open_drive):
    amplifier = open_drive()
    drive.drawn, drive.duty = 2, 0
    link.wait()
    assert amplifier.take_current() == []
    drive.drawn = 0
    link.wait()
    assert [reading.current_a for reading in amplifier.take_current()] == [0.0]


@pytest.mark.parametrize("rate_hz", [1000, 50])
@pytest.mark.parametrize("speed_rad_s", [80.0, -80.0, 200.0])
def test_the_angle_is_followed_over_many_turns(world, drive, link, open_drive, rate_hz, speed_rad_s):
    amplifier = open_drive()
    drive.every_ns = 1000 * MS // rate_hz
    drive.erpm = round(speed_rad_s * 60 / TURN * POLE_PAIRS)
    position_rad, readings = 0.0, []
    for _ in range(rate_hz):
        drive.angle = int(math.degrees(position_rad) % 360.0 * 50)
        link.wait(drive.every_ns)
        readings += amplifier.take_motion()
        position_rad += speed_rad_s / rate_hz
    assert len(readings) == rate_hz
    travel = readings[-1].position_rad - readings[0].position_rad
    assert travel == pytest.approx(speed_rad_s * (1 - 1 / rate_hz), abs=2 * TURN / 18_000)


def test_the_tachometer_counts_sixths_of_electrical_turns(drive, link, open_drive):
    amplifier = open_drive(position="tachometer")
    assert amplifier.position_resolution_rad == pytest.approx(TURN / (6 * POLE_PAIRS))
    readings = []
    for tachometer in (0x7FFF_FFFF - 20, -0x7FFF_FFFF + 20):  # it wraps
        drive.tachometer = tachometer
        link.wait()
        readings += amplifier.take_motion()
    assert readings[1].position_rad - readings[0].position_rad == pytest.approx(42 * TURN / 42)


def test_no_motion_before_the_velocity_is_known(drive, link, open_drive):
    drive.mute = {STATUS}
    amplifier = open_drive()
    link.wait()
    assert amplifier.take_motion() == []


def test_resolution(open_drive):
    assert open_drive().position_resolution_rad == pytest.approx(TURN / 18_000)


def test_another_drives_frames_are_anothers(drive, link, open_drive):
    drive.mute = {STATUS, STATUS_4, STATUS_5}
    amplifier = open_drive()
    drive.mute = set()
    drive.say(STATUS, struct.pack(">ihh", 1, 1, 1), to=NODE + 1)
    drive.say(SHORT, bytes((NODE + 1, 1)) + bytes.fromhex("320000800005"), to=HOST)
    drive.say(SHORT, bytes((NODE, 0)) + bytes.fromhex("320000800005"), to=HOST)  # a question, not an answer
    drive.bus.arrive(STATUS << 8 | NODE & 0x7FF, struct.pack(">ihh", 1, 1, 1))  # not extended
    link.poll()
    assert amplifier.take_current() == []
    assert amplifier.status().state is DriveState.UNKNOWN


def test_a_hundred_thousand_frames_of_rubbish(world, link, open_drive):
    amplifier = open_drive()
    world.clock.alarms.clear()
    rng = random.Random(7)
    packets = [STATUS, STATUS_4, STATUS_5, 5, 6, 7, SHORT, PONG, 60]
    for _ in range(100):
        for _ in range(1000):
            identifier = rng.choice(packets) << 8 | rng.choice([NODE, HOST, 255])
            world.bus.arrive(identifier, rng.randbytes(rng.randrange(9)), extended=True)
        link.poll()
        amplifier.take_motion(), amplifier.take_current(), amplifier.status()
    assert amplifier.malformed > 1000


# ---- the timeout ----------------------------------------------------------------------------------------------------


def test_a_timeout_that_is_not_probed_cannot_be_shown(drive, link, open_drive):
    amplifier = open_drive(watchdog=0.7)
    assert amplifier.watchdog_s == pytest.approx(0.71)
    amplifier.enable()
    amplifier.provoke_watchdog()
    assert drive.commands[-1] == (SET_CURRENT, 0)
    for _ in range(1000):
        link.wait()
    assert amplifier.made_itself_safe() is None


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("works", [True, False])
def test_the_probes_current_shows_the_timeout_at_work(drive, link, open_drive, works, direction):
    amplifier = open_drive(direction, watchdog_probe=0.4)
    amplifier.enable()
    amplifier.provoke_watchdog()
    assert drive.commands[-1] == (SET_CURRENT, direction * 400)
    assert amplifier.made_itself_safe() is None
    drive.drawn = 3
    for _ in range(900):
        link.wait()
    assert amplifier.made_itself_safe() is False
    drive.drawn = 0 if works else 3
    link.wait()
    assert amplifier.made_itself_safe() is works
    assert len(drive.commands) == 2  # nothing fed it meanwhile


# ---- options --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"pole_pairs": None}, "pole_pairs"),
        ({"node": 255}, "node = 255"),
        ({"mode": "torque"}, 'mode = "torque" needs it'),
        ({"mode": "voltage"}, "mode = 'voltage'"),
        ({"position": "hall"}, "position = 'hall'"),
        ({"watchdog_probe": 0.1}, "at least 0.3 A"),
        ({"host_node": NODE}, "is the drive's own"),
        ({"speed": 1}, "speed is not an option"),
    ],
)
def test_wrong_options_are_told(open_drive, options, words):
    with pytest.raises(WiringError, match=words):
        open_drive(**options)


def test_pole_pairs_must_be_given(drive, link, device):
    with pytest.raises(WiringError, match='driver = "vesc" needs pole_pairs: pairs of magnet poles'):
        open_amplifier(device("actuator", "vesc", node=NODE), link)
