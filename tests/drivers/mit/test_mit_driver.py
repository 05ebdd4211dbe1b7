"""The MIT mode driver against a scripted motor, whose bytes are packed by hand from the firmware's can.c."""

import math
import random

import can
import pytest

from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError
from norton_drivers.mit import MitActuator, open_amplifier
from norton_drivers.readings import DriveState

NODE, MASTER = 5, 0
P, V, T = 12.5, 50.0, 18.0
ENABLE, DISABLE = (bytes.fromhex("FF" * 7) + bytes((last,)) for last in (0xFC, 0xFD))
MS = 1_000_000
STEP_NM = 2 * T / 4095


class ScriptedMotor:
    """Answers every frame with the state before it; codes are cut off and wrap, as in the firmware."""

    def __init__(self, world) -> None:
        self.bus, self.clock = world.bus, world.clock
        self.position_rad = self.velocity_rad_s = self.torque_nm = 0.0
        self.node, self.reply_id = NODE, MASTER
        self.tail = b""  # temperature and error
        self.deaf = self.saturates = False
        self.enabled = False
        self.frames: list[bytes] = []
        self.frame_ns: list[int] = []
        self.on_command = lambda _torque_nm: None
        world.bus.peer = self.receive

    def receive(self, frame: can.Message) -> None:
        assert not frame.is_extended_id
        assert frame.arbitration_id == NODE
        self.frames.append(bytes(frame.data))
        self.frame_ns.append(self.clock.ns)
        if self.deaf:
            return
        self.bus.arrive(self.reply_id, self.reply())
        if frame.data == ENABLE:
            self.enabled = True
        elif frame.data == DISABLE:
            self.enabled = False
        else:
            self.on_command(commanded(bytes(frame.data)))

    def reply(self) -> bytes:
        position = int((self.position_rad + P) * 65535 / (2 * P))
        if self.saturates:
            position = min(max(position, 0), 65535)
        velocity = int((self.velocity_rad_s + V) * 4095 / (2 * V)) & 0xFFF
        torque = int((self.torque_nm + T) * 4095 / (2 * T)) & 0xFFF
        head = bytes((self.node, position >> 8 & 0xFF, position & 0xFF, velocity >> 4))
        return head + bytes(((velocity & 0xF) << 4 | torque >> 8, torque & 0xFF)) + self.tail


def commanded(data: bytes) -> float:
    """unpack_cmd: the torque is the last twelve bits."""
    return (int.from_bytes(data, "big") & 0xFFF) * STEP_NM - T


@pytest.fixture
def motor(world):
    return ScriptedMotor(world)


@pytest.fixture
def link(world):
    return world.link()


@pytest.fixture
def open_motor(motor, link, device):
    def opened(direction: int = 1, **options: object) -> MitActuator:
        ranges = {"node": NODE, "position_range": P, "velocity_range": V, "torque_range": T}
        return open_amplifier(device("actuator", "mit", direction=direction, **{**ranges, **options}), link)

    return opened


def wait(link, ms: int = 20) -> None:
    for _ in range(ms):
        link.wait()


# ---- who is there ---------------------------------------------------------------------------------------------------


def test_identity_without_ever_enabling(motor, open_motor):
    identity = open_motor().identify()
    assert (identity.driver, identity.address) == ("mit", "can0 node 5")
    assert set(motor.frames) == {DISABLE}


def test_nobody_there(motor, open_motor):
    motor.deaf = True
    with pytest.raises(DeviceTimeoutError, match=r"\[actuator\] MIT motor 5 on can0: does not answer.*MIT mode.*0x0\)"):
        open_motor().identify(timeout_s=0.1)


@pytest.mark.parametrize(
    ("harm", "heard"), [({"node": 9}, "heard node 9 with id 0x0"), ({"reply_id": 0x11}, "heard node 5 with id 0x11")]
)
def test_who_answers_instead_is_told(motor, open_motor, harm, heard):
    for name, value in harm.items():
        setattr(motor, name, value)
    with pytest.raises(DeviceTimeoutError, match=heard):
        open_motor().identify(timeout_s=0.1)


