"""The bench of rigs/sim-odrive.toml, opened in simulated time."""

import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from norton_drivers.wiring import CanBusSettings, DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend, open_backend

RIG = Path(__file__).parents[2] / "rigs" / "sim-odrive.toml"


@pytest.fixture
def simulated() -> dict[str, Any]:
    """The rig's true values, as written."""
    return tomllib.loads(RIG.read_text())["simulated"]


@pytest.fixture
def wiring() -> Wiring:
    """Two ODrives and a Bota sensor."""
    return Wiring(
        name="bench",
        tick_ns=1_000_000,
        buses=(CanBusSettings("can0", "udp_multicast", "239.74.163.2"),),
        actuator=DeviceSettings("actuator", "odrive", bus="can0", options={"node": 1}),
        torque_sensor=DeviceSettings("torque_sensor", "bota", port="/tmp/bota", options={"axis": "z"}),
        load=DeviceSettings("load", "odrive", bus="can0", direction=-1, options={"node": 2}),
    )


@pytest.fixture
def dbc_wiring(wiring: Wiring) -> Wiring:
    """The same with the shipped DBC sensor."""
    options = {"counter": "Counter", "status": "Status"}
    return replace(wiring, torque_sensor=DeviceSettings("torque_sensor", "dbc", bus="can0", options=options))


@pytest.fixture
def open_bench(simulated: dict[str, Any]) -> Iterator[Callable[..., SimulatedBackend]]:
    """``open_bench(wiring, seed=1, **changed_tables)``; closed at the test's end."""
    opened = []

    def open_it(wiring: Wiring, seed: int = 1, **tables: Any) -> SimulatedBackend:
        opened.append(open_backend(wiring, {**simulated, **tables}, seed=seed, place="rig.toml"))
        return opened[-1]

    yield open_it
    for backend in opened:
        backend.close()
