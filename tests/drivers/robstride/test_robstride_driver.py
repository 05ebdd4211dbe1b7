"""The driver of RobStride motors against a scripted one, whose bytes are packed by hand."""

import math
import struct

import can
import pytest

from norton_drivers.errors import DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.readings import DriveState
from norton_drivers.robstride import RobStride, RobStrideOptions, open_amplifier

NODE, HOST = 9, 0xFD
P, V, T = 4 * math.pi, 44.0, 17.0  # an RS02


class ScriptedMotor:
    def __init__(self, world) -> None:
        self.bus = world.bus
        self.position_rad = self.velocity_rad_s = self.torque_nm = 0.0
        self.mode, self.faults = 0, 0
        self.parameters = {0x7005: 0, 0x7006: 0.0, 0x700B: T, 0x7028: 0}
        self.mech_pos_rad: float | None = None
        self.deaf = self.mute = False
        self.tells_version = True
        self.frames: list[tuple[int, int, bytes]] = []  # kind, more data, payload
        world.bus.peer = self.receive

    def receive(self, frame: can.Message) -> None:
        assert frame.is_extended_id
        kind, extra, node = frame.arbitration_id >> 24, frame.arbitration_id >> 8 & 0xFFFF, frame.arbitration_id & 0xFF
        data = bytes(frame.data)
        self.frames.append((kind, extra, data))
        if self.deaf or node != NODE:
            return
        index = int.from_bytes(data[:2], "little")
        if kind == 17:
            self.answer(index)
            return
        if kind == 3 and not self.faults:
            self.mode = 2
        elif kind == 4:
            self.mode, self.faults = 0, 0 if data[0] else self.faults
        elif kind == 18 and index in self.parameters:
            layout = "<I" if index in (0x7005, 0x7028) else "<f"
            (self.parameters[index],) = struct.unpack(layout, data[4:])
        if data[:2] == b"\0\xc4" and self.tells_version:
            self.bus.arrive(2 << 24 | NODE << 8 | HOST, bytes.fromhex("00C4560002030400"), extended=True)
        else:
            self.feedback()

    def answer(self, index: int) -> None:
        value = self.mech_pos_rad if self.mech_pos_rad is not None else self.position_rad
        value = value if index == 0x7019 else self.parameters.get(index)
        if self.mute:
            return
        raw = struct.pack("<f" if isinstance(value, float) else "<I", value or 0)
        extra = NODE | (value is None) << 8
        self.bus.arrive(17 << 24 | extra << 8 | HOST, struct.pack("<HH", index, 0) + raw, extended=True)

    def feedback(self) -> None:
        pairs = ((self.position_rad, P), (self.velocity_rad_s, V), (self.torque_nm, T))
        codes = [int((value + span) * 65535 / (2 * span)) & 0xFFFF for value, span in pairs]
        identifier = 2 << 24 | self.mode << 22 | self.faults << 16 | NODE << 8 | HOST
        self.bus.arrive(identifier, struct.pack(">HHHH", *codes, 315), extended=True)


@pytest.fixture
def motor(world):
    return ScriptedMotor(world)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_motor(motor, link, device):
    def opened(**options: object) -> RobStride:
        return open_amplifier(device("actuator", "robstride", **{"node": NODE, "motor": "rs02", **options}), link)

    return opened


def wait(link, ms: int) -> None:
    for _ in range(ms):
        link.wait()


def test_identity_without_ever_enabling(motor, open_motor):
    identity = open_motor().identify()
    assert (identity.driver, identity.address, identity.hardware, identity.firmware) == (
        "robstride",
        "can0 node 9",
        "rs02",
        "0.2.3.4",
    )
    assert {kind for kind, _, _ in motor.frames} == {4, 17}


def test_older_firmware_does_not_tell_its_version(motor, open_motor):
    motor.tells_version = False
    assert open_motor().identify().firmware == ""


def test_nobody_there(motor, open_motor):
    motor.deaf = True
    with pytest.raises(DeviceTimeoutError, match=r"RobStride motor 9 on can0: does not answer.*not MIT or CANopen"):
        open_motor().identify(timeout_s=0.1)


@pytest.mark.parametrize(
    ("parameters", "options", "words"),
    [
        ({0x700B: 14.0}, {}, r'limit_torque \(0x700B\) is 14 N\*m, as of rs00, but the rig file says motor = "rs02"'),
        ({0x700B: 60.0}, {}, r"is 60 N\*m, as of rs03"),
        ({0x700B: 20.0}, {}, r"is 20 N\*m, which none has"),
        ({0x700B: 60.0}, {"torque_range": 17.0}, r"is 60 N\*m"),  # more than its integers can say
    ],
)
def test_another_model_is_told(motor, open_motor, parameters, options, words):
    motor.parameters |= parameters
    drive = open_motor(**options)
    for ask in (drive.identify, drive.enable):
        with pytest.raises(DeviceError, match=words):
            ask()
    assert 3 not in [kind for kind, _, _ in motor.frames]


@pytest.mark.parametrize(("limit_nm", "options"), [(5.0, {}), (14.0, {"torque_range": 17.0})])
def test_a_limit_that_somebody_set_is_none_of_another_model(motor, open_motor, limit_nm, options):
    motor.parameters[0x700B] = limit_nm
    assert open_motor(**options).identify()


def test_a_position_range_that_is_not_its_own_is_told_where_it_shows(motor, open_motor):
    motor.position_rad = 9.0
    assert open_motor().identify()
    motor.mech_pos_rad = 9.0 * 12.5 / P * 0.98
    with pytest.raises(
        DeviceError, match=r"its answers say 9 rad where mech_pos \(0x7019\) is 8.773 rad; is position_range"
    ):
        open_motor().identify()