def test_replies_of_another_length_are_counted(motor, open_motor):
    motor.tail = bytes(3)
    amplifier = open_motor()
    with pytest.raises(DeviceTimeoutError):
        amplifier.identify(timeout_s=0.1)
    assert amplifier.malformed >= 9


@pytest.mark.parametrize("tail", [b"", b"\x1e", b"\x1e\x00"])
def test_replies_of_six_seven_and_eight_bytes(motor, link, open_motor, tail):
    motor.tail = tail
    amplifier = open_motor(temperature_offset=-10)
    amplifier.identify()
    celsius = amplifier.status().motor_temperature_c
    assert celsius == 20 if tail else math.isnan(celsius)


# ---- asked, enabled, stopped ----------------------------------------------------------------------------------------


def test_it_is_asked_a_hundred_times_a_second_until_it_is_enabled(motor, link, open_motor):
    amplifier = open_motor()
    wait(link, 1000)
    assert len(motor.frames) == pytest.approx(100, abs=1)
    assert set(motor.frames) == {DISABLE}
    assert len(amplifier.take_motion()) == pytest.approx(100, abs=1)
    assert amplifier.status().state is DriveState.IDLE


def test_enabling_leaves_a_command_of_zero_first(motor, link, open_motor):
    amplifier = open_motor()
    amplifier.enable()
    assert motor.enabled
    assert amplifier.status().state is DriveState.ENABLED
    before = motor.frames[: motor.frames.index(ENABLE)]
    assert DISABLE in before
    # The nearest to zero that there is; the drive would begin with whatever it had been commanded last.
    assert abs(commanded(before[-1])) == pytest.approx(0.5 * STEP_NM)
    count = len(motor.frames)
    wait(link, 50)
    assert len(motor.frames) == count  # nobody asks while commands do


def test_a_motor_that_answers_no_more_is_not_enabled(world, motor, open_motor):
    amplifier = open_motor()
    amplifier.identify()
    motor.deaf = True
    with pytest.raises(DeviceTimeoutError, match="does not answer"):
        amplifier.enable(timeout_s=0.1)
    assert ENABLE not in motor.frames


def test_a_motor_in_error_is_not_enabled(motor, open_motor):
    motor.tail = b"\x1e\x04"
    with pytest.raises(DeviceError, match="cannot be enabled: supply voltage too low"):
        open_motor().enable()
    assert ENABLE not in motor.frames


def test_an_error_shows_with_the_next_reply_and_stays(motor, link, open_motor):
    amplifier = open_motor()
    amplifier.enable()
    motor.tail = b"\x1e\x05"
    amplifier.command(0.0)
    link.wait()
    assert (amplifier.status().state, amplifier.status().errors) == (DriveState.FAULT, ("encoder fault",))
    motor.tail = b"\x1e\x00"
    amplifier.command(0.0)
    link.wait()
    assert amplifier.status().state is DriveState.FAULT
    amplifier.enable()
    assert amplifier.status().state is DriveState.ENABLED


def test_silence_is_a_lost_heartbeat(world, motor, link, open_motor):
    amplifier = open_motor()
    amplifier.enable()
    motor.deaf = True
    for _ in range(200):
        amplifier.command(0.0)
        link.wait()
    assert world.clock.ns - amplifier.status().heartbeat_ns > amplifier.heartbeat_timeout_ns


def test_stopping_is_repeated_until_it_is_heard(motor, link, open_motor):
    amplifier = open_motor()
    amplifier.enable()
    motor.deaf = True
    amplifier.stop()
    assert abs(commanded(motor.frames[-2])) == pytest.approx(0.5 * STEP_NM)
    assert motor.frames[-1] == DISABLE
    wait(link, 30)
    assert amplifier.status().state is DriveState.ENABLED  # for all that is known
    motor.deaf = False
    wait(link, 40)
    assert not motor.enabled
    assert amplifier.status().state is DriveState.IDLE


def test_a_lost_bus_does_not_keep_it_from_stopping(world, open_motor):
    amplifier = open_motor()
    world.bus.broken = True
    amplifier.stop()
    with pytest.raises(ConnectionFailedError, match="can0"):
        amplifier.command(0.0)


