"""Emulated Feetech servos on one line, driven by their maker's own packet handler."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scservo_sdk.group_sync_read import GroupSyncRead
from scservo_sdk.protocol_packet_handler import protocol_packet_handler
from scservo_sdk.scservo_def import SCS_TOHOST

from norton_drivers.feetech import table
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from norton_sim.firmware.feetech import FeetechServo
from norton_sim.integrator import ANGLE, CURRENT_TARGET
from tests.sim_backend.sdk_port import SdkPort

PORT, BAUD = "/tmp/servos", 1_000_000
SDK = protocol_packet_handler()
Bench = Callable[..., SimulatedBackend]


class Servos:
    """Two on one line: 1 is the actuator, 2 the load."""

    def __init__(self, backend: SimulatedBackend) -> None:
        self.backend = backend
        self.port = SdkPort(backend, PORT, BAUD)
        servo = backend.world.devices["actuator"]
        assert isinstance(servo, FeetechServo)
        self.servo = servo

    def word(self, address: int, node: int = 1) -> int:
        value, result, _ = SDK.read2ByteTxRx(self.port, node, address)
        assert result == 0
        return int(value)

    def write(self, address: int, *data: int) -> None:
        assert SDK.writeTxRx(self.port, 1, address, len(data), list(data))[0] == 0

    def command(self) -> float:
        machine = self.backend.world.plant._machines["actuator"]
        return machine.state[CURRENT_TARGET] / machine.amplifier_gain


@pytest.fixture
def open_servos(wiring: Wiring, open_bench: Bench) -> Callable[..., Servos]:
    def opened(kind: str = "STS3215", **options: object) -> Servos:
        common = {"baud": BAUD, "stall_torque": 1.9}
        actuator = DeviceSettings(
            "actuator", "feetech", port=PORT, options={**common, "type": kind, "node": 1, **options}
        )
        load = DeviceSettings(
            "load", "feetech", port=PORT, options={**common, "type": "STS3215", "node": 2, "mode": "torque"}
        )
        return Servos(open_bench(replace(wiring, actuator=actuator, load=load, torque_sensor=None)))

    return opened


def test_it_says_which_model_it_is(open_servos: Callable[..., Servos]) -> None:
    assert SDK.ping(open_servos().port, 1) == (777, 0, 0)


def test_both_are_read_at_once(open_servos: Callable[..., Servos]) -> None:
    servos = open_servos()
    servos.backend.world.plant._state[:, ANGLE] = 0.5
    group = GroupSyncRead(servos.port, SDK, table.PRESENT_POSITION, 2)
    group.addParam(1)
    group.addParam(2)
    assert group.txRxPacket() == 0
    places = [group.getData(node, table.PRESENT_POSITION, 2) for node in (1, 2)]
    assert places == [2048 + 326, 2048 - 326], "the load is mounted the other way round"
    assert servos.backend.world.lines[PORT].collisions == 0


def test_as_a_motor_it_obeys_a_share_of_its_supply(open_servos: Callable[..., Servos]) -> None:
    servos = open_servos()
    servos.write(table.MODE, 2)
    servos.write(table.GOAL_PWM, 100, 4)  # -100: its sign is bit 10
    servos.port.wait(3)
    assert servos.command() == 0.0, "the torque is off"
    servos.write(table.TORQUE_ENABLE, 1)
    servos.port.wait(3)
    assert servos.command() == pytest.approx(-0.1)
    assert SCS_TOHOST(servos.word(table.PRESENT_LOAD), 10) == -100
    servos.port.wait(50)
    assert SCS_TOHOST(servos.word(table.PRESENT_SPEED), 15) < -10
    servos.write(table.TORQUE_ENABLE, 0)
    servos.port.wait(3)
    assert servos.command() == 0.0


def test_overload_leaves_the_protective_torque(open_servos: Callable[..., Servos]) -> None:
    servos = open_servos()
    servos.write(table.MODE, 2)
    servos.write(table.TORQUE_ENABLE, 1)
    servos.write(table.GOAL_PWM, 0x84, 3)  # 900
    servos.port.wait(1900)
    assert servos.command() == pytest.approx(0.9)
    servos.port.wait(200)
    assert servos.command() == pytest.approx(0.2)
    assert servos.word(table.STATUS) & 0xFF == 32
    servos.write(table.TORQUE_ENABLE, 0)
    assert servos.word(table.STATUS) & 0xFF == 0


def test_as_a_servo_its_goal_moves_no_faster_than_its_speed(open_servos: Callable[..., Servos]) -> None:
    servos = open_servos(mode="position", position_gain=32)
    servos.backend.world.plant.jam("actuator")
    servos.write(table.P_GAIN, 32, 0, 0)
    servos.write(table.MIN_START_FORCE, 0, 0, 0, 0)
    servos.write(table.GOAL_SPEED, 0xE8, 3)  # 1000 counts a second
    servos.write(table.GOAL_POSITION, 0x64, 8)  # 2148
    servos.write(table.TORQUE_ENABLE, 1)
    servos.port.wait(50)
    assert servos.command() == pytest.approx(50 * table.MODELS["STS3215"].step_rad, rel=0.2)
    servos.port.wait(100)
    assert servos.command() == pytest.approx(100 * table.MODELS["STS3215"].step_rad)


def test_the_other_series_has_the_high_byte_first(open_servos: Callable[..., Servos]) -> None:
    servos = open_servos("SCS0009", mode="position")
    data, result, _ = SDK.readTxRx(servos.port, 1, 3, 2)
    assert (int.from_bytes(bytes(data), "big"), result) == (1284, 0)
    data, _, _ = SDK.readTxRx(servos.port, 1, table.PRESENT_POSITION, 2)
    assert int.from_bytes(bytes(data), "big") == 512
    servos.write(9, 0, 0, 0, 0)  # angle limits of zero: a motor
    servos.write(table.GOAL_PWM, 0, 200)
    servos.write(table.TORQUE_ENABLE, 1)
    servos.port.wait(3)
    assert servos.command() * 32 * table.DUTY_PER_RAD == pytest.approx(0.2)


def test_a_potentiometer_tells_nothing_beyond_its_end(open_servos: Callable[..., Servos]) -> None:
    servos = open_servos("SCS0009", mode="position")
    plant = servos.backend.world.plant
    for turned_rad, count in ((np.radians(149.0), 512 + 509), (np.radians(170.0), 1023), (np.radians(-200.0), 0)):
        plant.misread("actuator", 1, turned_rad - plant.encoder_position_rad("actuator"))
        data, _, _ = SDK.readTxRx(servos.port, 1, table.PRESENT_POSITION, 2)
        assert int.from_bytes(bytes(data), "big") == pytest.approx(count, abs=1)


def test_a_fault_switches_it_off_and_says_why(open_servos: Callable[..., Servos]) -> None:
    servos = open_servos()
    servos.write(table.TORQUE_ENABLE, 1)
    servos.servo.break_down(DriveFault.UNDERVOLTAGE)
    _, _, error = SDK.read1ByteTxRx(servos.port, 1, table.TORQUE_ENABLE)
    assert error == 1
    assert not servos.servo.armed
