"""The driver of Damiao motors against a scripted one, whose bytes are packed by hand."""

import struct

import can
import pytest

from norton_drivers.damiao import Damiao, DamiaoOptions, open_amplifier
from norton_drivers.errors import DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.readings import DriveState

NODE, MASTER = 5, 0x15
P, V, T = 12.5, 30.0, 10.0
ENABLE, DISABLE, CLEAR = (bytes.fromhex("FF" * 7) + bytes((last,)) for last in (0xFC, 0xFD, 0xFB))
INTEGERS = (9, 10, 14)


class ScriptedMotor:
    def __init__(self, world) -> None:
        self.bus = world.bus
        self.position_rad = self.velocity_rad_s = self.torque_nm = 0.0
        self.status = 0
        self.registers = {9: 0, 10: 1, 14: 0x37313035, 21: P, 22: V, 23: T, 32: 40.0}
        self.deaf = self.deaf_to_registers = False
        self.frames: list[tuple[int, bytes]] = []
        world.bus.peer = self.receive

    def receive(self, frame: can.Message) -> None:
        assert not frame.is_extended_id
        data = bytes(frame.data)
        self.frames.append((frame.arbitration_id, data))
        if self.deaf or (frame.arbitration_id == 0x7FF and self.deaf_to_registers):
            return
        if frame.arbitration_id == 0x7FF and data[2] != 0xCC:
            self.bus.arrive(MASTER, self.register(data))
            return
        if data == ENABLE and self.status == 0:
            self.status = 1
        elif data == CLEAR or (data == DISABLE and self.status == 1):
            self.status = 0
        self.bus.arrive(MASTER, self.feedback())

    def register(self, data: bytes) -> bytes:
        layout = "<I" if data[3] in INTEGERS else "<f"
        if data[2] == 0x55:
            (self.registers[data[3]],) = struct.unpack(layout, data[4:])
        return data[:4] + struct.pack(layout, self.registers[data[3]])

    def feedback(self) -> bytes:
        position = int((self.position_rad + P) * 65535 / (2 * P)) & 0xFFFF
        velocity = int((self.velocity_rad_s + V) * 4095 / (2 * V)) & 0xFFF
        torque = int((self.torque_nm + T) * 4095 / (2 * T)) & 0xFFF
        packed = position << 24 | velocity << 12 | torque
        return bytes((NODE | self.status << 4,)) + packed.to_bytes(5, "big") + bytes((41, 33))

    def commands(self) -> list[float]:
        """The torques that were commanded."""
        own = [data for identifier, data in self.frames if identifier == NODE and data[:7] != ENABLE[:7]]
        return [(int.from_bytes(data, "big") & 0xFFF) * 2 * T / 4095 - T for data in own]


@pytest.fixture
def motor(world):
    return ScriptedMotor(world)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_motor(motor, link, device):
    def opened(direction: int = 1, **options: object) -> Damiao:
        return open_amplifier(
            device("actuator", "damiao", direction=direction, **{"node": NODE, "master": MASTER, **options}), link
        )

    return opened


def wait(link, ms: int) -> None:
    for _ in range(ms):
        link.wait()


# ---- Who is there ---------------------------------------------------------------------------------------------------


def test_identity_and_ranges_come_from_the_motor(motor, open_motor):
    drive = open_motor()
    with pytest.raises(DeviceError, match="its ranges are not known before it is identified"):
        drive.command(0.0)
    identity = drive.identify()
    assert (identity.driver, identity.address, identity.firmware) == ("damiao", "can0 node 5", "5017")
    assert drive.position_resolution_rad == pytest.approx(2 * P / 65535)
    assert drive.command(3.0) == pytest.approx(3.0, abs=T / 4095 + 1e-9)
    assert ENABLE not in [data for _, data in motor.frames]


def test_nobody_there(motor, open_motor):
    motor.deaf = True
    with pytest.raises(DeviceTimeoutError, match=r"Damiao motor 5 on can0: does not answer.*MST_ID, 0x15"):
        open_motor().identify(timeout_s=0.1)


def test_one_that_tells_no_registers_may_be_in_plain_mit_mode(motor, open_motor):
    motor.deaf_to_registers = True
    with pytest.raises(DeviceTimeoutError, match=r'register CTRL_MODE \(10\) is read.*driver = "mit"'):
        open_motor().identify(timeout_s=0.1)


@pytest.mark.parametrize(
    ("register", "value", "words"),
    [
        (10, 2, r"in position-velocity mode \(CTRL_MODE, register 10, is 2\); set it to MIT, 1"),
        (10, 9, r"in an unknown mode"),
        (
            23,
            54.0,
            r'TMAX \(register 23\) is 54 N\*m, but the rig file says torque_range = "10 N\*m"; write torque_range',
        ),
        (21, 12.56637, r'PMAX .* is 12.5664 rad, but the rig file says position_range = "12.5 rad"'),
        (32, 100.0, r'V_BW \(register 32\) is 100 Hz, but the rig file says velocity_bandwidth = "40 Hz"'),
    ],
)
def test_what_is_set_otherwise_is_refused(motor, open_motor, register, value, words):
    motor.registers[register] = value
    drive = open_motor(position_range=P, velocity_range=V, torque_range=T)
    with pytest.raises(DeviceError, match=words):
        drive.identify()
    with pytest.raises(DeviceError, match=words):
        drive.enable()
    assert ENABLE not in [data for _, data in motor.frames]


