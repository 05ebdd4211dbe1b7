"""The emulated VESC, held against its firmware's source: raw frames in, raw frames out."""

import struct
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import sqrt, tau
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from TMotorCANControl import servo_can

from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from tests.sim_backend.can_host import CanHost

NODE, HOST = 23, 254
POLE_PAIRS = 7
SET_DUTY, SET_CURRENT, SHORT, STATUS, STATUS_4, PING, PONG, STATUS_5 = 0, 1, 8, 9, 16, 17, 18, 27
LAYOUTS = {STATUS: ">ihh", STATUS_4: ">hhhh", STATUS_5: ">ihh"}
ASK_FAULT = bytes.fromhex("3200008000")
OPTIONS = {"node": NODE, "pole_pairs": POLE_PAIRS, "minimum_current": 0.05, "watchdog": 1.0}


class Host(CanHost):
    """Speaks to the actuator's drive in raw frames."""

    extended = True

    def send(self, packet: int, data: bytes, node: int = NODE) -> None:
        self.put(packet << 8 | node, data)

    def current(self, milliamperes: int) -> None:
        self.send(SET_CURRENT, struct.pack(">i", milliamperes))

    def hold(self, milliamperes: int, duration_ms: int) -> None:
        """Command the same again and again, as a host must."""
        for _ in range(duration_ms // 10):
            self.current(milliamperes)
            self.wait(10)

    def received(self, packet: int, node: int = NODE) -> list[bytes]:
        """What came under one identifier since the last call; the rest is dropped."""
        return [bytes(each.data) for each in self.heard() if each.arbitration_id == packet << 8 | node]

    def status(self, packet: int = STATUS) -> tuple[int, ...]:
        """The newest status message's integers."""
        self.received(packet)
        self.wait(2 if packet != STATUS_5 else 110)
        return struct.unpack(LAYOUTS[packet], self.received(packet)[-1])

    def fault(self) -> int:
        self.received(SHORT, HOST)
        self.send(SHORT, bytes((HOST, 0)) + ASK_FAULT)
        self.wait(2)
        (answer,) = self.received(SHORT, HOST)
        assert answer[:-1] == bytes((NODE, 1)) + ASK_FAULT
        return answer[-1]


OpenHost = Callable[..., Host]


@pytest.fixture
def open_host(wiring: Wiring, simulated: dict[str, Any], open_bench: Callable[..., SimulatedBackend]) -> OpenHost:
    def opened(gain: str = "1 A/A", unit: str = "A", **options: object) -> Host:
        actuator = DeviceSettings("actuator", "vesc", bus="can0", options={**OPTIONS, **options})
        truth = {**simulated["actuator"], "amplifier_gain": gain}
        with_vesc = replace(wiring, actuator=actuator, command_unit=unit)
        return Host(open_bench(with_vesc, actuator=truth), with_vesc)

    return opened


@pytest.fixture
def host(open_host: OpenHost) -> Host:
    return open_host()


def test_status_messages_come_at_their_rates(host: Host) -> None:
    for packet, rate_hz in ((STATUS, 1000), (STATUS_4, 1000), (STATUS_5, 10)):
        host.received(packet)
        host.wait(1000)
        assert abs(len(host.received(packet)) - rate_hz) <= 1


def test_with_the_tachometer_wanted_it_comes_as_often(open_host: OpenHost) -> None:
    host = open_host(position="tachometer")
    host.received(STATUS_5)
    host.wait(500)
    assert len(host.received(STATUS_5)) >= 499


def test_it_drives_at_once_and_lets_go_below_its_minimum_current(host: Host) -> None:
    host.hold(2000, 50)
    assert host.current_a == pytest.approx(2.0, rel=1e-3)
    assert host.firmware.armed
    host.current(49)
    host.wait(2)
    assert abs(host.current_a) < 1e-6
    assert not host.firmware.armed
    host.hold(-51, 50)
    assert host.current_a == pytest.approx(-0.051, rel=0.01)


def test_a_third_partys_host_drives_it(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    """TMotorCANControl's servo mode sends the same commands; it forgot to set a name that it uses."""
    monkeypatch.setattr(servo_can, "send_index", 4, raising=False)
    stranger = SimpleNamespace(bus=host.bus, debug=False)
    stranger.buffer_append_int32 = servo_can.CAN_Manager_servo.buffer_append_int32
    stranger.send_servo_message = partial(servo_can.CAN_Manager_servo.send_servo_message, stranger)
    for current_a in (1.5, -0.75, 0.0):
        for _ in range(5):
            servo_can.CAN_Manager_servo.comm_can_set_current(stranger, NODE, current_a)
            host.wait(10)
        assert host.current_a == pytest.approx(current_a, rel=1e-3, abs=1e-6)


def test_what_it_reports_is_cut_off_not_rounded(host: Host) -> None:
    host.hold(1990, 100)
    erpm, drawn, duty = host.status()
    assert drawn in (19, 20)  # 1.99 A and 5 mA of noise
    velocity_rad_s = host.plant.encoder_velocity_rad_s("actuator")
    assert erpm == pytest.approx(velocity_rad_s * POLE_PAIRS * 60 / tau, rel=0.02)
    # q axis: 0.1 Ω, and a back-EMF of two thirds of the torque constant; duty 1 is 24 V / √3.
    expected = sqrt(3) * (0.1 * host.current_a + 0.05 * 2 / 3 * velocity_rad_s) / 24
    assert duty == pytest.approx(1000 * expected, abs=2)
    angle = host.status(STATUS_4)[3]
    turned = host.plant.encoder_position_rad("actuator") / tau % 1
    assert 0 <= angle < 18_000
    assert angle == pytest.approx(18_000 * turned, abs=18_000 * velocity_rad_s / tau * 3e-3)


def test_the_angle_goes_round_and_the_tachometer_on(host: Host) -> None:
    host.hold(-3000, 500)
    turns = host.plant.encoder_position_rad("actuator") / tau
    assert turns < -2
    angle, tachometer = host.status(STATUS_4)[3], host.status(STATUS_5)[0]
    assert 0 <= angle < 18_000
    assert tachometer < 6 * POLE_PAIRS * turns + 1


def test_the_current_is_positive_where_the_motor_draws_whichever_way_it_turns(host: Host) -> None:
    """mcpwm_foc.c: its sign is that of voltage times current, not that of the torque."""
    signs = set()
    for milliamperes in (3000, -3000, -3000, 3000):
        host.hold(milliamperes, 200)
        erpm, drawn, duty = host.status()
        signs.add((erpm > 0, drawn > 0, duty > 0))
        host.current(-milliamperes)
        host.wait(8)  # braked: it generates
        erpm, drawn, duty = host.status()
        assert (drawn > 0) == ((duty > 0) == (-milliamperes > 0))
        host.hold(0, 600)
    assert {(True, True, True), (False, True, False)} <= signs


def test_a_motor_that_is_let_go_of_reports_no_current_and_its_back_emf(host: Host) -> None:
    host.hold(3000, 300)
    host.current(0)
    erpm, drawn, duty = host.status()
    assert drawn == 0
    assert erpm > 1000
    assert duty == pytest.approx(1000 * sqrt(3) * 0.05 * 2 / 3 * erpm / POLE_PAIRS * tau / 60 / 24, rel=0.1)


def test_only_commands_put_off_the_timeout(host: Host) -> None:
    host.current(300)
    for _ in range(49):
        host.wait(20)
        host.send(SHORT, bytes((HOST, 0)) + ASK_FAULT)
        host.send(PING, bytes((HOST,)))
    assert host.current_a == pytest.approx(0.3, rel=1e-3)
    host.wait(60)
    assert abs(host.current_a) < 1e-6
    assert not host.firmware.armed
    assert host.fault() == 0  # a timeout is no fault
    host.hold(300, 20)
    assert host.current_a == pytest.approx(0.3, rel=1e-2)


def test_a_timeout_of_zero_is_none(open_host: OpenHost) -> None:
    host = open_host(watchdog=0.0)
    host.current(300)
    host.wait(5000)
    assert host.current_a == pytest.approx(0.3, rel=1e-3)


@pytest.mark.parametrize(
    ("fault", "code"), [(DriveFault.FAULT, 3), (DriveFault.UNDERVOLTAGE, 2), (DriveFault.OVER_TEMPERATURE, 5)]
)
def test_a_fault_stops_it_for_half_a_second_and_then_it_obeys_again(host: Host, fault: DriveFault, code: int) -> None:
    host.hold(1000, 50)
    host.firmware.break_down(fault)
    assert host.fault() == code
    host.hold(1000, 400)
    assert abs(host.current_a) < 1e-6
    assert host.fault() == code
    host.hold(1000, 150)
    assert host.fault() == 0
    assert host.current_a == pytest.approx(1.0, rel=1e-2)


def test_hot_transistors_are_a_fault_as_long_as_they_are_hot(host: Host) -> None:
    host.firmware.motor.amplifier.heating.temperature_c = 120.0
    host.hold(1000, 2000)
    assert host.fault() == 5
    assert abs(host.current_a) < 1e-6
    assert host.status(STATUS_4)[0] > 1000


def test_ping_version_and_broadcast(host: Host) -> None:
    host.send(PING, bytes((HOST,)))
    host.wait(2)
    assert host.received(PONG, HOST) == [bytes((NODE, 0))]
    host.send(SHORT, bytes((HOST, 0, 0)))
    host.wait(2)
    pieces = [bytes(each.data) for each in iter(lambda: host.bus.recv(0), None) if each.arbitration_id == 0x05FE]
    assert b"".join(piece[1:] for piece in pieces)[:6] == bytes((0, 6, 5)) + b"60\0"
    host.send(SET_CURRENT, struct.pack(">i", 1000), node=255)
    host.wait(20)
    assert host.current_a == pytest.approx(1.0, rel=1e-2)


def test_six_bytes_are_misread_as_the_firmware_does(host: Host) -> None:
    """A current of zero and an off delay of 2 s, by the documentation; comm_can.c makes it 2 A."""
    host.send(SET_CURRENT, struct.pack(">ih", 0, 2000))
    host.wait(30)
    assert host.current_a == pytest.approx(2.0, rel=1e-2)


def test_its_current_is_limited(host: Host) -> None:
    host.current(100_000)
    host.wait(1)
    assert host.current_a < 60.0
    host.current(-100_000)
    host.wait(1)
    assert host.current_a > -60.0


def test_torques_as_the_rig_scales_them(open_host: OpenHost) -> None:
    """A torque constant of 0.05 N m/A in the rig; the amplifier gives 18 A for a newton metre where 20 were asked."""
    host = open_host("18 A/(N*m)", "N*m", mode="torque", torque_constant=0.05)
    host.hold(2000, 50)
    assert host.current_a == pytest.approx(1.8, rel=1e-2)


def test_a_duty_cycle_is_a_voltage_over_the_winding(open_host: OpenHost) -> None:
    """13.8 A for a duty cycle of 1: 24 V / √3 over 1.004 Ω. The shaft speeds up until the back-EMF balances it."""
    host = open_host("13.8 A", "1", mode="duty")
    host.send(SET_DUTY, struct.pack(">i", 20_000))
    host.wait(4)
    started_a = host.current_a
    assert 1.5 < started_a < 0.2 * 13.8
    for _ in range(100):
        host.send(SET_DUTY, struct.pack(">i", 20_000))
        host.wait(20)
    velocity_rad_s = host.plant.true_velocity_rad_s("actuator")
    back_emf_share = sqrt(3) * 0.05 * 2 / 3 * velocity_rad_s / 24
    assert host.current_a == pytest.approx(13.8 * (0.2 - back_emf_share), rel=0.03)
    assert host.status()[2] == pytest.approx(200, abs=3)
    host.send(SET_DUTY, struct.pack(">i", 0))
    host.wait(5)
    assert host.current_a < -0.3  # shorted, it brakes
    host.current(0)
    host.wait(5)
    assert abs(host.current_a) < 1e-6


def test_frozen_it_repeats_itself(host: Host) -> None:
    host.hold(2000, 100)
    host.firmware.freeze()
    first = host.status(STATUS_4)[3]
    host.hold(2000, 100)
    assert host.status(STATUS_4)[3] == first
    assert host.status()[0] != 0


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(packet=st.integers(0, 60), data=st.binary(max_size=8), node=st.sampled_from([NODE, 255, 1]))
def test_no_frame_makes_it_stumble(host: Host, packet: int, data: bytes, node: int) -> None:
    host.send(packet, data, node)
    host.wait(2)
    assert abs(host.status()[2]) <= 1000
