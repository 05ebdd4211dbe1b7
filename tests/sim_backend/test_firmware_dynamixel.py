"""Emulated Dynamixels on one line, driven by ROBOTIS' own packet handler: registers, states, errors, the watchdog."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from dynamixel_sdk.group_sync_read import GroupSyncRead
from dynamixel_sdk.group_sync_write import GroupSyncWrite
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from norton_drivers.codecs import dynamixel as protocol
from norton_drivers.dynamixel import table
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.context import DriveFault
from norton_sim.firmware.dynamixel import DynamixelServo
from norton_sim.integrator import ANGLE, CURRENT_TARGET
from tests.sim_backend.sdk_port import SdkPort

PORT, BAUD = "/tmp/servos", 1_000_000
SDK = Protocol2PacketHandler()
ALERT, RANGE, LIMIT, ACCESS = 128, 4, 6, 7
OPTIONS = {"type": "XL330-M288", "baud": BAUD, "mode": "current"}
UNIT_A = 1e-3
Bench = Callable[..., SimulatedBackend]


class Servos:
    """Two on one line: 1 is the actuator, 2 the load."""

    def __init__(self, backend: SimulatedBackend) -> None:
        self.backend = backend
        self.port = SdkPort(backend, PORT, BAUD)
        self.first, self.second = (backend.world.devices[role] for role in ("actuator", "load"))

    def read(self, address: int, size: int, node: int = 1) -> tuple[int, int]:
        """A number, and the error byte."""
        data, result, error = SDK.readTxRx(self.port, node, address, size)
        assert result == 0
        return int.from_bytes(bytes(data), "little", signed=True), error

    def write(self, address: int, size: int, value: int, node: int = 1) -> int:
        """The error byte."""
        data = list(value.to_bytes(size, "little", signed=value < 0))
        result, error = SDK.writeTxRx(self.port, node, address, size, data)
        assert result == 0
        return int(error)

    def command_a(self) -> float:
        machine = self.backend.world.plant._machines["actuator"]
        return machine.state[CURRENT_TARGET] / machine.amplifier_gain


@pytest.fixture
def servos(wiring: Wiring, open_bench: Bench) -> Servos:
    return opened(wiring, open_bench)


def opened(wiring: Wiring, open_bench: Bench, **options: object) -> Servos:
    both = {
        role: DeviceSettings(role, "dynamixel", port=PORT, options={**OPTIONS, "node": node, **options})
        for node, role in ((1, "actuator"), (2, "load"))
    }
    both["load"] = replace(both["load"], options={**OPTIONS, "node": 2, "mode": "torque", "torque_constant": 0.4})
    return Servos(open_bench(replace(wiring, **both, torque_sensor=None)))


def test_each_answers_a_ping_with_its_model(servos: Servos) -> None:
    assert SDK.ping(servos.port, 1)[:2] == (1200, 0)
    assert SDK.ping(servos.port, 2)[:2] == (1200, 0)
    assert SDK.ping(servos.port, 3)[1] != 0, "nobody is there"
    found, result = SDK.broadcastPing(servos.port)
    assert result == 0
    assert {node: model for node, (model, _) in found.items()} == {1: 1200, 2: 1200}


@pytest.mark.parametrize("fast", [False, True])
def test_both_are_read_at_once_and_nobody_speaks_at_once_with_another(servos: Servos, fast: bool) -> None:
    servos.backend.world.plant._state[:, ANGLE] = 0.5
    group = GroupSyncRead(servos.port, SDK, table.PRESENT_POSITION, 4)
    group.addParam(1)
    group.addParam(2)
    assert (group.fastSyncRead() if fast else group.txRxPacket()) == 0
    places = [group.getData(node, table.PRESENT_POSITION, 4) for node in (1, 2)]
    assert places == [2048 + 326, 2048 - 326], "the load is mounted the other way round"
    assert servos.backend.world.lines[PORT].collisions == 0


def test_who_speaks_at_once_with_another_is_not_understood(servos: Servos) -> None:
    servos.port.writePort(list(protocol.Dialect().ping(1)))
    servos.port.wait(0.06)  # on its way as the servo answers
    servos.port.writePort(list(protocol.Dialect().ping(1)))
    servos.port.wait(5)
    heard = servos.port.line.read(100)
    assert servos.backend.world.lines[PORT].collisions == 1
    assert protocol.AnswerStream().feed(heard) == []


def test_a_silent_one_keeps_those_behind_it_from_answering(servos: Servos) -> None:
    servos.backend.world.wires["actuator"].cut()
    group = GroupSyncRead(servos.port, SDK, table.PRESENT_POSITION, 4)
    group.addParam(1)
    group.addParam(2)
    assert group.txRxPacket() != 0
    assert SDK.ping(servos.port, 2)[1] == 0


def test_goals_act_only_with_the_torque_on_and_within_the_limit(servos: Servos) -> None:
    assert servos.write(table.GOAL_CURRENT, 2, 300) == 0
    servos.port.wait(3)
    assert servos.command_a() == 0.0
    servos.write(table.TORQUE_ENABLE, 1, 1)
    servos.port.wait(3)
    assert servos.command_a() == pytest.approx(300 * UNIT_A)
    assert servos.write(table.GOAL_CURRENT, 2, 1194) == LIMIT
    group = GroupSyncWrite(servos.port, SDK, table.GOAL_CURRENT, 2)
    group.addParam(1, list((-200).to_bytes(2, "little", signed=True)))
    group.txPacket()
    servos.port.wait(3)
    assert servos.command_a() == pytest.approx(-200 * UNIT_A)
    assert servos.write(table.OPERATING_MODE, 1, 3) == ACCESS, "EEPROM is locked while the torque is on"
    servos.write(table.TORQUE_ENABLE, 1, 0)
    servos.port.wait(3)
    assert servos.command_a() == 0.0


def test_its_watchdog_ends_the_current_and_then_refuses_goals(servos: Servos) -> None:
    servos.write(table.TORQUE_ENABLE, 1, 1)
    servos.write(table.GOAL_CURRENT, 2, 300)
    servos.write(table.BUS_WATCHDOG, 1, 5)  # 100 ms
    for _ in range(5):
        servos.port.wait(60)
        assert servos.read(table.BUS_WATCHDOG, 1, node=2)[0] == 0, "a packet to anybody feeds it"
    assert servos.command_a() == pytest.approx(300 * UNIT_A)
    servos.port.wait(125)
    assert servos.command_a() == 0.0
    assert servos.read(table.BUS_WATCHDOG, 1)[0] == -1
    assert servos.write(table.GOAL_CURRENT, 2, 100) == RANGE
    servos.write(table.BUS_WATCHDOG, 1, 0)
    assert servos.write(table.GOAL_CURRENT, 2, 100) == 0


def test_an_error_switches_the_torque_off_until_it_is_rebooted(servos: Servos) -> None:
    assert isinstance(servos.first, DynamixelServo)
    servos.write(table.TORQUE_ENABLE, 1, 1)
    servos.first.break_down(DriveFault.OVER_TEMPERATURE)
    assert servos.read(table.HARDWARE_ERROR, 1) == (4, ALERT)
    servos.write(table.TORQUE_ENABLE, 1, 1)
    assert servos.read(table.TORQUE_ENABLE, 1)[0] == 0
    servos.port.writePort(list(protocol.reboot(1)))
    servos.port.wait(200)
    assert servos.read(table.HARDWARE_ERROR, 1) == (0, 0)
    servos.write(table.TORQUE_ENABLE, 1, 1)
    assert servos.first.armed


def test_indirect_data_show_what_their_addresses_name(servos: Servos) -> None:
    SDK.writeTxRx(servos.port, 1, table.INDIRECT_ADDRESS, 32, list(table.indirect_map()))
    data, result, _ = SDK.readTxRx(servos.port, 1, 208, table.READ_LENGTH)
    assert result == 0
    direct, _, _ = SDK.readTxRx(servos.port, 1, table.PRESENT_VOLTAGE, 3)
    assert list(data[-3:]) == list(direct) == [120, 0, 25]


def test_as_a_servo_it_pulls_in_proportion_to_its_error(wiring: Wiring, open_bench: Bench) -> None:
    servos = opened(
        wiring, open_bench, mode="current-based position", torque_constant=0.4, position_gain=400, zero=2048
    )
    servos.write(table.POSITION_P_GAIN, 2, 400)
    servos.write(table.TORQUE_ENABLE, 1, 1)
    servos.backend.world.plant.jam("actuator")
    servos.write(table.GOAL_POSITION, 4, 2048 + 40)
    servos.port.wait(3)
    # e-Manual: KPP = 400 / 128 units of current a count; the plant is told of the error in radians.
    assert servos.command_a() == pytest.approx(40 * table.POSITION_STEP_RAD)
    servos.write(table.GOAL_CURRENT, 2, 50)
    servos.port.wait(3)
    assert servos.command_a() == pytest.approx(50 / (400 / 128) * table.POSITION_STEP_RAD)
