"""The driver of a VESC on a serial line, against its emulated firmware where that misbehaves."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from norton_bench.rig.load import load_rig
from norton_drivers.codecs import vesc_uart
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.readings import DriveState
from norton_drivers.registry import load_backend
from norton_drivers.vesc.uart import VescUart, open_amplifier
from norton_sim.firmware.context import DriveFault

RIG = Path(__file__).parents[3] / "rigs" / "sim-vesc-uart.toml"


class Bench:
    def __init__(self, **options: Any) -> None:
        rig = load_rig(RIG, backend="simulated")
        settings = replace(rig.wiring.actuator, options={**rig.wiring.actuator.options, **options})
        wiring = replace(rig.wiring, actuator=settings)
        self.backend: Any = load_backend("simulated")(wiring, rig.simulated, seed=1, place="rig.toml")
        self.link = Link(self.backend, wiring.buses)
        self.drive: VescUart = open_amplifier(settings, self.link)
        self.firmware = self.backend.world.devices["actuator"]

    def run(self, duration_ms: int, command: float | None = 0.0, tick_ms: int = 2) -> None:
        for _ in range(duration_ms // tick_ms):
            if command is not None:
                self.drive.command(command)
            self.link.wait(tick_ms * 1_000_000)


@pytest.fixture
def bench() -> Iterator[Bench]:
    opened = Bench()
    yield opened
    opened.backend.close()


def test_a_reading_belongs_to_the_instant_of_its_question(bench: Bench) -> None:
    bench.drive.enable()
    bench.run(100)
    bench.drive.take_motion()
    bench.drive.take_current()
    bench.run(400)
    motion, current = bench.drive.take_motion(), bench.drive.take_current()
    asked = [reading.device_ns for reading in motion]
    assert all(ns is not None for ns in asked)
    assert {b - a for a, b in pairwise(asked)} == {2_000_000}
    assert [reading.device_ns for reading in current] == asked
    assert all(0.5e6 < reading.arrival_ns - reading.device_ns < 2e6 for reading in motion)


def test_a_fault_stays_until_it_is_enabled_again(bench: Bench) -> None:
    bench.drive.enable()
    bench.run(20, 1.0)
    bench.firmware.break_down(DriveFault.FAULT)
    bench.run(20, 1.0)
    assert bench.drive.status().state is DriveState.FAULT
    with pytest.raises(DeviceError, match="refuses to drive its motor: gate driver fault"):
        bench.drive.enable(0.1)
    bench.run(600, None)
    bench.drive.enable()
    assert bench.drive.status().errors == ()


def test_firmware_that_does_not_tell_of_its_timeout(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = vesc_uart.values_value
    monkeypatch.setattr(vesc_uart, "values_value", lambda values, mask: whole(values, mask)[:-1])
    bench.drive.identify()
    bench.drive.enable()
    bench.drive.provoke_watchdog()
    bench.run(1200, None)
    assert bench.drive.made_itself_safe() is None
    assert not bench.firmware.armed


def test_another_on_its_can_bus() -> None:
    bench = Bench(forward=9)
    assert bench.drive.identify().address.endswith("VESC ID 9")
    bench.drive.enable()
    bench.run(40, 1.0)
    assert bench.firmware.armed
    bench.backend.close()


def test_lost_answers_are_asked_for_again(bench: Bench) -> None:
    bench.drive.enable()
    wire = bench.backend.world.wires["actuator"]
    for _ in range(3):
        wire.cut()
        bench.run(30)
        wire.mend()
        bench.run(60)
    assert bench.drive.questions.unanswered >= 3
    bench.drive.take_motion()
    bench.run(100)
    assert len(bench.drive.take_motion()) >= 45


def test_who_is_silent_is_told_with_what_to_look_at(bench: Bench) -> None:
    bench.backend.world.wires["actuator"].cut()
    with pytest.raises(DeviceTimeoutError, match=r"App to Use in VESC Tool.* 921600"):
        bench.drive.identify(0.1)
