"""Benches with a torque sensor on a serial line and drives of either firmware: checked, run, and stopped."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from norton_bench.check.check import check_rig
from norton_bench.errors import SafetyStopError
from norton_bench.procedures.waves import pushed
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use
from norton_sim.firmware.dyn200 import Dyn200Sensor
from norton_sim.firmware.odrive import ODriveAxis
from norton_sim.firmware.odrive_05 import ODrive05Axis
from norton_sim.firmware.serial_sensors import AsciiSensor, MantracourtSensor
from tests.bench.bench_in_simulation import Bench, opened

RIG = Path(__file__).parents[3] / "rigs" / "sim-dyn200.toml"
PUSHED = """mode = "push"                       # active upload, mode 0; "polled" asks by Modbus RTU
torque_per_digit = "1 mN*m"         # by its model and its decimals: a wrong one is a silent error of scale
"""
FIRMWARE = 'firmware = "0.6"'
# What stands in the rig file for what, and how many readings of torque a second that makes.
VARIANTS = {
    "pushed": ({}, 1000),
    "polled": ({PUSHED: 'mode = "polled"\ntorque_per_digit = "1 mN*m"\n'}, 200),
    "polled without silence": ({PUSHED: 'mode = "polled"\ntorque_per_digit = "1 mN*m"\nsilence = "0 s"\n'}, 333),
    "ascii": ({'"dyn200"': '"ascii"', PUSHED: 'scale = 1\nunit = "Nm"\nwidth = 11\n'}, 500),
    "mantracourt": ({'"dyn200"': '"mantracourt"', PUSHED: 'scale = 0.001\nwidth = 10\naveraging = "2 ms"\n'}, 280),
    "0.5": ({FIRMWARE: 'firmware = "0.5"'}, 1000),
    "0.5 counting": ({FIRMWARE: 'firmware = "0.5"\nposition = "counts"'}, 1000),
    "0.5 asked": ({FIRMWARE: 'firmware = "0.5"\nask = true'}, 1000),
}


def rig_of(name: str) -> Rig:
    text = RIG.read_text()
    for written, instead in VARIANTS[name][0].items():
        assert written in text
        text = text.replace(written, instead)
    return parse_rig(text, place=f"{name}.toml")


@pytest.fixture(params=["polled", "ascii", "mantracourt", "0.5 asked"])
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    with opened(rig_of(request.param)) as made:
        yield made


def pulling(duration_s: float) -> Segment:
    return pushed("test", "pull", Use.PREPARE, np.full(round(duration_s * 1e3), -0.1))


def run(bench: Bench, segment: Segment) -> None:
    with bench.loop.running():
        bench.loop.run(segment)


def armed(bench: Bench) -> list[str]:
    devices = {role: bench.backend.world.devices[role] for role in ("actuator", "load")}
    return [role for role, axis in devices.items() if isinstance(axis, ODriveAxis | ODrive05Axis) and axis.armed]


@pytest.mark.parametrize("name", VARIANTS)
def test_a_check_finds_nothing_wrong_and_the_rate_that_is_to_be_expected(name: str) -> None:
    found = check_rig(rig_of(name), watch_s=0.5)
    assert list(map(str, found.problems())) == []
    checks = {check.role: check for check in found.devices}
    (torque,) = checks["torque_sensor"].streams
    assert torque.rate_hz == pytest.approx(VARIANTS[name][1], rel=0.03)
    assert {stream.name for stream in checks["actuator"].streams} == {"motion", "current"}


def test_a_segment_runs_and_its_torque_is_the_ports(bench: Bench) -> None:
    run(bench, pulling(0.5))
    assert armed(bench) == []
    torque = np.concatenate([part.torque for part in bench.parts])
    # The load pulls the actuator along: what passes the port is a part of its 0.095 N m.
    assert 0.03 < np.mean(torque["torque_nm"][-50:]) < 0.09
    assert torque["valid"].all()
    assert all(later > earlier for earlier, later in pairwise(torque["arrival_ns"]))


def test_a_sensor_that_falls_silent_stops_everything(bench: Bench) -> None:
    bench.after(0.2, lambda: bench.cut("torque_sensor"))
    with pytest.raises(SafetyStopError, match="torque sensor: silent"):
        run(bench, pulling(1.0))
    assert armed(bench) == []


@pytest.mark.parametrize(("torque_nm", "shown"), [(1.5, "1.5 N m is outside"), (5.0, "is no number")])
def test_too_much_torque_stops_everything_be_it_beyond_the_sensors_range(
    bench: Bench, torque_nm: float, shown: str
) -> None:
    sensor = bench.backend.world.devices["torque_sensor"]
    assert isinstance(sensor, AsciiSensor | Dyn200Sensor | MantracourtSensor)
    bench.after(0.2, lambda: sensor.signal.force(torque_nm))
    with pytest.raises(SafetyStopError, match=f"port torque: {shown}"):
        run(bench, pulling(1.0))
    assert armed(bench) == []
