"""The emulated ODrive, held against the DBC file that ODrive publishes and against its manual."""

from collections.abc import Callable
from dataclasses import replace
from math import exp, nan, tau
from struct import pack
from typing import Any

import can
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.odrive import ODriveAxis
from tests.sim_backend.odrive_host import NODE, ODriveHost

IDLE, CLOSED_LOOP = 1, 8
WATCHDOG, ESTOP, MISSING_INPUT, BAD_CONFIG, TOO_HOT = 1 << 24, 1 << 25, 1 << 6, 1 << 4, 1 << 14
TIMEOUT_ENDPOINT, ENABLE_ENDPOINT = 7, 8


class Host(ODriveHost):
    """Of firmware 0.6, whose DBC file it reads answers with."""

    dbc = "odrive-cansimple-0.6.10"

    @property
    def firmware(self) -> ODriveAxis:
        assert isinstance(self.device, ODriveAxis)
        return self.device

    def frames(self, name: str) -> list[dict[str, Any]]:
        """The messages of a name that have arrived since the last call; others are dropped."""
        message = self.message(name)
        return [message.decode(each, decode_choices=False) for each in self.heard().get(message.frame_id, [])]

    def close_loop(self) -> None:
        self.send(0x0B, pack("<II", 1, 1))
        self.torque(0.0)
        self.send(0x07, pack("<I", CLOSED_LOOP))
        self.wait(1)

    def arm_watchdog(self, timeout_s: float) -> None:
        self.send(0x04, pack("<BHxf", 1, TIMEOUT_ENDPOINT, timeout_s))
        self.send(0x04, pack("<BHxI", 1, ENABLE_ENDPOINT, 1))
        self.wait(1)


@pytest.fixture
def host(wiring: Wiring, open_bench: Callable[..., SimulatedBackend]) -> Host:
    endpoints = {"watchdog_timeout_endpoint": TIMEOUT_ENDPOINT, "enable_watchdog_endpoint": ENABLE_ENDPOINT}
    actuator = replace(wiring.actuator, options={"node": NODE, **endpoints})
    return Host(open_bench(replace(wiring, actuator=actuator)), wiring)


def test_cyclic_messages_come_at_their_rates(host: Host) -> None:
    rates_hz = {"Get_Encoder_Estimates": 1000, "Get_Iq": 100, "Heartbeat": 10, "Get_Temperature": 10}
    for name, rate_hz in {**rates_hz, "Get_Bus_Voltage_Current": 10}.items():
        host.frames(name)
        host.wait(1000)
        assert abs(len(host.frames(name)) - rate_hz) <= 1


def test_getters_answer_remote_frames(host: Host) -> None:
    version = host.ask("Get_Version")
    assert (version["Fw_Version_Major"], version["Fw_Version_Minor"]) == (0, 6)
    assert host.ask("Get_Error") == {"Active_Errors": 0, "Disarm_Reason": 0}
    assert host.ask("Get_Bus_Voltage_Current")["Bus_Voltage"] == 24.0
    host.close_loop()
    host.torque(0.1)
    host.wait(50)
    plant = host.world.plant
    # 18 A/(N m); the encoder's estimate lags an accelerating shaft by a time constant of 1 ms or two.
    assert host.ask("Get_Iq")["Iq_Setpoint"] == pytest.approx(1.8)
    assert host.ask("Get_Iq")["Iq_Measured"] == pytest.approx(1.8, abs=0.03)
    assert host.ask("Get_Torques")["Torque_Target"] == pytest.approx(0.1)
    assert host.ask("Get_Torques")["Torque_Estimate"] == pytest.approx(0.1, abs=0.002)
    estimates = host.ask("Get_Encoder_Estimates")
    assert estimates["Vel_Estimate"] * tau == pytest.approx(plant.true_velocity_rad_s("actuator"), rel=0.1)
    assert estimates["Pos_Estimate"] * tau == pytest.approx(plant.true_position_rad("actuator"), rel=0.1)


def test_it_closes_and_opens_its_loop(host: Host) -> None:
    assert host.state() == (0, IDLE)
    host.torque(0.2)
    host.wait(20)
    assert host.world.plant.true_current_a("actuator") == 0
    host.close_loop()
    assert host.state() == (0, CLOSED_LOOP)
    host.torque(0.1)
    host.wait(20)
    assert host.world.plant.true_current_a("actuator") == pytest.approx(1.8, rel=1e-3)
    host.send(0x07, pack("<I", IDLE))
    host.wait(20)
    assert host.state() == (0, IDLE)
    assert abs(host.world.plant.true_current_a("actuator")) < 1e-6


@pytest.mark.parametrize(
    ("prepare", "error"),
    [
        (lambda host: host.send(0x0B, pack("<II", 1, 1)), MISSING_INPUT),
        (lambda host: (host.send(0x0B, pack("<II", 3, 1)), host.torque(0.0)), BAD_CONFIG),
        (lambda host: (host.send(0x0B, pack("<II", 1, 6)), host.torque(0.0)), BAD_CONFIG),
        (lambda host: (host.send(0x0B, pack("<II", 99, 99)), host.torque(0.0)), BAD_CONFIG),
        (lambda host: (host.send(0x0B, pack("<II", 1, 1)), host.torque(0.0), host.send(0x02)), ESTOP),
    ],
)
def test_it_refuses_to_close_its_loop(host: Host, prepare: Callable[[Host], object], error: int) -> None:
    prepare(host)
    host.send(0x07, pack("<I", CLOSED_LOOP))
    host.wait(1)
    assert host.state() == (error, IDLE)
    assert host.ask("Heartbeat")["Procedure_Result"] == 13
    host.send(0x18, b"\0")
    host.close_loop()
    assert host.state() == (0, CLOSED_LOOP)


