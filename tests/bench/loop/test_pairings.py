"""Any amplifier against any other: enabled, driven, stopped, and each fault of each noticed."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from math import inf
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import SafetyStopError
from norton_bench.procedures.waves import pushed
from norton_bench.rig.load import parse_rig
from norton_bench.segments import Segment, Use
from norton_drivers.readings import DriveState
from norton_sim.firmware.context import DriveFault
from tests.bench.bench_in_simulation import Bench, opened

RIG = (Path(__file__).parents[3] / "rigs" / "sim-odrive.toml").read_text()
MIT = """driver = "mit"
position_range = "12.5 rad"
velocity_range = "100 rad/s"
torque_range = "2 N*m"
beyond_range = "wraps"
watchdog = "300 ms"
"""
VESC = """driver = "vesc"
pole_pairs = 7
mode = "torque"
torque_constant = "0.05 N*m/A"
minimum_current = "0.01 A"
watchdog = "500 ms"
"""
ODRIVE = """driver = "odrive"
watchdog = "300 ms"
"""
DRIVERS = {"odrive": ODRIVE, "vesc": VESC, "mit": MIT}
PAIRS = [pair for pair in product(DRIVERS, DRIVERS) if pair != ("odrive", "odrive")]


def rig_text(actuator: str, load: str) -> str:
    """The bench of rigs/sim-odrive.toml with other drives."""
    head, _, rest = RIG.partition("[actuator]")
    _, _, rest = rest.partition("[torque_sensor]")
    command = 'command = { unit = "N*m", limit = "0.5 N*m" }'
    return (
        f'{head}[actuator]\nbus = "can0"\nnode = 1\n{DRIVERS[actuator]}{command}\n\n'
        f'[load]\nbus = "can0"\nnode = 2\ndirection = -1\ntorque_limit = "1 N*m"\n{DRIVERS[load]}\n'
        f"[torque_sensor]{rest}"
    )


@contextmanager
def bench_of(actuator: str, load: str) -> Iterator[Bench]:
    with opened(parse_rig(rig_text(actuator, load), place=f"{actuator} and {load}")) as bench:
        yield bench


def pushing(load_nm: float, command: float, duration_s: float = 0.4) -> Segment:
    ticks = round(duration_s * 1e3)
    return pushed("test", "push", Use.PREPARE, np.full(ticks, load_nm), np.full(ticks, command))


@pytest.mark.parametrize(("actuator", "load"), PAIRS)
def test_both_push_and_both_are_idle_in_the_end(actuator: str, load: str) -> None:
    with bench_of(actuator, load) as bench:
        for drive in bench.devices.drives:
            drive.identify()
        with bench.loop.running():
            ticks = bench.loop.run(pushing(0.02, 0.05)).ticks
            assert bench.armed() == ["actuator", "load"]
        assert bench.armed() == []
        assert [drive.status().state for drive in bench.devices.drives] == [DriveState.IDLE] * 2
        last = ticks[-1]
        assert 5 < last["velocity_rad_s"] < 70
        assert last["load_velocity_rad_s"] == pytest.approx(last["velocity_rad_s"], rel=0.05)
        # Both count from where they were switched on, and go the same way.
        travelled = [last[name] - ticks[0][name] for name in ("position_rad", "load_position_rad")]
        assert travelled[1] == pytest.approx(travelled[0], abs=0.15)
        assert [drive.malformed for drive in bench.devices.drives] == [0, 0]  # type: ignore[attr-defined]


@pytest.mark.parametrize("fault", DriveFault)
@pytest.mark.parametrize(
    ("driver", "role"), [("vesc", "actuator"), ("vesc", "load"), ("mit", "actuator"), ("mit", "load")]
)
def test_every_fault_stops_the_bench(driver: str, role: str, fault: DriveFault) -> None:
    pair = (driver, "odrive") if role == "actuator" else ("odrive", driver)
    with bench_of(*pair) as bench:
        firmware = bench.backend.world.devices[role]
        bench.after(0.3, lambda: firmware.break_down(fault))  # type: ignore[attr-defined]
        with pytest.raises(SafetyStopError, match=f"{role} drive: left its torque loop"), bench.loop.running():
            bench.loop.run(pushing(0.05, 0.1))
        assert bench.armed() == []


@pytest.mark.parametrize("driver", ["vesc", "mit"])
@pytest.mark.parametrize("role", ["actuator", "load"])
def test_a_pulled_plug_stops_the_bench_and_the_drives_timeout_the_drive(driver: str, role: str) -> None:
    pair = (driver, "odrive") if role == "actuator" else ("odrive", driver)
    with bench_of(*pair) as bench:
        bench.after(0.3, lambda: bench.cut(role))
        with pytest.raises(SafetyStopError, match=f"{role} encoder: silent"), bench.loop.running():
            bench.loop.run(pushing(0.05, 0.1, 1.0))
        bench.backend.world.advance(bench.backend.world.now_ns + 600_000_000)
        assert abs(bench.backend.world.plant.true_current_a(role)) < 0.02  # type: ignore[arg-type]


@pytest.mark.parametrize("role", ["actuator", "load"])
def test_a_position_at_the_end_of_its_range_stops_the_bench(role: str) -> None:
    pair = ("mit", "odrive") if role == "actuator" else ("odrive", "mit")
    text = rig_text(*pair).replace('beyond_range = "wraps"', 'beyond_range = "saturates"')
    rig = parse_rig(text.replace('position = "unlimited"', 'position = "12.5 rad"'), place="saturating")
    # Where the drive's zero is not where the shaft stood, no window keeps it from the end of what it can tell.
    rig = replace(rig, limits=replace(rig.limits, position_rad=inf))
    with (
        opened(rig) as bench,
        pytest.raises(SafetyStopError, match=f"{role} drive: .*the position is at the end of its range of ±12.5 rad"),
        bench.loop.running(),
    ):
        bench.loop.run(pushing(0.05, 0.1, 3.0))
    assert bench.armed() == []


@pytest.mark.parametrize(
    ("driver", "probe"), [("vesc", 'watchdog_probe = "0.3 A"\n'), ("mit", 'watchdog_probe = "10 mN*m"\n')]
)
@pytest.mark.parametrize("works", [True, False])
def test_the_timeout_is_seen_at_work_without_moving_the_shaft(driver: str, probe: str, works: bool) -> None:
    text = rig_text(driver, "odrive").replace(DRIVERS[driver], DRIVERS[driver] + probe)
    with opened(parse_rig(text, place="probed")) as bench:
        actuator, link = bench.devices.actuator, bench.devices.link
        if not works:  # the drive's own setting is another than the rig's
            firmware = bench.backend.world.devices["actuator"]
            timed = firmware.motor.amplifier if driver == "vesc" else firmware  # type: ignore[attr-defined]
            timed.timeout_s = 0.0  # type: ignore[attr-defined]
        actuator.enable()
        start_rad = bench.backend.world.plant.true_position_rad("actuator")
        actuator.provoke_watchdog()
        for _ in range(round(actuator.watchdog_s * 1000) + 150):
            link.wait()
        assert actuator.made_itself_safe() is works
        assert abs(bench.backend.world.plant.true_position_rad("actuator") - start_rad) < 5e-3
        actuator.stop()
