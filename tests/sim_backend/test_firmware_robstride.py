"""The emulated RobStride motor, spoken to with bytes made by hand and by packages that drive such motors."""

import math
import struct
from collections.abc import Callable

import can
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from robstride.client import Client, MotorError, MotorMode, RunMode

from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from tests.sim_backend.can_host import CanHost, opener

NODE, HOST = 9, 0xFD
T = 17.0  # of an RS01
GAIN_A_NM = 18.0  # of the simulated actuator
FRICTION_NM, STIFFNESS_NM_RAD = 0.04, 0.9  # of both machines; of a servo with that gain per radian


class Host(CanHost):
    extended = True

    def send(self, kind: int, data: bytes = bytes(8), extra: int = HOST) -> None:
        self.put(kind << 24 | extra << 8 | NODE, data)

    def ask(self, kind: int, data: bytes = bytes(8), extra: int = HOST) -> can.Message:
        self.heard()
        self.send(kind, data, extra)
        self.wait(1)
        (reply,) = self.heard()
        return reply

    def torque(self, torque_nm: float) -> can.Message:
        extra = round((torque_nm + T) * 65535 / (2 * T))
        return self.ask(1, bytes.fromhex("7FFF7FFF00000000"), extra)

    def hold(self, torque_nm: float, duration_ms: int) -> None:
        for _ in range(duration_ms // 10):
            self.torque(torque_nm)
            self.wait(9)

    def write(self, index: int, layout: str, value: float) -> can.Message:
        return self.ask(18, struct.pack("<HH", index, 0) + struct.pack(layout, value))

    def mode(self, reply: can.Message) -> int:
        return reply.arbitration_id >> 22 & 3


@pytest.fixture
def open_host(wiring: Wiring, open_bench: Callable[..., SimulatedBackend]) -> Callable[..., Host]:
    return opener(Host, open_bench, wiring, "robstride", {"node": NODE, "motor": "rs01"})


@pytest.fixture
def host(open_host: Callable[..., Host]) -> Host:
    return open_host()


def test_it_speaks_only_when_it_is_spoken_to(host: Host) -> None:
    host.wait(300)
    assert host.heard() == []
    for kind, mode in ((4, 0), (1, 0), (3, 2), (6, 2), (18, 2), (4, 0)):
        reply = host.ask(kind, extra=32768 if kind == 1 else HOST)
        assert reply.arbitration_id == 2 << 24 | mode << 22 | NODE << 8 | HOST
        assert reply.data[6:] == (250).to_bytes(2, "big")


def test_it_obeys_torques_while_it_runs(host: Host) -> None:
    host.hold(0.2, 50)
    assert host.current_a == 0
    host.ask(3)
    host.hold(0.1, 50)
    assert host.current_a == pytest.approx(0.1 * GAIN_A_NM, abs=2 * T / 65535 * GAIN_A_NM)
    reply = host.torque(0.1)
    assert int.from_bytes(reply.data[4:6], "big") == pytest.approx(
        (0.1 + T) * 65535 / (2 * T), abs=100
    )  # noise of 5 mA
    host.ask(4)
    host.wait(5)
    assert abs(host.current_a) < 1e-6


def test_currents_are_a_parameter(open_host: Callable[..., Host]) -> None:
    host = open_host(mode="current")
    host.write(0x7005, "<I", 3)
    host.ask(3)
    for _ in range(5):
        host.write(0x7006, "<f", 0.02)  # in the plant, whose amplifier has 18 A for a command of 1
        host.wait(10)
    assert host.current_a == pytest.approx(0.02 * GAIN_A_NM, rel=1e-3)


def test_told_a_velocity_it_pushes_a_jammed_shaft_until_it_is_stopped(open_host: Callable[..., Host]) -> None:
    """The plant's amplifier has GAIN_A_NM for an error of 1, here of 1 rad/s."""
    host = open_host(mode="velocity", damping=0.05)
    host.plant.jam("actuator")
    host.ask(3)
    goal = struct.pack(">HHHH", 32768, round((0.1 / 44.0 + 1) / 2 * 65535), 0, 655)  # of ± 44 rad/s, and of kd to 5
    for _ in range(5):
        host.ask(1, goal, 32768)
        host.wait(9)
    beside_rad_s = 0.5 * 2 * T / 65535 / 0.05
    assert host.current_a == pytest.approx(GAIN_A_NM * (0.1 + beside_rad_s), rel=0.02)
    host.ask(4)
    host.wait(20)
    assert host.current_a == pytest.approx(0.0, abs=1e-3)


def test_as_a_servo_it_holds_its_goal_until_it_is_stopped(open_host: Callable[..., Host]) -> None:
    host = open_host(mode="position", stiffness=2.0, damping=0.05)
    host.ask(3)
    goal = struct.pack(">HHHH", round((0.3 / (4 * math.pi) + 1) / 2 * 65535), 32768, round(2 / 500 * 65535), 655)
    for _ in range(40):
        host.ask(1, goal, 32768)
        host.wait(9)
    assert host.plant.encoder_position_rad("actuator") == pytest.approx(0.3, abs=FRICTION_NM / STIFFNESS_NM_RAD)
    host.ask(4)
    host.wait(20)
    assert host.current_a == pytest.approx(0.0, abs=1e-3)


def test_the_timeout_resets_it(host: Host) -> None:
    host.write(0x7028, "<I", 2000)  # 100 ms
    host.ask(3)
    host.hold(0.1, 300)
    host.wait(80)
    assert host.firmware.armed
    host.wait(25)
    assert not host.firmware.armed
    assert abs(host.current_a) < 1e-6
    assert host.mode(host.torque(0.0)) == 0
    assert host.mode(host.ask(3)) == 2


def test_a_cybergear_takes_no_timeout(open_host: Callable[..., Host]) -> None:
    host = open_host(motor="cybergear")
    host.write(0x7028, "<I", 2000)
    host.ask(3)
    host.wait(1000)
    assert host.firmware.armed


@pytest.mark.parametrize(
    ("fault", "bit", "detail"),
    [(DriveFault.FAULT, 17, 1), (DriveFault.UNDERVOLTAGE, 16, 2), (DriveFault.OVER_TEMPERATURE, 18, 0)],
)
def test_a_fault_is_told_at_once_and_until_it_is_cleared(host: Host, fault: DriveFault, bit: int, detail: int) -> None:
    host.ask(3)
    host.hold(0.1, 50)
    host.heard()
    host.firmware.break_down(fault)
    host.wait(1)
    (told,) = host.heard()
    assert told.arbitration_id == 21 << 24 | NODE << 8 | HOST
    assert told.data == (1 << detail).to_bytes(4, "little") + bytes(4)
    reply = host.ask(3)
    assert reply.arbitration_id >> bit & 1
    assert host.mode(reply) == 0
    assert host.ask(4, b"\1" + bytes(7)).arbitration_id >> 16 & 0xFF == 0
    assert host.mode(host.ask(3)) == 2


def test_parameters(host: Host) -> None:
    reply = host.ask(17, struct.pack("<HHI", 0x700B, 0, 0))
    assert (reply.arbitration_id, bytes(reply.data)) == (17 << 24 | NODE << 8 | HOST, struct.pack("<HHf", 0x700B, 0, T))
    assert host.ask(17, struct.pack("<HHI", 0x1003, 0, 0)).arbitration_id == 17 << 24 | 1 << 16 | NODE << 8 | HOST
    host.ask(3)
    host.write(0x7005, "<I", 3)  # while it runs its mode stays
    assert host.ask(17, struct.pack("<HHI", 0x7005, 0, 0)).data[4] == 0


def test_the_version(host: Host) -> None:
    assert bytes(host.ask(4, bytes.fromhex("00C4000000000000")).data[:3]) == bytes.fromhex("00C456")


@pytest.mark.parametrize(("beyond", "wrapped"), [("wraps", True), ("saturates", False)])
def test_its_position_beyond_the_range(open_host: Callable[..., Host], beyond: str, wrapped: bool) -> None:
    host = open_host(beyond_range=beyond)
    host.ask(3)
    host.hold(0.1, 900)
    position_rad = host.plant.encoder_position_rad("actuator")
    assert position_rad > 15.0
    code = int.from_bytes(host.torque(0.0).data[:2], "big")
    expected = int((position_rad + 12.566370614) * 65535 / 25.132741229) % 65536
    assert (abs(code - expected) < 500) if wrapped else code == 65535


def test_a_third_partys_host_reads_enables_drives_and_stops_it(host: Host) -> None:
    """robstride, whose model 1 is an RS01."""

    class Bus:
        def send(self, frame: can.Message) -> None:
            host.heard()
            host.bus.send(frame)

        def recv(self, _timeout: float) -> can.Message:
            host.wait(1)
            return host.heard()[0]

    client = Client(Bus())
    assert client.read_param(NODE, "limit_torque") == T
    assert client.read_param(NODE, "run_mode") is RunMode.Operation
    assert client.write_param(NODE, "run_mode", RunMode.Current).errors == []
    assert client.read_param(NODE, "run_mode") is RunMode.Current
    client.write_param(NODE, "run_mode", RunMode.Operation)
    assert client.enable(NODE).errors == []
    assert host.firmware.armed
    host.hold(0.1, 100)
    told = client.write_param(NODE, "cur_kp", 1.0)  # no such parameter here: it only answers
    assert told.torque == pytest.approx(0.1, abs=0.01)
    assert told.velocity == pytest.approx(host.plant.encoder_velocity_rad_s("actuator"), abs=1.0)
    assert told.temp == 25.0
    assert client.disable(NODE).mode is MotorMode.Reset
    host.firmware.break_down(DriveFault.UNDERVOLTAGE)
    host.wait(2)
    assert client.disable(NODE).errors == [MotorError.Undervoltage]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100)
@given(data=st.binary(max_size=8), kind=st.integers(0, 31), extra=st.integers(0, 65535))
def test_no_frame_makes_it_stumble(host: Host, data: bytes, kind: int, extra: int) -> None:
    host.send(kind, data, extra)
    host.wait(0.5)
    host.heard()
