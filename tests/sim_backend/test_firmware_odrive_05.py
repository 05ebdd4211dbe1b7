"""The emulated ODrive with firmware 0.5, held against the DBC file 0.5.6 and against its source."""

from collections.abc import Callable
from dataclasses import replace
from math import nan, tau
from struct import pack
from typing import Any

import pytest

from norton_drivers.link import Link
from norton_drivers.odrive import open_amplifier
from norton_drivers.readings import DriveState
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from norton_sim.firmware.odrive_05 import ODrive05Axis
from tests.sim_backend.odrive_host import NODE, ODriveHost

CPR = 8192
IDLE, CLOSED_LOOP = 1, 8
INVALID_STATE, WATCHDOG, ESTOP = 1 << 0, 1 << 11, 1 << 14
Bench = Callable[..., SimulatedBackend]


class Host(ODriveHost):
    """Of firmware 0.5, whose DBC file it reads answers with."""

    dbc = "odrive-cansimple-0.5.6"

    @property
    def firmware(self) -> ODrive05Axis:
        assert isinstance(self.device, ODrive05Axis)
        return self.device

    def close_loop(self) -> None:
        self.send(0x0B, pack("<II", 1, 1))
        self.send(0x07, pack("<I", CLOSED_LOOP))
        self.wait(1)


@pytest.fixture
def open_host(wiring: Wiring, open_bench: Bench) -> Callable[..., Host]:
    def opened(**options: Any) -> Host:
        options = {"node": NODE, "firmware": "0.5", "watchdog": 0.0, **options}
        return Host(open_bench(replace(wiring, actuator=replace(wiring.actuator, options=options))), wiring)

    return opened


@pytest.fixture
def host(open_host: Callable[..., Host]) -> Host:
    return open_host(position="counts", counts_per_turn=CPR)


def test_cyclic_messages_come_at_their_rates(host: Host) -> None:
    host.heard()
    host.wait(1000)
    rates_hz = {command: len(payloads) for command, payloads in host.heard().items()}
    expected_hz = {0x01: 10, 0x09: 1000, 0x0A: 1000, 0x14: 100, 0x17: 10}
    assert rates_hz.keys() == expected_hz.keys()
    assert all(abs(rates_hz[command] - rate) <= 1 for command, rate in expected_hz.items())


def test_before_056_only_heartbeats_and_estimates_come_by_themselves(open_host: Callable[..., Host]) -> None:
    host = open_host(ask=True)
    host.heard()
    host.wait(500)
    assert set(host.heard()) == {0x01, 0x09}
    assert host.ask("Get_Iq")["Iq_Measured"] == pytest.approx(0, abs=0.05)
    host.send(0x1D, remote=True)
    host.send(0x14)  # an empty data frame is no question yet
    host.wait(1)
    assert not {0x1D, 0x14} & set(host.heard())


def test_it_tells_no_version_and_no_parameters(host: Host) -> None:
    host.heard()
    host.send(0x00, remote=True)
    host.send(0x04, pack("<BHxI", 0, 200, 0))
    host.wait(1)
    assert not {0x00, 0x05} & set(host.heard())
    assert host.ask("Get_Sensorless_Error") == {"Sensorless_Error": 0}


def test_an_empty_frame_asks_as_well(host: Host) -> None:
    assert host.ask("Get_Bus_Voltage_Current", data=b"")["Bus_Voltage"] == 24.0


def test_counts_are_the_encoders(host: Host) -> None:
    host.close_loop()
    host.torque(-0.1)
    host.wait(300)
    count = host.ask("Get_Encoder_Count")
    shadow = count["Shadow_Count"] - 2**32
    assert shadow / CPR * tau == pytest.approx(host.world.plant.true_position_rad("actuator"), rel=0.02)
    assert shadow < -CPR
    assert count["Count_in_CPR"] == shadow % CPR