# ---- commands and readings ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("value", [0.0, 0.5, -3.21, 17.9, 1e9])
def test_a_command_is_the_nearest_that_can_be_sent_and_is_said_to_be(motor, open_motor, direction, value):
    amplifier = open_motor(direction)
    carried = amplifier.command(value)
    assert direction * commanded(motor.frames[-1]) == pytest.approx(carried, abs=1e-9)
    assert carried == pytest.approx(min(value, T), abs=0.5 * STEP_NM + 1e-9)
    # Both gains are zero, so the position and velocity in it say nothing.
    assert int.from_bytes(motor.frames[-1], "big") >> 12 & 0xFFFFFF == 0


def test_what_is_no_number_is_never_sent(motor, open_motor):
    amplifier = open_motor()
    with pytest.raises(DeviceError, match="cannot command nan N\\*m"):
        amplifier.command(math.nan)
    assert motor.frames == []


@pytest.mark.parametrize("direction", [1, -1])
def test_signs_and_units(motor, link, open_motor, direction):
    amplifier = open_motor(direction, torque_constant=0.1)
    motor.position_rad, motor.velocity_rad_s, motor.torque_nm = 3.0, -20.0, 1.5
    link.wait()
    (motion,), (current,) = amplifier.take_motion(), amplifier.take_current()
    assert motion.position_rad == pytest.approx(direction * 3.0, abs=P / 65535)
    assert motion.velocity_rad_s == pytest.approx(-direction * 20.0, abs=V / 4095)
    assert current.current_a == pytest.approx(direction * 15.0, abs=T / 4095 / 0.1)
    assert amplifier.position_resolution_rad == pytest.approx(2 * P / 65535)


def test_no_current_without_the_torque_constant(motor, link, open_motor):
    amplifier = open_motor()
    wait(link)
    assert amplifier.take_current() == []


def turn(motor, amplifier, link, speed_rad_s: float, duration_s: float) -> list:
    motor.velocity_rad_s, readings = speed_rad_s, []
    for _ in range(round(duration_s * 1000)):
        motor.position_rad += speed_rad_s * 1e-3
        amplifier.command(0.0)
        link.wait()
        readings += amplifier.take_motion()
    return readings


@pytest.mark.parametrize("speed_rad_s", [45.0, -45.0])
def test_a_position_that_wraps_is_followed(motor, link, open_motor, speed_rad_s):
    amplifier = open_motor(beyond_range="wraps")
    amplifier.enable()
    amplifier.take_motion()
    readings = turn(motor, amplifier, link, speed_rad_s, 3.0)
    travel = readings[-1].position_rad - readings[0].position_rad
    # C casts towards zero: below the range the first code is twice as wide.
    assert travel == pytest.approx(speed_rad_s * 2.999, abs=2 * 2 * P / 65535)
    assert amplifier.status().state is DriveState.ENABLED


@pytest.mark.parametrize("saturates", [True, False])
def test_a_position_at_the_end_of_its_range_is_a_fault_and_no_reading(motor, link, open_motor, saturates):
    """Whatever the drive does there: the rig does not say that it wraps."""
    amplifier = open_motor()
    motor.saturates = saturates
    amplifier.enable()
    readings = turn(motor, amplifier, link, 40.0, 0.5)
    assert all(abs(reading.position_rad) <= P for reading in readings)
    assert readings[-1].position_rad > 12.4
    status = amplifier.status()
    assert status.state is DriveState.FAULT
    assert "the position is at the end of its range of ±12.5 rad; limit [limits] position" in status.errors[0]
    if saturates:
        with pytest.raises(DeviceError, match="cannot be enabled: the position is at the end"):
            amplifier.enable()


def test_a_drive_that_saturates_though_the_rig_says_that_it_wraps(motor, link, open_motor):
    amplifier = open_motor(beyond_range="wraps")
    motor.saturates = True
    amplifier.enable()
    turn(motor, amplifier, link, 40.0, 0.5)
    assert 'set beyond_range = "saturates"' in amplifier.status().errors[0]


