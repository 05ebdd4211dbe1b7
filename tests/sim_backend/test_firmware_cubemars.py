"""The emulated CubeMars actuator in servo mode, spoken to with bytes made by hand and by a package that drives it."""

import math
import struct
from collections.abc import Callable
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from TMotorCANControl.servo_can import CAN_Manager_servo

from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from tests.sim_backend.can_host import CanHost, opener

NODE = 104
GAIN = 18.0  # of the simulated actuator, in amperes for a command of 1
OPTIONS = {"node": NODE, "pole_pairs": 21, "gear_ratio": 9.0, "minimum_current": 0.05, "watchdog": 0.2}


class Host(CanHost):
    extended = True

    def send(self, packet: int, data: bytes) -> None:
        self.put(packet << 8 | NODE, data)

    def hold(self, current_a: float, ms: int) -> None:
        for _ in range(ms // 10):
            self.send(1, struct.pack(">i", round(current_a * 1000)))
            self.wait(10)

    def uploads(self) -> list[bytes]:
        frames = self.heard()
        assert all(each.arbitration_id == 0x2968 for each in frames)  # the manual's own example: 104
        return [bytes(each.data) for each in frames]

    def last(self) -> tuple[int, int, int, int, int]:
        return struct.unpack(">hhhbB", self.uploads()[-1])


@pytest.fixture
def open_host(wiring: Wiring, open_bench: Callable[..., SimulatedBackend]) -> Callable[..., Host]:
    return opener(Host, open_bench, wiring, "cubemars", OPTIONS)


@pytest.fixture
def host(open_host: Callable[..., Host]) -> Host:
    return open_host()


def test_it_sends_by_itself(host: Host) -> None:
    host.wait(200)
    uploads = host.uploads()
    assert len(uploads) == pytest.approx(100, abs=2)
    assert struct.unpack(">hhhbB", uploads[-1]) == (0, 0, 0, 25, 0)


def test_currents_drive_it_and_motion_is_told_in_its_own_units(host: Host) -> None:
    host.hold(0.1, 100)
    assert host.current_a == pytest.approx(0.1 * GAIN, rel=1e-3)
    position, speed, current, _, _ = host.last()
    assert position == pytest.approx(math.degrees(host.plant.encoder_position_rad("actuator")) * 10, rel=0.05)
    erpm = host.plant.encoder_velocity_rad_s("actuator") * 60 / math.tau * 21 * 9
    assert speed == pytest.approx(erpm / 10, rel=0.05)
    assert current / 100 == pytest.approx(0.1 * GAIN, abs=0.03)


def test_below_the_least_current_it_lets_go(host: Host) -> None:
    host.hold(0.1, 50)
    host.hold(0.04, 20)
    assert not host.firmware.armed
    assert abs(host.current_a) < 1e-6


def test_the_timeout_lets_go(host: Host) -> None:
    host.hold(0.1, 50)
    host.wait(180)
    assert host.firmware.armed
    host.wait(40)
    assert not host.firmware.armed
    assert abs(host.current_a) < 1e-6


@pytest.mark.parametrize(
    ("fault", "code"), [(DriveFault.FAULT, 2), (DriveFault.UNDERVOLTAGE, 4), (DriveFault.OVER_TEMPERATURE, 1)]
)
def test_a_fault_lets_go_is_told_and_ends_by_itself(host: Host, fault: DriveFault, code: int) -> None:
    host.hold(0.1, 50)
    host.firmware.break_down(fault)
    host.hold(0.1, 20)
    assert host.last()[4] == code
    assert abs(host.current_a) < 1e-6
    host.hold(0.1, 600)
    assert host.last()[4] == 0
    assert host.firmware.armed


@pytest.mark.parametrize(("beyond", "held"), [("saturates", True), ("wraps", False)])
def test_its_angle_at_the_end(open_host: Callable[..., Host], beyond: str, held: bool) -> None:
    host = open_host(beyond_range=beyond)
    host.hold(0.1, 1600)
    turned = math.degrees(host.plant.encoder_position_rad("actuator")) * 10
    assert turned > 40_000
    position = host.last()[0]
    assert position == 32_000 if held else abs(position - (turned - 65536)) < 200


def test_the_origin_and_freezing(host: Host) -> None:
    host.hold(0.1, 200)
    host.send(5, b"\0")
    host.wait(3)
    assert abs(host.last()[0]) < 300
    host.firmware.freeze()
    host.hold(0.1, 50)
    assert len({upload[:4] for upload in host.uploads()[3:]}) == 1


def test_a_third_partys_host_drives_it(host: Host) -> None:
    """TMotorCANControl; its functions leave a length undefined, which its module is given here."""
    stranger = SimpleNamespace(bus=host.bus, debug=False, buffer_append_int32=CAN_Manager_servo.buffer_append_int32)
    stranger.send_servo_message = lambda identifier, data, _length: CAN_Manager_servo.send_servo_message(
        stranger, identifier, data, len(data)
    )
    scope = CAN_Manager_servo.comm_can_set_current.__globals__
    scope["send_index"] = 4
    try:
        for _ in range(5):
            CAN_Manager_servo.comm_can_set_current(stranger, NODE, 0.1)
            host.wait(10)
    finally:
        del scope["send_index"]
    assert host.current_a == pytest.approx(0.1 * GAIN, rel=1e-3)
    told = CAN_Manager_servo.parse_servo_message(stranger, host.uploads()[-1])
    assert told.current == pytest.approx(0.1 * GAIN, abs=0.03)
    assert told.position == pytest.approx(math.degrees(host.plant.encoder_position_rad("actuator")), abs=3.0)
    assert (told.temperature, told.error) == (25, 0)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(data=st.binary(max_size=8), packet=st.integers(0, 70))
def test_no_frame_makes_it_stumble(host: Host, data: bytes, packet: int) -> None:
    host.send(packet, data)
    host.wait(0.5)
    host.uploads()