@pytest.mark.parametrize(
    ("harm", "error"),
    [
        (lambda host: host.send(0x02), ESTOP),
        (lambda host: host.torque(nan), MISSING_INPUT),
        (lambda host: host.send(0x0B, pack("<II", 2, 1)), BAD_CONFIG),
        (lambda host: host.firmware.fail(1 << 5), 1 << 5),
        (lambda host: setattr(host.firmware.motor.heating, "temperature_c", 120.0), TOO_HOT),
    ],
)
def test_what_disarms_it(host: Host, harm: Callable[[Host], object], error: int) -> None:
    host.close_loop()
    host.torque(0.1)
    host.wait(20)
    harm(host)
    host.wait(20)
    assert host.state() == (error, IDLE)
    assert host.ask("Get_Error") == {"Active_Errors": error, "Disarm_Reason": error}
    assert host.ask("Heartbeat")["Procedure_Result"] == 3
    assert abs(host.world.plant.true_current_a("actuator")) < 1e-6


@pytest.mark.parametrize("feed", [lambda host: host.torque(0.0), lambda host: host.send(0x01, remote=True)])
def test_every_frame_feeds_the_watchdog(host: Host, feed: Callable[[Host], None]) -> None:
    host.arm_watchdog(0.05)
    host.close_loop()
    for _ in range(10):
        host.wait(40)
        feed(host)
    host.wait(48)
    assert host.firmware.axis_state == CLOSED_LOOP
    host.wait(3)
    # Asked by nobody, for that would feed it.
    assert (host.firmware.axis_state, host.firmware.active_errors) == (IDLE, WATCHDOG)


def test_a_frame_to_another_axis_does_not_feed_it(host: Host) -> None:
    host.arm_watchdog(0.05)
    host.close_loop()
    for _ in range(6):
        host.bus.send(can.Message(arbitration_id=2 << 5 | 0x0E, is_extended_id=False, data=bytes(4)))
        host.wait(10)
    assert host.state() == (WATCHDOG, IDLE)


def test_the_watchdog_is_off_until_armed_and_bites_only_an_armed_drive(host: Host) -> None:
    host.close_loop()
    host.wait(2000)
    assert host.state() == (0, CLOSED_LOOP)
    host.send(0x07, pack("<I", IDLE))
    host.arm_watchdog(0.05)
    host.wait(2000)
    assert host.state() == (0, IDLE)
    host.close_loop()
    host.wait(60)
    assert host.state() == (WATCHDOG, IDLE)


def test_a_shorter_timeout_counts_at_once(host: Host) -> None:
    host.arm_watchdog(10.0)
    host.close_loop()
    host.arm_watchdog(0.02)
    host.wait(22)
    assert host.firmware.active_errors == WATCHDOG


def test_parameters_are_read_back(host: Host) -> None:
    host.arm_watchdog(0.25)
    host.frames("TxSdo")
    host.send(0x04, pack("<BHxI", 0, TIMEOUT_ENDPOINT, 0))
    host.send(0x04, pack("<BHxI", 0, ENABLE_ENDPOINT, 0))
    host.send(0x04, pack("<BHxI", 0, 999, 0))
    host.wait(1)
    answers = {answer["Endpoint_ID"]: answer["Value"] for answer in host.frames("TxSdo")}
    assert answers == {TIMEOUT_ENDPOINT: int.from_bytes(pack("<f", 0.25), "little"), ENABLE_ENDPOINT: 1}


@pytest.mark.parametrize("timeout_s", [0.0, nan, -1.0])
def test_an_odd_timeout_does_not_hang_it(host: Host, timeout_s: float) -> None:
    host.arm_watchdog(timeout_s)
    host.wait(20)
    assert host.firmware.axis_state == IDLE


def test_its_current_limit_holds(host: Host) -> None:
    host.close_loop()
    host.send(0x0F, pack("<ff", 100.0, 0.9))
    for torque_nm, current_a in ((0.2, 0.9), (-0.2, -0.9), (0.02, 0.36)):
        host.torque(torque_nm)
        host.wait(30)
        assert host.world.plant.true_current_a("actuator") == pytest.approx(current_a, rel=1e-3)


def test_its_transistors_warm_up(host: Host) -> None:
    host.close_loop()
    host.torque(0.4)
    host.wait(5000)
    # Ambient 25 °C, 0.1 K/A², 20 s, at 18 A/(N m).
    expected_c = 25 + 0.1 * (0.4 * 18) ** 2 * (1 - exp(-5 / 20))
    assert host.ask("Get_Temperature")["FET_Temperature"] == pytest.approx(expected_c, rel=2e-3)


def test_frozen_estimates_keep_coming(host: Host) -> None:
    host.close_loop()
    host.torque(0.1)
    host.wait(100)
    host.firmware.freeze()
    host.wait(2)
    host.frames("Get_Encoder_Estimates")
    host.wait(50)
    frozen = host.frames("Get_Encoder_Estimates")
    assert len(frozen) >= 49
    assert all(each == frozen[0] for each in frozen)
    assert frozen[0]["Vel_Estimate"] > 0


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
@given(command=st.integers(0, 31), data=st.binary(max_size=8), remote=st.booleans())
def test_no_frame_makes_it_stumble(host: Host, command: int, data: bytes, remote: bool) -> None:
    host.send(command, data, remote=remote)
    host.wait(1)
    assert host.ask("Heartbeat")["Axis_State"] in (IDLE, CLOSED_LOOP)
