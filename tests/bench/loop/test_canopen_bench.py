"""The shipped CANopen bench in simulated time: two CiA 402 drives and a torque sensor under one master."""

from collections.abc import Callable, Iterator
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.procedures.waves import coasting, pushed
from norton_bench.rig.load import load_rig
from norton_bench.segments import Segment, Use
from norton_drivers.readings import DriveState
from norton_sim.firmware.cia402 import Cia402Drive
from norton_sim.firmware.context import DriveFault
from tests.bench.bench_in_simulation import Bench, opened

RIG = Path(__file__).parents[3] / "rigs" / "sim-cia402.toml"
WATCHDOG_NS = 300_000_000
TICK_NS = 1_000_000


@pytest.fixture
def bench() -> Iterator[Bench]:
    with opened(load_rig(RIG)) as made:
        yield made


def firmware(bench: Bench, role: str) -> Any:
    return bench.backend.world.devices[role]


def drives(bench: Bench) -> list[Cia402Drive]:
    return [firmware(bench, role) for role in ("actuator", "load")]


def armed(bench: Bench) -> list[bool]:
    return [drive.armed for drive in drives(bench)]


def resting(duration_s: float = 0.5) -> Segment:
    return coasting("test", "rest", Use.PREPARE, np.zeros(round(duration_s * 1e3)))


def run(bench: Bench, segment: Segment) -> None:
    with bench.loop.running():
        bench.loop.run(segment)


@pytest.mark.long
def test_segments_one_after_the_other(bench: Bench) -> None:
    """Between them the drives are idle for as long as it takes, and have no reason to complain of the silence."""
    for _ in range(3):
        run(bench, pushed("test", "push", Use.PREPARE, np.full(300, 0.03)))
        assert armed(bench) == [False, False]
        bench.backend.world.advance(bench.backend.world.now_ns + 10 * WATCHDOG_NS)
        assert [drive.error for drive in drives(bench)] == [0, 0]
    torque = np.concatenate([part.torque["arrival_ns"] for part in bench.parts])
    assert len(torque) == pytest.approx(900, abs=100)


def test_heartbeats_lost_in_full_buffers_are_waited_for_before_anything_is_enabled(bench: Bench) -> None:
    """While a controller is designed nobody reads, and a system keeps the oldest frames, not the newest."""
    run(bench, resting(0.2))
    bench.backend.world.advance(bench.backend.world.now_ns + WATCHDOG_NS + 10 * TICK_NS)
    for inbox in bench.backend._can_wires["can0"]._inboxes:
        inbox.clear()
    bench.devices.await_streams()
    now_ns = bench.backend.clock.now_ns()
    for drive in bench.devices.drives:
        heard_ns = drive.status().heartbeat_ns
        assert heard_ns is not None
        assert now_ns - heard_ns < drive.heartbeat_timeout_ns / 2
    bench.cut("load")
    bench.backend.world.advance(bench.backend.world.now_ns + WATCHDOG_NS)
    with pytest.raises(ExperimentError, match=r"no readings from: .*load drive's heartbeat"):
        run(bench, resting(0.2))
    assert armed(bench) == [False, False]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (lambda b: b.cut("torque_sensor"), "torque sensor: silent"),
        (lambda b: b.cut("actuator"), "actuator encoder: silent"),
        (lambda b: b.cut("load"), "load encoder: silent"),
        (lambda b: firmware(b, "torque_sensor").signal.force(1.5), "port torque"),
        (lambda b: firmware(b, "torque_sensor").signal.force(nan), "port torque"),
        (lambda b: setattr(firmware(b, "torque_sensor"), "status", 0x04), "port torque"),
        (lambda b: firmware(b, "torque_sensor").node.restart(), "torque sensor: silent"),
        (lambda b: firmware(b, "load").break_down(DriveFault.UNDERVOLTAGE), "load drive: .*bus voltage too low"),
        (lambda b: firmware(b, "actuator").break_down(DriveFault.FAULT), "actuator drive: .*over-current"),
        (lambda b: firmware(b, "actuator").node.restart(), "actuator drive: .*it restarted by itself"),
        (lambda b: b.devices.actuator.node.order(0x02), "actuator drive: "),  # type: ignore[attr-defined]
    ],
)
def test_a_fault_stops_everything(bench: Bench, fault: Callable[[Bench], None], words: str) -> None:
    bench.after(0.3, lambda: fault(bench))
    with pytest.raises(SafetyStopError, match=words):
        run(bench, resting(1.0))
    bench.backend.world.advance(bench.backend.world.now_ns + WATCHDOG_NS + 2 * TICK_NS)
    assert armed(bench) == [False, False]


def test_a_host_that_dies_leaves_the_drives_to_their_watchdogs(bench: Bench) -> None:
    bench.devices.await_streams()
    bench.devices.enable()
    assert armed(bench) == [True, True]
    bench.backend.world.advance(bench.backend.world.now_ns + WATCHDOG_NS + 2 * TICK_NS)
    assert armed(bench) == [False, False]


def test_a_loop_that_stands_still_is_a_host_that_dies(bench: Bench) -> None:
    """Polling goes on, and with it all that is not a command."""
    bench.devices.await_streams()
    bench.devices.enable()
    for _ in range(WATCHDOG_NS // TICK_NS + 2):
        bench.devices.link.wait(TICK_NS)
    assert armed(bench) == [False, False]


def test_the_watchdogs_are_seen_to_act_and_the_drives_come_back(bench: Bench) -> None:
    bench.devices.await_streams()
    bench.devices.enable()
    for drive in bench.devices.drives:
        drive.provoke_watchdog()
    begun_ns = bench.devices.clock.now_ns()
    while not all(drive.made_itself_safe() for drive in bench.devices.drives):
        bench.devices.link.wait(TICK_NS)
        assert bench.devices.clock.now_ns() - begun_ns < WATCHDOG_NS + 10 * TICK_NS
    assert armed(bench) == [False, False]
    bench.devices.enable()
    assert armed(bench) == [True, True]
    bench.devices.stop()
    assert [drive.status().state for drive in bench.devices.drives] == [DriveState.IDLE] * 2


def test_the_next_host_finds_drives_that_are_well(bench: Bench) -> None:
    bench.devices.await_streams()
    bench.devices.enable()
    bench.backend.world.advance(bench.backend.world.now_ns + 10 * WATCHDOG_NS)
    assert [drive.error for drive in drives(bench)] == [0x8130] * 2
    for drive in bench.devices.drives:
        drive.set_up()  # type: ignore[attr-defined]  # as when the bench is opened
    bench.devices.link.wait(5 * TICK_NS)
    assert [drive.status().state for drive in bench.devices.drives] == [DriveState.IDLE] * 2
    assert [drive.error for drive in drives(bench)] == [0, 0]