def test_a_velocity_beyond_its_range_is_a_fault(motor, link, open_motor):
    amplifier = open_motor(beyond_range="wraps")
    amplifier.enable()
    turn(motor, amplifier, link, 49.0, 0.1)
    turn(motor, amplifier, link, 51.0, 0.1)
    assert "the velocity left its range of ±50 rad/s" in amplifier.status().errors[0]


def test_two_motors_share_the_masters_id(world, link, device, motor):
    """One reply id, told apart by the first byte."""
    ranges = {"position_range": P, "velocity_range": V, "torque_range": T}
    mine = open_amplifier(device("actuator", "mit", node=NODE, **ranges), link)
    world.bus.peer = lambda frame: motor.receive(frame) if frame.arbitration_id == NODE else None
    other = open_amplifier(device("load", "mit", node=NODE + 1, **ranges), link)
    motor.position_rad = 2.0
    wait(link)
    assert mine.take_motion()[-1].position_rad == pytest.approx(2.0, abs=P / 65535)
    assert other.take_motion() == []
    assert other.status().state is DriveState.UNKNOWN
    assert mine.malformed == other.malformed == 0


def test_a_hundred_thousand_frames_of_rubbish(world, link, open_motor):
    amplifier = open_motor(torque_constant=0.1, beyond_range="wraps")
    world.bus.peer = lambda _frame: None
    rng = random.Random(7)
    for _ in range(100):
        for _ in range(1000):
            data = rng.choice([bytes((NODE,)), b""]) + rng.randbytes(rng.randrange(8))
            world.bus.arrive(rng.choice([MASTER, NODE, 0x7FF]), data, extended=rng.random() < 0.1)
        link.poll()
        amplifier.take_motion(), amplifier.take_current(), amplifier.status()
    assert amplifier.malformed > 1000


# ---- the timeout ----------------------------------------------------------------------------------------------------


def test_a_timeout_that_is_not_probed_cannot_be_shown(motor, link, open_motor):
    amplifier = open_motor(watchdog=0.2)
    amplifier.enable()
    amplifier.provoke_watchdog()
    wait(link, 500)
    assert amplifier.made_itself_safe() is None
    assert amplifier.watchdog_s == 0.2
    assert open_motor().watchdog_s == 0.0


@pytest.mark.parametrize("works", [True, False])
def test_the_probes_torque_shows_the_timeout_at_work(world, motor, link, open_motor, works):
    amplifier = open_motor(watchdog=0.2, watchdog_probe=0.1)
    amplifier.enable()
    motor.on_command = lambda torque_nm: setattr(motor, "torque_nm", torque_nm)
    amplifier.provoke_watchdog()
    started_ns, count = world.clock.ns, len(motor.frames)
    assert commanded(motor.frames[-1]) == pytest.approx(0.1, abs=STEP_NM)
    wait(link, 150)
    assert amplifier.made_itself_safe() is False
    if works:
        motor.torque_nm = 0.0
    wait(link, 300)
    assert amplifier.made_itself_safe() is works
    # Looked at with a frame that is no command: once when it flows, and not before it should have ended.
    assert set(motor.frames[count:]) == {ENABLE}
    early = [ns for ns in motor.frame_ns[count:] if ns < started_ns + 200 * MS]
    assert 1 <= len(early) <= 2
    amplifier.command(0.0)
    count = len(motor.frames)
    wait(link, 50)
    assert len(motor.frames) == count


# ---- options --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("missing", ["position_range", "velocity_range", "torque_range"])
def test_the_ranges_must_be_given(link, device, missing):
    options = {"node": 1, "position_range": P, "velocity_range": V, "torque_range": T}
    del options[missing]
    with pytest.raises(WiringError, match=f'driver = "mit" needs {missing}: .* from minus to plus this'):
        open_amplifier(device("actuator", "mit", **options), link)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"node": 256}, "node = 256"),
        ({"torque_range": 0.0}, "torque_range"),
        ({"beyond_range": "stops"}, "beyond_range = 'stops'"),
        ({"watchdog_probe": 0.01}, r"at least 0\.07 N\*m"),
        ({"master": 0x800}, "master"),
    ],
)
def test_wrong_options_are_told(open_motor, options, words):
    with pytest.raises(WiringError, match=words):
        open_motor(**options)