def test_it_closes_and_opens_its_loop(host: Host) -> None:
    assert host.state() == (0, IDLE)
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
    ("harm", "axis", "motor", "controller"),
    [
        (lambda host: host.send(0x02), ESTOP, 0, 0),
        (lambda host: host.torque(nan), 0, 1 << 16, 0),
        (lambda host: host.send(0x0B, pack("<II", 3, 1)), 0, 0, 1 << 1),
        (lambda host: host.firmware.break_down(DriveFault.FAULT), 0, 1 << 3, 0),
        (lambda host: host.firmware.break_down(DriveFault.UNDERVOLTAGE), 0, 1 << 24, 0),
        (lambda host: setattr(host.firmware.motor.heating, "temperature_c", 120.0), 0, 1 << 18, 0),
    ],
)
def test_what_disarms_it(host: Host, harm: Callable[[Host], object], axis: int, motor: int, controller: int) -> None:
    host.close_loop()
    host.torque(0.1)
    host.wait(20)
    harm(host)
    host.wait(20)
    heartbeat = host.ask("Heartbeat")
    assert (heartbeat["Axis_Error"], heartbeat["Axis_State"]) == (axis, IDLE)
    assert (heartbeat["Motor_Error_Flag"], heartbeat["Controller_Error_Flag"]) == (motor != 0, controller != 0)
    assert host.ask("Get_Motor_Error")["Motor_Error"] == motor
    assert host.ask("Get_Controller_Error")["Controller_Error"] == controller
    assert abs(host.world.plant.true_current_a("actuator")) < 1e-6


def test_with_an_error_the_loop_does_not_stay_closed_until_it_is_cleared(host: Host) -> None:
    host.send(0x02)
    host.close_loop()
    assert host.state() == (ESTOP, IDLE)
    host.send(0x18)
    host.close_loop()
    assert host.state() == (0, CLOSED_LOOP)
    host.send(0x07, pack("<I", 99))
    host.wait(1)
    assert host.state() == (INVALID_STATE, IDLE)
    host.close_loop()
    assert host.state() == (0, CLOSED_LOOP)


def test_its_watchdog_bites_an_idle_axis_too(open_host: Callable[..., Host]) -> None:
    host = open_host(watchdog=0.05)
    host.wait(100)
    assert host.firmware.axis_errors == WATCHDOG
    host.send(0x18)
    host.close_loop()
    for _ in range(5):
        host.wait(40)
        host.torque(0.0)
    host.wait(48)
    assert host.firmware.armed
    host.wait(3)
    assert (host.firmware.armed, host.firmware.axis_errors) == (False, WATCHDOG)


@pytest.mark.parametrize("options", [{}, {"ask": True}, {"position": "counts", "counts_per_turn": 131072}])
def test_the_real_driver_enables_and_turns_the_shaft(
    wiring: Wiring, open_bench: Bench, options: dict[str, object]
) -> None:
    options = {"node": NODE, "firmware": "0.5", **options}
    wiring = replace(wiring, actuator=replace(wiring.actuator, options=options))
    backend = open_bench(wiring)
    link = Link(backend, wiring.buses)
    drive = open_amplifier(wiring.actuator, link)
    assert drive.identify().firmware == "0.5"
    drive.enable()
    drive.take_motion()
    drive.take_current()
    for _ in range(300):
        link.wait()
        drive.command(0.1)
    motion, current = drive.take_motion(), drive.take_current()
    assert drive.status().state is DriveState.ENABLED
    assert len(motion) == pytest.approx(300, abs=5)
    # Where it has to be asked for, the tick decides when.
    assert len(current) in range(24, 32)
    assert current[-1].current_a == pytest.approx(1.8, abs=0.05)
    truth_rad = backend.world.plant.true_position_rad("actuator")
    assert motion[-1].position_rad == pytest.approx(truth_rad, abs=2e-3 * motion[-1].velocity_rad_s)
    # Nobody feeds it any more, though it goes on being listened to.
    drive.provoke_watchdog()
    for _ in range(300):
        link.wait()
    assert drive.made_itself_safe()
    assert drive.status().errors == ("watchdog expired: no command arrived in time",)
    drive.enable()
    assert drive.status().state is DriveState.ENABLED
