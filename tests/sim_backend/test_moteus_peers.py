"""The maker's own host drives the emulated moteus in wall time: through python-can, and by the fdcanusb's protocol."""

import asyncio
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from random import SystemRandom

import moteus
import pytest

from norton_bench.rig.load import load_rig
from norton_drivers.wiring import CanBusSettings
from norton_sim.serve import serve

pytestmark = pytest.mark.wall_time
RIG = Path(__file__).parents[2] / "rigs" / "sim-moteus.toml"
FD = {"fd": True, "data_bitrate_bit_s": 5_000_000}


@contextmanager
def served(bus: CanBusSettings) -> Iterator[None]:
    """The rig's actuator alone, on this bus."""
    rig = load_rig(RIG)
    wiring = replace(rig.wiring, buses=(bus,), load=None, torque_sensor=None)
    ready, over = threading.Event(), threading.Event()
    told = {"seed": 1, "place": "here", "on_ready": ready.set, "stop": over.is_set}
    thread = threading.Thread(target=serve, args=(wiring, rig.simulated), kwargs=told, daemon=True)
    thread.start()
    try:
        assert ready.wait(20)
        yield
    finally:
        over.set()
        thread.join(10)


def own_group() -> str:
    return "239.75." + ".".join(str(SystemRandom().randrange(1, 255)) for _ in range(2))


async def told_by(controller: moteus.Controller, happens: Callable[[dict[int, float]], bool], torque_nm: float) -> bool:
    """Command a torque at 100 Hz until what is told is as it should be."""
    deadline_s = time.monotonic() + 20
    while time.monotonic() < deadline_s:
        result = await asyncio.wait_for(
            controller.set_position(
                position=math.nan, feedforward_torque=torque_nm, kp_scale=0.0, kd_scale=0.0, watchdog_timeout=1.0,
                query=True,
            ),
            5,
        )  # fmt: skip
        if happens(result.values):
            return True
        await asyncio.sleep(0.01)
    return False


async def drives_it(controller: moteus.Controller) -> None:
    await controller.set_stop()
    query = await asyncio.wait_for(controller.query(), 5)
    assert query.values[moteus.Register.MODE] == moteus.Mode.STOPPED
    assert query.values[moteus.Register.VOLTAGE] == 24.0
    assert await told_by(controller, lambda told: told[moteus.Register.MODE] == moteus.Mode.POSITION, 0.0)
    assert await told_by(controller, lambda told: told[moteus.Register.VELOCITY] > 1.0, 0.1)
    assert await told_by(controller, lambda told: told[moteus.Register.VELOCITY] < -1.0, -0.1)
    stopped = await asyncio.wait_for(controller.set_stop(query=True), 5)
    assert stopped.values[moteus.Register.TORQUE] == pytest.approx(-0.09, abs=0.02)
    query = await asyncio.wait_for(controller.query(), 5)
    assert query.values[moteus.Register.MODE] == moteus.Mode.STOPPED


def test_over_python_can() -> None:
    group, port = own_group(), SystemRandom().randrange(30_000, 60_000)

    async def run() -> None:
        with closing(moteus.PythonCan(interface="udp_multicast", channel=group, port=port, fd=True)) as transport:
            await drives_it(moteus.Controller(id=1, transport=transport))

    with served(CanBusSettings("can0", "udp_multicast", group, options={"port": port}, **FD)):
        asyncio.run(run())


def test_over_the_fdcanusbs_protocol(tmp_path: Path) -> None:
    path = str(tmp_path / "uart")

    async def run() -> None:
        with closing(moteus.Fdcanusb(path)) as transport:
            await drives_it(moteus.Controller(id=1, transport=transport))

    # A moteus' own UART: the maker's host wants checksums of what is no adapter of theirs by its USB numbers.
    with served(CanBusSettings("can0", "fdcanusb", path, options={"uart": True}, **FD)):
        asyncio.run(run())
