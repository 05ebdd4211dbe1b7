"""Faults injected into the simulated world: each is noticed by its guard, and each ends with both drives idle."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import BenchError, OperatorStopError, RigError, SafetyStopError, UsageError
from norton_bench.procedures.waves import coasting, pushed
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Command
from norton_bench.segments import Segment, Use
from norton_drivers.errors import ConnectionFailedError, DeviceError
from norton_drivers.readings import DriveState
from norton_sim.faults.schema import DriveError, Dropout, FalseReading, Fault, Unplugged
from tests.bench.bench_in_simulation import Bench, opened

RIG = Path(__file__).parents[3] / "rigs" / "sim-odrive.toml"
WATCHDOG_NS = 310_000_000  # the rig's 300 ms, and what is on its way


MakeBench = Callable[..., Bench]


@pytest.fixture
def make_bench() -> Iterator[MakeBench]:
    with ExitStack() as stack:
        rig = load_rig(RIG)
        yield lambda **limits: stack.enter_context(opened(replace(rig, limits=replace(rig.limits, **limits))))


def resting(duration_s: float = 1.0) -> Segment:
    return coasting("test", "rest", Use.PREPARE, np.zeros(round(duration_s * 1e3)))


def pushing(torque_nm: float, duration_s: float = 1.0) -> Segment:
    return pushed("test", "push", Use.PREPARE, np.full(round(duration_s * 1e3), torque_nm))


def run(bench: Bench, segment: Segment) -> None:
    with bench.loop.running():
        bench.loop.run(segment)


def test_an_undisturbed_segment_ends_with_idle_drives_and_every_tick_put_away(make_bench: MakeBench) -> None:
    bench = make_bench()
    run(bench, resting())
    assert bench.armed() == []
    assert all(drive.status().state is DriveState.IDLE for drive in bench.devices.drives)
    assert sum(len(part.ticks) for part in bench.parts) == 1000


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Dropout(on="torque_sensor", at_s=0.3), "torque sensor: silent"),
        (Dropout(on="actuator", at_s=0.3), "actuator encoder: silent"),
        (Dropout(on="load", at_s=0.3), "load encoder: silent"),
        (DriveError(on="actuator", at_s=0.3), "actuator drive: left its torque loop"),
        (DriveError(on="load", at_s=0.3), "load drive: left its torque loop"),
        (FalseReading(on="torque_sensor", at_s=0.3, torque_nm=1.5), "port torque"),
        (FalseReading(on="torque_sensor", at_s=0.3, torque_nm=nan), "port torque"),
    ],
)
def test_a_fault_stops_everything(make_bench: MakeBench, fault: Fault, words: str) -> None:
    bench = make_bench()
    bench.backend.inject(fault)
    with pytest.raises(SafetyStopError, match=words):
        run(bench, resting())
    bench.backend.world.advance(bench.backend.world.now_ns + WATCHDOG_NS)
    assert bench.armed() == []


@pytest.mark.parametrize(
    ("limits", "segment", "words"),
    [
        ({"velocity_rad_s": 5.0}, pushing(0.2), "velocity"),
        ({"position_rad": 0.5}, pushing(0.2), "travel"),
        ({"torque_nm": 0.02}, pushing(0.3), "port torque"),
        ({"power_w": 0.05}, pushing(0.3), "port power"),
        ({"temperature_c": 20.0}, resting(), "above .limits. temperature"),
        ({"stale_after_ns": 10_000}, resting(), "silent"),
    ],
)
def test_each_limit_is_held_on_the_moving_bench(
    make_bench: MakeBench, limits: dict[str, float], segment: Segment, words: str
) -> None:
    bench = make_bench(**limits)
    with pytest.raises(SafetyStopError, match=words):
        run(bench, segment)
    assert bench.armed() == []


def test_a_bench_that_tripped_is_not_enabled_again_before_an_operator_says_so(make_bench: MakeBench) -> None:
    bench = make_bench(velocity_rad_s=5.0)
    with pytest.raises(SafetyStopError, match="velocity"):
        run(bench, pushing(0.2))
    stopped_ns = bench.backend.world.now_ns
    with pytest.raises(SafetyStopError, match=r"nothing is enabled again .*; it was: actuator velocity"):
        run(bench, resting(0.1))
    assert bench.backend.world.now_ns == stopped_ns
    with pytest.raises(UsageError, match="say who looked"):
        bench.loop.reset_guard(" ")
    bench.loop.reset_guard("N. Hogan: pushed too hard, all well")
    run(bench, resting(0.1))
    events = [(event.kind, event.text) for part in bench.parts for event in part.events]
    assert [kind for kind, _ in events] == ["stop", "operator"]
    assert events[1][1].startswith("reset the guard (N. Hogan: pushed too hard, all well) after: ")
    assert "velocity" in events[1][1]


def test_a_command_that_is_no_number_never_reaches_the_wire(make_bench: MakeBench) -> None:
    bench = make_bench()
    segment = coasting("test", "broken", Use.PREPARE, np.array([0.0, 0.01, nan]))
    with pytest.raises(SafetyStopError, match="not a number"):
        run(bench, segment)
    assert bench.armed() == []
    assert np.isfinite(bench.parts[-1].ticks["command"]).all()


def test_the_operator_stops_within_a_tick(make_bench: MakeBench) -> None:
    bench = make_bench()
    pressed_ns = bench.backend.clock.now_ns() + 600_000_000
    bench.loop.stop_request = lambda: "space" if bench.backend.clock.now_ns() >= pressed_ns else None
    with pytest.raises(OperatorStopError, match="space"):
        run(bench, pushing(0.05))
    last_ns = max(int(part.ticks["tick_ns"][-1]) for part in bench.parts if len(part.ticks))
    assert last_ns < pressed_ns + bench.rig.tick_ns
    assert bench.armed() == []


def test_a_host_that_dies_leaves_the_drives_to_their_watchdogs(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.devices.await_streams()
    bench.devices.enable()
    assert bench.armed() == ["actuator", "load"]
    bench.backend.world.advance(bench.backend.world.now_ns + WATCHDOG_NS + bench.rig.tick_ns)
    assert bench.armed() == []


def test_a_bug_in_the_experiment_leaves_the_drives_idle_too(make_bench: MakeBench) -> None:
    bench = make_bench()
    segment = replace(resting(0.1), command=np.array(["not a command"]))
    with pytest.raises(ValueError, match="could not convert"):
        run(bench, segment)
    assert bench.armed() == []


def test_a_lost_bus_is_a_connection_error_and_the_watchdogs_do_the_rest(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.backend.inject(Unplugged(on="can0", at_s=0.3))
    with pytest.raises(ConnectionFailedError, match="can0"):
        run(bench, resting())
    bench.backend.world.advance(bench.backend.world.now_ns + WATCHDOG_NS)
    assert bench.armed() == []


@pytest.mark.parametrize("unit", ["mN*m", "A"])
def test_a_command_in_a_unit_that_the_drive_does_not_take_is_refused(unit: str) -> None:
    rig = load_rig(RIG)
    with pytest.raises(RigError, match=r'commands in "N\*m"'), opened(replace(rig, command=Command(unit, 0.5))):
        pass


def test_a_device_that_is_missing_is_named_before_anything_moves(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.backend.inject(Dropout(on="torque_sensor"))
    with pytest.raises((BenchError, DeviceError), match="torque sensor"):
        run(bench, resting())
    assert bench.armed() == []