def test_a_parameter_that_cannot_be_read(motor, open_motor):
    del motor.parameters[0x700B]
    with pytest.raises(
        DeviceError, match=r"answers, but not when limit_torque \(0x700B\) is read; update its firmware"
    ):
        open_motor().identify()
    motor.mute = True
    with pytest.raises(DeviceTimeoutError, match=r"limit_torque \(0x700B\) is read \(0.1 s waited\)"):
        open_motor().identify(timeout_s=0.1)


def test_it_clears_chooses_arms_and_begins_at_zero(motor, open_motor):
    motor.faults = 1
    drive = open_motor(watchdog=0.2)
    drive.identify()
    assert drive.status().state is DriveState.FAULT
    assert drive.status().errors == ("supply voltage too low: is the supply on?",)
    drive.enable()
    assert drive.status().state is DriveState.ENABLED
    assert (motor.parameters[0x7005], motor.parameters[0x7028]) == (0, 4000)
    kinds = [kind for kind, _, _ in motor.frames]
    first = motor.frames[kinds.index(1)]
    assert abs(first[1] * 2 * T / 65535 - T) <= T / 65535 + 1e-9
    assert first[2] == bytes.fromhex("7FFF7FFF00000000")
    assert kinds.index(1) < kinds.index(3)
    assert drive.status().motor_temperature_c == 31.5
    drive.stop()
    wait_kinds = [kind for kind, _, _ in motor.frames[-2:]]
    assert wait_kinds == [1, 4]


def test_a_cybergears_timeout_is_left_alone(motor, open_motor):
    motor.parameters[0x700B] = 12.0
    drive = open_motor(motor="cybergear")
    drive.enable()
    assert (drive.watchdog_s, motor.parameters[0x7028]) == (0.0, 0)
    assert RobStrideOptions.model_validate({"node": 1, "motor": "cybergear", "watchdog": 0.5}).watchdog_s == 0.5
    assert RobStrideOptions.model_validate({"node": 1, "motor": "rs00"}).watchdog_s == 0.1


def test_currents_go_out_as_they_are(motor, open_motor):
    drive = open_motor(mode="current")
    assert drive.command_unit == "A"
    drive.enable()
    assert motor.parameters[0x7005] == 3
    sent_a = drive.command(1.234)
    assert motor.parameters[0x7006] == sent_a == pytest.approx(1.234, abs=1e-6)
    with pytest.raises(DeviceError, match="cannot command nan A"):
        drive.command(math.nan)
    drive.stop()
    assert motor.parameters[0x7006] == 0.0
    assert motor.mode == 0


def test_goals_are_positions_with_gains(motor, open_motor):
    drive = open_motor(mode="position", stiffness=20.0, damping=0.5)
    drive.enable()
    sent_rad = drive.command(0.5)
    kind, extra, data = motor.frames[-1]
    position, velocity, stiffness, damping = struct.unpack(">HHHH", data)
    assert kind == 1
    assert abs(extra * 2 * T / 65535 - T) < T / 65535 + 1e-9
    assert position * 2 * P / 65535 - P == pytest.approx(sent_rad)
    assert (velocity, stiffness, damping) == (0x7FFF, round(20 / 500 * 65535), round(0.5 / 5 * 65535))


def test_a_fault_frame_is_a_fault_until_it_is_enabled_again(motor, open_motor, link):
    drive = open_motor()
    drive.enable()
    motor.bus.arrive(21 << 24 | NODE << 8 | HOST, (1 << 14).to_bytes(4, "little") + bytes(4), extended=True)
    wait(link, 2)
    assert drive.status().errors == ("stalled for too long",)
    assert drive.status().state is DriveState.FAULT
    drive.enable()
    assert drive.status().state is DriveState.ENABLED


def test_the_watchdog_is_looked_at_once_it_should_have_acted(motor, open_motor, link):
    drive = open_motor(watchdog=0.1)
    drive.enable()
    wait(link, 20)
    drive.provoke_watchdog()
    motor.frames.clear()
    wait(link, 150)
    assert motor.frames == []
    assert drive.made_itself_safe() is False
    motor.mode = 0
    wait(link, 20)
    assert drive.made_itself_safe() is True


def test_one_that_does_not_take_its_mode(motor, open_motor):
    drive = open_motor(mode="current")
    drive.identify()
    motor.parameters[0x7005] = 0
    taken = motor.receive
    motor.bus.peer = lambda frame: (
        taken(frame) if frame.data[:2] != b"\x05\x70" or frame.arbitration_id >> 24 == 17 else None
    )
    with pytest.raises(DeviceError, match="does not take run_mode 3, but stays in 0"):
        drive.enable()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"motor": "rs07"}, r"motor = 'rs07'"),
        ({"host": NODE}, r"host = 9: is the motor's own"),
        ({"mode": "position"}, r'stiffness = None: mode = "position" needs it, at least 0.0076'),
        ({"mode": "velocity"}, r'damping = 0.0: mode = "velocity" needs it, at least 7.6e-05'),
        ({"damping": 6.0}, r"damping = 6.0: a frame carries no more than 5"),
        ({"watchdog": 0.01}, r"watchdog = 0.01: shorter than a computer"),
    ],
)
def test_options_that_cannot_be(open_motor, options, words):
    with pytest.raises(WiringError, match=words):
        open_motor(**options)


def test_a_large_motors_gains_go_further():
    options = {"node": 1, "motor": "rs03", "mode": "position", "stiffness": 600.0, "damping": 20.0}
    assert RobStrideOptions.model_validate(options).servo.damping_nms_rad == pytest.approx(20.0, rel=1e-4)
