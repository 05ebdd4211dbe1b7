"""Servo makers' own libraries on pseudo-terminals: they drive emulated servos that another process serves."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import dynamixel_sdk
import pytest
import scservo_sdk
from scservo_sdk.port_handler import PortHandler as FeetechPort

from norton_bench.rig.load import load_rig
from norton_drivers.dynamixel import table
from norton_drivers.feetech import table as feetech
from tests.bench.served import served

pytestmark = pytest.mark.wall_time

RIG = Path(__file__).parents[2] / "rigs" / "sim-dynamixel.toml"
FEETECH = """[load]
driver = "feetech"
port = "FOLDER/feetech"
type = "STS3215"
node = 2
mode = "torque"
stall_torque = "1.9 N*m"
direction = -1
torque_limit = "1.5 N*m"

"""
# They wait for 34 ms, and a process on a busy computer may stand still for longer; nor does a shaft move at once.
WITHIN_S = 3.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where the lines of a Dynamixel and of a Feetech servo stand, shaft to shaft."""
    folder = tmp_path_factory.mktemp("lines")
    text = RIG.read_text(encoding="utf-8")
    begin, end = text.index("[load]"), text.index("[torque_sensor]")
    text = text[:begin] + FEETECH + text[end:]
    bus, actuator = text.index("[bus.can0]"), text.index("[actuator]")
    text = text[:bus] + text[actuator:]
    lines = {"socket://localhost:7711": "dynamixel", "socket://localhost:7712": "bota"}
    for address, name in lines.items():
        text = text.replace(address, str(folder / name))
    text = text.replace("4_000_000", "1_000_000").replace("FOLDER", str(folder))
    (folder / "rig.toml").write_text(text)
    with served(load_rig(folder / "rig.toml", backend="hardware")):
        yield folder


@contextmanager
def opened(port: Any) -> Iterator[Any]:
    port.baudrate = 1_000_000
    assert port.openPort()
    with closing(port.ser):
        yield port


def again(ask: Callable[[], Any], good: Callable[[Any], bool]) -> Any:
    """The first good answer. The makers' libraries trip over one that a busy machine cuts short."""
    said, deadline_s = None, time.monotonic() + WITHIN_S
    while time.monotonic() < deadline_s:
        try:
            said = ask()
        except IndexError as error:
            said = error
            continue
        if good(said):
            return said
    raise AssertionError(f"never answered as it should: {said}")


@pytest.mark.long
def test_robotis_library_enables_moves_and_reads_a_servo(folder: Path) -> None:
    sdk: Any = dynamixel_sdk.PacketHandler(2.0)
    with opened(dynamixel_sdk.PortHandler(str(folder / "dynamixel"))) as port:
        again(lambda: sdk.ping(port, 1), lambda said: said == (1030, 0, 0))
        again(lambda: sdk.write1ByteTxRx(port, 1, table.TORQUE_ENABLE, 1), lambda said: said == (0, 0))
        goals = dynamixel_sdk.GroupSyncWrite(port, sdk, table.GOAL_CURRENT, 2)
        goals.addParam(1, [200, 0])
        assert goals.txPacket() == 0
        group = dynamixel_sdk.GroupSyncRead(port, sdk, table.PRESENT_VELOCITY, 8)
        group.addParam(1)
        for read in (group.txRxPacket, group.fastSyncRead):
            again(lambda: read() == 0 and group.getData(1, table.PRESENT_VELOCITY, 4), lambda speed: 5 < speed < 1000)  # noqa: B023
        again(lambda: sdk.write1ByteTxRx(port, 1, table.TORQUE_ENABLE, 0), lambda said: said == (0, 0))


def test_feetechs_library_enables_moves_and_reads_a_servo(folder: Path) -> None:
    sdk: Any = scservo_sdk.PacketHandler(0)
    with opened(FeetechPort(str(folder / "feetech"))) as port:
        again(lambda: sdk.ping(port, 2), lambda said: said == (777, 0, 0))
        for address, value in ((feetech.MODE, 2), (feetech.TORQUE_ENABLE, 1)):
            again(lambda: sdk.write1ByteTxRx(port, 2, address, value), lambda said: said == (0, 0))  # noqa: B023
        again(lambda: sdk.write2ByteTxRx(port, 2, feetech.GOAL_PWM, 300), lambda said: said == (0, 0))
        group = scservo_sdk.GroupSyncRead(port, sdk, feetech.PRESENT_POSITION, 4)
        group.addParam(2)
        speed = lambda: group.txRxPacket() == 0 and group.getData(2, feetech.PRESENT_SPEED, 2)  # noqa: E731
        again(speed, lambda said: 20 < said < 4096)
        again(lambda: sdk.write1ByteTxRx(port, 2, feetech.TORQUE_ENABLE, 0), lambda said: said == (0, 0))
