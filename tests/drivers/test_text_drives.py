"""The drivers of ODrives and SimpleFOC boards on serial lines, where these misbehave."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from norton_bench.rig.load import load_rig
from norton_drivers.errors import DeviceError, WiringError
from norton_drivers.link import Link
from norton_drivers.readings import DriveState
from norton_drivers.registry import load_backend, open_amplifier
from norton_sim.firmware.context import DriveFault

RIGS = Path(__file__).parents[2] / "rigs"


class Bench:
    def __init__(self, rig_file: str, role: str = "actuator", **options: Any) -> None:
        rig = load_rig(RIGS / rig_file, backend="simulated")
        settings = getattr(rig.wiring, role)
        settings = replace(settings, options={**settings.options, **options})
        self.backend: Any = load_backend("simulated")(rig.wiring, rig.simulated, seed=1, place="rig.toml")
        self.link = Link(self.backend, rig.wiring.buses)
        self.drive: Any = open_amplifier(settings, self.link)
        self.firmware = self.backend.world.devices[role]
        self.wire = self.backend.world.wires[role]

    def run(self, duration_ms: int, command: float | None = 0.0, tick_ms: int = 2) -> None:
        for _ in range(duration_ms // tick_ms):
            if command is not None:
                self.drive.command(command)
            self.link.wait(tick_ms * 1_000_000)


@pytest.fixture
def bench() -> Iterator[Callable[..., Bench]]:
    opened: list[Bench] = []

    def open_it(*args: Any, **options: Any) -> Bench:
        opened.append(Bench(*args, **options))
        return opened[-1]

    yield open_it
    for each in opened:
        each.backend.close()


ODRIVE, SIMPLEFOC = "sim-odrive-uart.toml", "sim-simplefoc.toml"


def test_an_odrives_readings_come_in_every_tick(bench: Callable[..., Bench]) -> None:
    here = bench(ODRIVE)
    here.drive.enable()
    here.run(100)
    here.drive.take_motion()
    here.drive.take_current()
    here.run(1000)
    motion = here.drive.take_motion()
    assert len(motion) in (499, 500)
    assert 18 <= len(here.drive.take_current()) <= 22
    assert all(0 < reading.arrival_ns - reading.device_ns < 2e6 for reading in motion)
    status = here.drive.status()
    assert status.bus_voltage_v == 24.0
    assert status.transistor_temperature_c == pytest.approx(25, abs=2)


def test_a_bench_that_reads_ahead_asks_no_more_often(bench: Callable[..., Bench]) -> None:
    """A loop looks at its ports again and again just before a tick; readings must come evenly nevertheless."""
    here = bench(ODRIVE)
    here.drive.enable()
    here.run(100)
    here.drive.take_motion()
    for _ in range(500):
        here.drive.command(0.0)
        here.link.poll()
        for part_us in (1600, 100, 100, 100, 100):
            here.link.clock.wait_until_ns(here.link.clock.now_ns() + 1000 * part_us)
            here.link.read_ahead()
    asked_ns = [reading.device_ns for reading in here.drive.take_motion()]
    assert {after - before for before, after in pairwise(asked_ns[1:])} == {2_000_000}


@pytest.mark.parametrize(("role", "words"), [("actuator", "bus voltage too low"), ("load", "system-level fault")])
def test_an_odrive_that_fails_says_why(bench: Callable[..., Bench], role: str, words: str) -> None:
    here = bench(ODRIVE, role)
    here.drive.enable()
    here.run(50)
    here.firmware.break_down(DriveFault.UNDERVOLTAGE)
    for _ in range(200):
        here.run(2)
        if (status := here.drive.status()).state is DriveState.FAULT:
            break
    assert status.state is DriveState.FAULT
    assert words in "; ".join(status.errors)
    here.drive.enable()
    assert here.drive.status().errors == ()


def test_another_firmware_of_odrives_is_told(bench: Callable[..., Bench]) -> None:
    here = bench(ODRIVE, firmware="0.5")
    with pytest.raises(DeviceError, match=r'says it runs firmware 0\.6\.10; the rig file has firmware = "0\.5"'):
        here.drive.identify()


def test_an_odrive_that_cannot_close_its_loop_says_why(
    bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = bench(ODRIVE)
    monkeypatch.setattr(here.firmware, "_refuse", lambda: here.firmware.fail("active_errors", 1 << 3))
    with pytest.raises(DeviceError, match=r"refuses to close its torque loop: no valid position or velocity estimate"):
        here.drive.enable()
    assert not here.firmware.armed


def test_a_simplefoc_motor_that_was_disabled_is_a_fault(bench: Callable[..., Bench]) -> None:
    here = bench(SIMPLEFOC)
    here.drive.enable()
    here.run(50)
    here.firmware.break_down(DriveFault.FAULT)
    here.run(200)
    assert here.drive.status().state is DriveState.FAULT
    assert "the motor is disabled" in here.drive.status().errors[0]
    here.drive.enable()
    assert here.drive.status().state is DriveState.ENABLED


def test_a_target_that_nobody_sent_is_a_fault(bench: Callable[..., Bench]) -> None:
    here = bench(SIMPLEFOC)
    here.drive.enable()
    here.run(100, 0.2)
    assert here.drive.status().errors == ()
    here.wire.tamper(to_device=lambda piece: piece.forward(piece.data.replace(b"M0.2", b"M02")))
    here.run(100, 0.2)
    assert here.drive.status().state is DriveState.FAULT
    assert "which was not sent" in here.drive.status().errors[0]
    assert abs(here.backend.world.plant.true_current_a("actuator")) <= 10.1, "the board's own limit holds"


def test_another_letter_is_told(bench: Callable[..., Bench]) -> None:
    here = bench(SIMPLEFOC, letter="A")
    with pytest.raises(DeviceError, match='has no command "A", but M; correct letter'):
        here.drive.identify()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mode": "torque"}, "torque_constant"),
        ({"current_limit": None}, 'current_limit = None: mode = "current" needs it'),
        ({"mode": "voltage"}, 'mode = "voltage" needs it'),
    ],
)
def test_what_a_mode_needs(bench: Callable[..., Bench], options: dict[str, Any], words: str) -> None:
    with pytest.raises(WiringError) as caught:
        bench(SIMPLEFOC, **options)
    assert words in str(caught.value)
