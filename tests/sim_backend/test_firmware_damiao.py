"""The emulated Damiao motor, spoken to with bytes made by hand and by a package that drives such motors."""

import struct
from collections.abc import Callable
from math import exp
from types import SimpleNamespace

import pytest
from damiao_motor.core.motor import DaMiaoMotor
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from tests.sim_backend.can_host import CanHost, opener

NODE, MASTER = 3, 0x13
P, V, T = 12.5, 50.0, 2.0
ENABLE, DISABLE, ZERO, CLEAR = (bytes.fromhex("FF" * 7) + bytes((last,)) for last in (0xFC, 0xFD, 0xFE, 0xFB))
GAIN_A_NM = 18.0  # of the simulated actuator
FRICTION_NM, STIFFNESS_NM_RAD = 0.04, 0.9  # of both machines; of a servo with that gain per radian
OPTIONS = {"node": NODE, "master": MASTER, "position_range": P, "velocity_range": V, "torque_range": T,
           "velocity_bandwidth": 500.0}  # fmt: skip


def command(torque_nm: float) -> bytes:
    torque = round((torque_nm + T) * 4095 / (2 * T))
    return (32767 << 48 | 2047 << 36 | torque).to_bytes(8, "big")


class Host(CanHost):
    extended = False

    def send(self, data: bytes, identifier: int = NODE) -> None:
        self.put(identifier, data)

    def replies(self) -> list[bytes]:
        return [bytes(each.data) for each in self.heard() if each.arbitration_id == MASTER]

    def ask(self, data: bytes, identifier: int = NODE) -> bytes:
        self.replies()
        self.send(data, identifier)
        self.wait(1)
        (reply,) = self.replies()
        return reply

    def register(self, operation: int, register: int, value: bytes = bytes(4)) -> bytes:
        return self.ask(bytes((NODE, 0, operation, register)) + value, 0x7FF)

    def status(self) -> int:
        return self.register(0xCC, 0)[0] >> 4

    def hold(self, torque_nm: float, duration_ms: int) -> None:
        for _ in range(duration_ms // 10):
            self.send(command(torque_nm))
            self.wait(10)


@pytest.fixture
def open_host(wiring: Wiring, open_bench: Callable[..., SimulatedBackend]) -> Callable[..., Host]:
    return opener(Host, open_bench, wiring, "damiao", OPTIONS)


@pytest.fixture
def host(open_host: Callable[..., Host]) -> Host:
    return open_host()


def torque_code(reply: bytes) -> int:
    return (reply[4] & 0xF) << 8 | reply[5]


def test_it_speaks_only_when_it_is_spoken_to(host: Host) -> None:
    host.wait(300)
    assert host.replies() == []
    for data, status in ((DISABLE, 0), (command(0.0), 0), (ENABLE, 1), (bytes(3), 1), (DISABLE, 0)):
        reply = host.ask(data)
        assert (len(reply), reply[0], *reply[6:]) == (8, NODE | status << 4, 25, 25)


def test_it_begins_with_the_command_that_was_kept_and_forgets_it_when_it_is_disabled(host: Host) -> None:
    host.send(command(0.15))
    host.send(ENABLE)
    host.wait(15)
    assert host.current_a == pytest.approx(0.15 * GAIN_A_NM, rel=0.02)
    host.send(DISABLE)
    host.wait(15)
    host.send(ENABLE)
    host.wait(15)
    assert abs(host.current_a) < 1e-6
    assert host.firmware.armed


def test_the_answer_tells_the_torque_before_its_command(host: Host) -> None:
    host.send(ENABLE)
    host.hold(0.1, 50)
    assert torque_code(host.ask(command(-0.1))) == pytest.approx((0.1 + T) * 4095 / (2 * T), abs=2)
    host.wait(15)
    assert torque_code(host.ask(command(-0.1))) == pytest.approx((-0.1 + T) * 4095 / (2 * T), abs=2)


def test_its_readings_are_filtered(open_host: Callable[..., Host]) -> None:
    """As delivered with 40 Hz: a step of torque is seen 4 ms late."""
    host = open_host(velocity_bandwidth=40.0)
    host.plant.jam("actuator")
    host.send(ENABLE)
    host.send(command(1.0))
    host.wait(10)
    seen_nm = torque_code(host.ask(bytes((NODE, 0, 0xCC, 0, 0, 0, 0, 0)), 0x7FF)) * 2 * T / 4095 - T
    assert 0.5 * (1 - exp(-2.0)) < seen_nm < 0.95


def test_the_timeout_lets_go_and_is_told_until_it_is_cleared(host: Host) -> None:
    assert host.register(0x55, 9, struct.pack("<I", 2000))[4:] == struct.pack("<I", 2000)  # 100 ms
    host.send(ENABLE)
    host.hold(0.1, 300)
    assert host.status() == 1
    for _ in range(8):  # questions to 0x7FF feed nothing
        host.wait(10)
        assert host.status() == 1
    host.wait(20)
    assert host.status() == 0xD
    assert abs(host.current_a) < 1e-6
    assert not host.firmware.armed
    for data in (ENABLE, DISABLE, command(0.1)):
        assert host.ask(data)[0] >> 4 == 0xD
    assert host.ask(CLEAR)[0] >> 4 == 0
    assert host.ask(ENABLE)[0] >> 4 == 1


def test_without_a_timeout_it_goes_on(host: Host) -> None:
    host.send(ENABLE)
    host.send(command(0.05))
    host.wait(2000)
    assert host.current_a == pytest.approx(0.05 * GAIN_A_NM, rel=0.02)


@pytest.mark.parametrize(
    ("fault", "status"), [(DriveFault.FAULT, 0xA), (DriveFault.UNDERVOLTAGE, 9), (DriveFault.OVER_TEMPERATURE, 0xB)]
)
def test_a_fault_lets_go(host: Host, fault: DriveFault, status: int) -> None:
    host.send(ENABLE)
    host.hold(0.1, 50)
    host.firmware.break_down(fault)
    host.wait(10)
    assert abs(host.current_a) < 1e-6
    assert host.ask(ENABLE)[0] >> 4 == status


def test_zero_and_freezing(host: Host) -> None:
    host.send(ENABLE)
    host.hold(0.1, 300)
    host.ask(ZERO)
    before = host.ask(command(0.1))
    assert abs((before[1] << 8 | before[2]) - 32767) < 32767 / P
    host.firmware.freeze()
    frozen = host.ask(command(0.1))[1:4]
    host.hold(0.1, 50)
    assert host.ask(command(0.1))[1:4] == frozen


def test_a_mode_that_is_not_mit_obeys_no_torque_but_answers(host: Host) -> None:
    host.register(0x55, 10, struct.pack("<I", 2))
    host.send(ENABLE)
    host.hold(0.1, 50)
    assert host.ask(command(0.1))[0] >> 4 == 1
    assert abs(host.current_a) < 1e-6


def test_told_a_velocity_it_pushes_a_jammed_shaft_until_it_is_disabled(open_host: Callable[..., Host]) -> None:
    """The plant's amplifier has 18 A for an error of 1, here of 1 rad/s."""
    host = open_host(mode="velocity", damping=0.05)
    host.plant.jam("actuator")
    kd = round(0.05 / 5 * 4095)
    host.send(ENABLE)
    for _ in range(5):
        host.send((32768 << 48 | 2051 << 36 | kd << 12 | 2048).to_bytes(8, "big"))
        host.wait(10)
    error_rad_s = (2051 * 2 * V / 4095 - V) + (2048 * 2 * T / 4095 - T) / (kd * 5 / 4095)
    assert host.current_a == pytest.approx(18.0 * error_rad_s, rel=0.01)
    host.send(DISABLE)
    host.wait(20)
    assert host.current_a == pytest.approx(0.0, abs=1e-3)


def test_as_a_servo_it_holds_its_goal_until_it_is_disabled(open_host: Callable[..., Host]) -> None:
    host = open_host(mode="position", stiffness=2.0, damping=0.05)
    position, kp, kd = round((0.3 + P) / (2 * P) * 65535), round(2 / 500 * 4095), round(0.05 / 5 * 4095)
    host.send(ENABLE)
    for _ in range(40):
        host.send((position << 48 | 2048 << 36 | kp << 24 | kd << 12 | 2048).to_bytes(8, "big"))
        host.wait(10)
    assert host.plant.encoder_position_rad("actuator") == pytest.approx(0.3, abs=FRICTION_NM / STIFFNESS_NM_RAD)
    host.send(DISABLE)
    host.wait(20)
    assert host.current_a == pytest.approx(0.0, abs=1e-3)


def test_registers(host: Host) -> None:
    assert host.register(0x33, 23) == bytes((NODE, 0, 0x33, 23)) + struct.pack("<f", T)
    assert host.register(0x33, 8)[4:] == struct.pack("<I", NODE)
    host.register(0x55, 23, struct.pack("<f", 20.0))
    assert torque_code(host.ask(DISABLE)) == pytest.approx(2047, abs=1)
    host.send(bytes((NODE, 0, 0x33, 77, 0, 0, 0, 0)), 0x7FF)  # none
    host.send(bytes((NODE + 1, 0, 0x33, 23, 0, 0, 0, 0)), 0x7FF)  # another motor's
    host.wait(2)
    assert host.replies() == []


def test_a_third_partys_host_reads_enables_drives_and_loses_it(host: Host) -> None:
    """damiao-motor, on our bus: its thread that polls is done by hand."""
    motor = DaMiaoMotor(
        NODE, MASTER, host.bus, motor_type="4310", p_max=P, p_min=-P, v_max=V, v_min=-V, t_max=T, t_min=-T
    )

    def polled(ms: float = 2) -> None:
        host.wait(ms)
        for reply in host.replies():
            motor.process_feedback_frame(reply, MASTER)

    for register in (10, 21, 22, 23):
        motor.request_register_reading(register)
        polled()
    assert [motor.registers[register] for register in (10, 21, 22, 23)] == [1, P, V, T]
    motor._controller = SimpleNamespace()  # it has been told: nothing waits
    motor.ensure_control_mode("MIT")
    motor.set_can_timeout(50)
    motor.enable()
    for _ in range(8):
        polled(10)
        motor.send_cmd_mit(feedforward_torque=0.05)
    polled()
    assert motor.get_states()["status"] == "ENABLED"
    assert host.current_a == pytest.approx(0.05 * GAIN_A_NM, abs=2 * T / 4095 * GAIN_A_NM)
    assert motor.get_states()["torq"] == pytest.approx(0.05, abs=0.005)
    assert motor.get_states()["vel"] == pytest.approx(host.plant.encoder_velocity_rad_s("actuator"), abs=1.0)
    polled(100)
    motor.request_motor_feedback()
    polled()
    assert motor.get_states()["status"] == "LOST_COMM"
    motor.clear_error()
    motor.disable()
    polled()
    assert motor.get_states()["status"] == "DISABLED"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100)
@given(data=st.binary(max_size=8), identifier=st.sampled_from([NODE, 0x100 + NODE, 0x7FF]))
def test_no_frame_makes_it_stumble(host: Host, data: bytes, identifier: int) -> None:
    host.send(data, identifier)
    host.wait(0.5)
    host.replies()