def test_a_register_that_looks_like_feedback_is_taken_only_when_it_was_asked_for(motor, open_motor, link):
    drive = open_motor()
    drive.identify()
    motor.position_rad = (0x0033 + 0.5) * 2 * P / 65535 - P  # bytes 1 and 2 of a resting motor's feedback: 00 33
    wait(link, 30)
    assert drive.take_motion()[-1].position_rad == pytest.approx(motor.position_rad, abs=1e-6)


# ---- Enabling and stopping ------------------------------------------------------------------------------------------


def test_it_clears_arms_the_timeout_and_begins_at_zero(motor, open_motor):
    motor.status = 0xD
    drive = open_motor(watchdog=0.2)
    assert drive.identify()
    assert drive.status().errors == ("communication lost: no frame came for its timeout",)
    assert drive.status().state is DriveState.FAULT
    drive.enable()
    assert drive.status().state is DriveState.ENABLED
    assert motor.registers[9] == 4000
    sent = [data for _, data in motor.frames]
    assert sent.index(CLEAR) < sent.index(ENABLE)
    assert abs(motor.commands()[0]) <= T / 4095 + 1e-9
    assert drive.status().motor_temperature_c == 33
    assert drive.status().transistor_temperature_c == 41


def test_a_timeout_of_zero_is_left_alone(motor, open_motor):
    motor.registers[9] = 1234
    open_motor(watchdog=0.0).enable()
    assert motor.registers[9] == 1234


def test_one_that_stays_in_fault_is_not_enabled(motor, open_motor):
    drive = open_motor()
    drive.identify()
    motor.status = 0x9
    motor.bus.peer = lambda frame: motor.receive(frame) if bytes(frame.data) != CLEAR else None
    with pytest.raises(DeviceError, match="cannot be enabled: supply voltage too low"):
        drive.enable(timeout_s=0.2)


def test_a_stop_is_said_again_until_it_is_heard(motor, open_motor, link):
    drive = open_motor()
    drive.enable()
    motor.bus.peer = lambda _frame: None
    drive.stop()
    motor.bus.peer = motor.receive
    assert drive.status().state is DriveState.ENABLED
    wait(link, 50)
    assert motor.status == 0
    assert drive.status().state is DriveState.IDLE
    said = len([data for _, data in motor.frames if data == DISABLE])
    wait(link, 100)
    assert len([data for _, data in motor.frames if data == DISABLE]) == said  # from then on it is only asked


def test_the_watchdog_is_seen_without_feeding_it(motor, open_motor, link):
    drive = open_motor(watchdog=0.1)
    drive.enable()
    wait(link, 20)
    drive.provoke_watchdog()
    motor.frames.clear()
    wait(link, 50)
    assert drive.made_itself_safe() is False
    motor.status = 0xD
    wait(link, 20)
    assert drive.made_itself_safe() is True
    assert {identifier for identifier, _ in motor.frames} == {0x7FF}


# ---- Goals ----------------------------------------------------------------------------------------------------------


def test_goals_are_positions_with_gains(motor, open_motor):
    motor.registers[32] = 500.0
    drive = open_motor(mode="position", stiffness=20.0, damping=0.5, velocity_bandwidth=500.0)
    assert drive.command_unit == "rad"
    drive.enable()
    sent_rad = drive.command(0.5)
    number = int.from_bytes(motor.frames[-1][1], "big")
    assert (number >> 48) * 2 * P / 65535 - P == pytest.approx(sent_rad)
    assert (number >> 24 & 0xFFF, number >> 12 & 0xFFF) == (round(20 / 500 * 4095), round(0.5 / 5 * 4095))


def test_goals_are_velocities_with_a_gain(motor, open_motor):
    motor.registers[32] = 500.0
    drive = open_motor(mode="velocity", damping=0.5, velocity_bandwidth=500.0)
    assert drive.command_unit == "rad/s"
    drive.enable()
    sent_rad_s = drive.command(5.0)
    number = int.from_bytes(motor.frames[-1][1], "big")
    assert (number >> 24 & 0xFFF, number >> 12 & 0xFFF) == (0, round(0.5 / 5 * 4095))
    assert (number >> 36 & 0xFFF) * 2 * V / 4095 - V == pytest.approx(sent_rad_s, abs=0.5 * 2 * T / 4095 / 0.5)


def test_the_lag_of_its_velocity_is_that_of_two_positions_and_of_its_holding():
    stiff = {
        "node": 1,
        "master": 17,
        "mode": "position",
        "stiffness": 20.0,
        "damping": 0.5,
        "velocity_bandwidth": 500.0,
    }
    assert DamiaoOptions.model_validate(stiff).servo.window_s == pytest.approx(1e-3 + 0.95e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"node": 16}, r"node = 16: input should be less than or equal to 15"),
        ({"master": NODE}, r"master = 5: is the motor's own id"),
        ({"mode": "position"}, r'stiffness = None: mode = "position" needs it, at least 0.12'),
        ({"mode": "position", "stiffness": 501.0}, r"stiffness = 501.0: a frame carries no more than 500"),
        ({"mode": "velocity"}, r'damping = 0.0: mode = "velocity" needs it, at least 0.0012'),
        ({"damping": 6.0}, r"damping = 6.0: a frame carries no more than 5"),
        ({"damping": 0.5, "velocity_bandwidth": 40.0}, r'damping = 0.5: needs velocity_bandwidth = "500 Hz"'),
        ({"watchdog": 0.01}, r"watchdog = 0.01: shorter than a computer"),
    ],
)
def test_options_that_cannot_be(open_motor, options, words):
    with pytest.raises(WiringError, match=words):
        open_motor(**options)
