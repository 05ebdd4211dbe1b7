"""The emulated actuator in MIT mode, held against the firmware's source: raw frames in, raw frames out."""

import struct
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import can
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from TMotorCANControl.mit_can import CAN_Manager

from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from tests.sim_backend.can_host import CanHost, opener

NODE, MASTER = 5, 0x11
P, V, T = 12.5, 100.0, 2.0
ENABLE, DISABLE, ZERO = (bytes.fromhex("FF" * 7) + bytes((last,)) for last in (0xFC, 0xFD, 0xFE))
OPTIONS = {
    "node": NODE,
    "master": MASTER,
    "position_range": P,
    "velocity_range": V,
    "torque_range": T,
    "watchdog": 0.2,
    "beyond_range": "wraps",
}
GAIN_A_NM = 18.0


def command(torque_nm: float) -> bytes:
    """Gains of zero, and the nearest code of twelve bits."""
    return struct.pack(">Q", 0x7FFF_7FF0_0000_0000 | round((torque_nm + T) * 4095 / (2 * T)))


class Host(CanHost):
    """Speaks to the actuator's drive in raw frames."""

    extended = False

    def send(self, data: bytes) -> None:
        self.put(NODE, data)

    def ask(self, data: bytes) -> bytes:
        """The reply to one frame."""
        self.replies()
        self.send(data)
        self.wait(1)
        (reply,) = self.replies()
        return reply

    def replies(self) -> list[bytes]:
        return [bytes(each.data) for each in self.heard() if each.arbitration_id == MASTER]

    def hold(self, torque_nm: float, duration_ms: int) -> None:
        for _ in range(duration_ms // 10):
            self.send(command(torque_nm))
            self.wait(10)

    def enable(self) -> None:
        self.send(command(0.0))
        self.send(ENABLE)
        self.wait(1)


def fields(reply: bytes) -> tuple[int, int, int]:
    """Position, velocity and torque codes."""
    return reply[1] << 8 | reply[2], reply[3] << 4 | reply[4] >> 4, (reply[4] & 0xF) << 8 | reply[5]


OpenHost = Callable[..., Host]


@pytest.fixture
def open_host(wiring: Wiring, open_bench: Callable[..., SimulatedBackend]) -> OpenHost:
    return opener(Host, open_bench, wiring, "mit", OPTIONS)


@pytest.fixture
def host(open_host: OpenHost) -> Host:
    return open_host()


def test_it_speaks_only_when_it_is_spoken_to(host: Host) -> None:
    host.wait(500)
    assert host.replies() == []
    for data in (DISABLE, command(0.0), ENABLE, bytes(3)):
        reply = host.ask(data)
        assert (len(reply), reply[0]) == (8, NODE)
        assert reply[6:] == bytes((25, 0))  # °C, and no error


def test_the_reply_is_older_than_what_its_command_does(host: Host) -> None:
    host.enable()
    host.hold(0.1, 50)
    assert fields(host.ask(command(-0.1)))[2] == pytest.approx((0.1 + T) * 4095 / (2 * T), abs=2)
    host.wait(15)
    assert fields(host.ask(command(-0.1)))[2] == pytest.approx((-0.1 + T) * 4095 / (2 * T), abs=2)


def test_it_obeys_while_it_is_enabled(host: Host) -> None:
    host.hold(0.2, 50)
    assert host.current_a == 0
    assert not host.firmware.armed
    host.enable()
    assert host.firmware.armed
    host.hold(0.1, 50)
    assert host.current_a == pytest.approx(0.1 * GAIN_A_NM, abs=T / 4095 * GAIN_A_NM)
    host.send(DISABLE)
    host.wait(5)
    assert abs(host.current_a) < 1e-6
    assert not host.firmware.armed


def test_a_third_partys_host_enables_drives_and_disables_it(open_host: OpenHost) -> None:
    """TMotorCANControl, with its own table for an AK80-9."""
    host = open_host(position_range=12.5, velocity_range=50.0, torque_range=18.0)
    stranger = SimpleNamespace(bus=host.bus, debug=False)
    stranger.send_MIT_message = partial(CAN_Manager.send_MIT_message, stranger)
    CAN_Manager.power_on(stranger, NODE)
    for _ in range(5):
        host.wait(10)
        CAN_Manager.MIT_controller(stranger, NODE, "AK80-9", 0.0, 0.0, 0.0, 0.0, 0.2)
    host.wait(10)
    assert host.firmware.armed
    assert host.current_a == pytest.approx(0.2 * GAIN_A_NM, abs=2 * 36 / 4095 * GAIN_A_NM)
    told = CAN_Manager.parse_MIT_message(stranger, host.ask(command(0.0)), "AK80-9")
    assert told.position == pytest.approx(host.plant.encoder_position_rad("actuator"), abs=0.06)
    assert told.velocity == pytest.approx(host.plant.encoder_velocity_rad_s("actuator"), abs=1.0)
    assert told.current == pytest.approx(0.2, abs=0.03)
    assert told.error == 0
    CAN_Manager.power_off(stranger, NODE)
    host.wait(5)
    assert not host.firmware.armed


def test_it_begins_with_the_command_that_was_stored_last(host: Host) -> None:
    """fsm.c: nothing is zeroed on entering motor mode. That is why the driver sends a command of zero first."""
    host.send(command(0.15))
    host.send(ENABLE)
    host.wait(15)
    assert host.current_a == pytest.approx(0.15 * GAIN_A_NM, rel=0.02)


def test_there_is_no_torque_of_zero(host: Host) -> None:
    host.enable()
    host.hold(0.0, 50)
    assert abs(host.current_a) == pytest.approx(T / 4095 * GAIN_A_NM, rel=1e-3)


def test_the_timeout_zeroes_the_command_and_leaves_it_enabled(host: Host) -> None:
    host.enable()
    host.hold(0.05, 50)
    for _ in range(19):
        host.wait(10)
        host.send(ENABLE)  # no command: it does not feed the timeout
    assert host.current_a == pytest.approx(0.05 * GAIN_A_NM, rel=0.02)
    host.wait(30)
    assert abs(host.current_a) < 1e-6
    assert host.firmware.armed
    host.hold(0.05, 20)
    assert host.current_a == pytest.approx(0.05 * GAIN_A_NM, rel=0.02)


def test_without_a_timeout_it_goes_on(open_host: OpenHost) -> None:
    host = open_host(watchdog=0.0)
    host.enable()
    host.send(command(0.05))
    host.wait(2000)
    assert host.current_a == pytest.approx(0.05 * GAIN_A_NM, rel=0.02)


def test_codes_are_cut_off_and_wrap(host: Host) -> None:
    host.enable()
    host.hold(0.1, 1500)
    position_rad = host.plant.encoder_position_rad("actuator")
    assert position_rad > 2 * P
    position, velocity, _ = fields(host.ask(command(0.0)))
    expected = int((position_rad + P) * 65535 / (2 * P)) % 65536
    assert (position - expected) % 65536 < 65535 / (2 * P) * 60 * 1.5e-3
    velocity_rad_s = host.plant.encoder_velocity_rad_s("actuator")
    assert velocity == pytest.approx((velocity_rad_s + V) * 4095 / (2 * V), abs=5)


def test_a_position_that_saturates_stands_still_at_the_end(open_host: OpenHost) -> None:
    host = open_host(beyond_range="saturates")
    host.enable()
    host.hold(0.1, 1500)
    position, velocity, _ = fields(host.ask(command(0.0)))
    assert position == 65535
    assert velocity > 2500


def test_zero_is_set_while_it_is_not_enabled(host: Host) -> None:
    host.enable()
    host.hold(0.1, 300)
    host.ask(ZERO)
    assert fields(host.ask(command(0.0)))[0] > 40_000
    host.send(DISABLE)
    host.wait(1000)
    host.ask(ZERO)
    assert fields(host.ask(DISABLE))[0] == pytest.approx(32767, abs=1)


@pytest.mark.parametrize(
    ("fault", "code"), [(DriveFault.FAULT, 2), (DriveFault.UNDERVOLTAGE, 4), (DriveFault.OVER_TEMPERATURE, 1)]
)
def test_a_fault_stops_it_and_is_told_until_it_is_enabled_again(host: Host, fault: DriveFault, code: int) -> None:
    host.enable()
    host.hold(0.1, 50)
    host.firmware.break_down(fault)
    assert host.ask(command(0.1))[7] == code
    host.wait(10)
    assert abs(host.current_a) < 1e-6
    assert not host.firmware.armed
    host.send(ENABLE)
    host.wait(1)
    assert host.ask(command(0.1))[7] == 0


def test_it_stops_where_it_is_too_hot(host: Host) -> None:
    host.enable()
    host.firmware.heating.temperature_c = 120.0
    host.wait(5)
    assert host.ask(DISABLE)[6:] == bytes((120, 1))


def test_a_temperature_with_an_offset(open_host: OpenHost) -> None:
    assert open_host(temperature_offset=-40).ask(DISABLE)[6] == 65


def test_frozen_it_repeats_itself(host: Host) -> None:
    host.enable()
    host.hold(0.1, 100)
    host.firmware.freeze()
    first = fields(host.ask(command(0.1)))[:2]
    host.hold(0.1, 100)
    assert fields(host.ask(command(0.1)))[:2] == first


def test_another_motors_frames_are_anothers(host: Host) -> None:
    host.bus.send(can.Message(arbitration_id=NODE + 1, data=ENABLE, is_extended_id=False))
    host.bus.send(can.Message(arbitration_id=NODE, data=ENABLE, is_extended_id=True))
    host.wait(5)
    assert host.replies() == []
    assert not host.firmware.armed


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(data=st.binary(max_size=8))
def test_no_frame_makes_it_stumble(host: Host, data: bytes) -> None:
    assert len(host.ask(data)) == 8
