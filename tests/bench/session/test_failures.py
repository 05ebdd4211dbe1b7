"""Sessions that end before their end: the drives are idle, and what was measured until then can be read."""

import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from norton_bench.errors import BenchError, ExitCode, OperatorStopError, SafetyStopError
from norton_bench.loop.stop_word import StopWord
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.recording.contents import Recording
from norton_bench.recording.reader import read_recording
from norton_bench.rig.rig import Rig
from norton_bench.session import engine
from norton_bench.session.operator import Nobody
from norton_bench.session.schema import Session, Step
from norton_drivers.codecs.odrive import AxisState, Heartbeat, MessageId
from norton_drivers.registry import load_backend
from norton_sim.backend import SimulatedBackend
from norton_sim.firmware.odrive import ODriveAxis
from tests.bench.half_rate import half_rate, half_rate_text

ROOT = Path(__file__).parents[3]
RIG = half_rate("sim-odrive")
PROGRAM = Path(sys.executable).with_name("norton-bench")
SESSION = Session(
    (Step("tare", TareOptions(duration_s=0.5)), Step("calibrate", CalibrateOptions(duration_s=2.0))), place="test"
)


class Listening(StopWord):
    """Heard whenever the loop asks, and what it hears is for ``stop`` to say."""

    def __init__(self, stop: Callable[[], str | None]) -> None:
        super().__init__()
        self._stop = stop

    def heard(self) -> str | None:
        return self._stop()


@dataclass
class Bench:
    """Runs sessions on backends of which it keeps hold."""

    out: Path
    backend: SimulatedBackend | None = None

    def open(self, *arguments: Any, **options: Any) -> SimulatedBackend:
        self.backend = load_backend("simulated")(*arguments, **options)
        return self.backend

    def stopped(self, rig: Rig, kind: type[BenchError], stop: Callable[[], str | None]) -> tuple[str, Recording]:
        """What the session ended with, and its recording."""
        with pytest.raises(kind) as stop_error:
            engine.run_session(rig, SESSION, out=self.out, seed=1, operator=Nobody(Listening(stop)))
        return str(stop_error.value), read_recording(self.out / f"{rig.name}.mcap")

    @property
    def world(self) -> Any:
        assert self.backend is not None
        return self.backend.world

    def armed(self) -> list[str]:
        axes = {role: device for role, device in self.world.devices.items() if isinstance(device, ODriveAxis)}
        assert set(axes) == {"actuator", "load"}
        return [role for role, axis in axes.items() if axis.axis_state == AxisState.CLOSED_LOOP_CONTROL]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    bench = Bench(tmp_path)
    monkeypatch.setattr(engine, "load_backend", lambda _name: bench.open)
    return bench


def never() -> None:
    """Nobody stops anything."""


def last_states(recording: Recording) -> dict[int, int]:
    """By node, the state in the last heartbeat that crossed the bus."""
    received = [frame for frame in recording.measured.frames if not frame.sent and frame.channel == "can0"]
    beats = [frame for frame in received if frame.arbitration_id & 0x1F == MessageId.HEARTBEAT]
    return {frame.arbitration_id >> 5: Heartbeat.decode(frame.data).axis_state for frame in beats}


def assert_ended_in_order(recording: Recording, words: str) -> None:
    assert recording.complete
    kinds = [event.kind for event in recording.measured.events if event.kind != "step"]
    assert kinds == ["watchdog", "watchdog", "stop"]
    assert words in recording.measured.events[-1].text
    ticks = recording.measured.ticks["tick_ns"]
    assert np.all(np.diff(ticks) > 0)
    assert 0 <= recording.measured.events[-1].stamp_ns - ticks[-1] < 0.5e9  # enabling takes a fifth of a second


def test_the_operator_stops_halfway(bench: Bench) -> None:
    asked = 0

    def press() -> str | None:
        nonlocal asked
        asked += 1
        return "space was pressed" if asked > 750 else None

    said, recording = bench.stopped(RIG, OperatorStopError, press)
    assert "space was pressed" in said
    assert bench.armed() == []
    assert_ended_in_order(recording, "space was pressed")
    assert 740 < len(recording.measured.ticks) <= 750
    assert set(last_states(recording).values()) == {AxisState.IDLE}


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"torque_nm": 0.05}, "port torque"),
        ({"power_w": 0.2}, "port power"),
        ({"position_rad": 0.3}, "travel"),
    ],
)
def test_the_guard_stops_halfway(bench: Bench, limits: dict[str, float], words: str) -> None:
    said, recording = bench.stopped(replace(RIG, limits=replace(RIG.limits, **limits)), SafetyStopError, never)
    assert words in said
    assert "[limits]" in said
    assert bench.armed() == []
    assert_ended_in_order(recording, words)
    assert len(recording.measured.ticks) > 250
    assert set(last_states(recording).values()) == {AxisState.IDLE}


@pytest.mark.parametrize(
    ("role", "words"),
    [
        ("torque_sensor", "torque sensor: silent"),
        ("actuator", "actuator encoder: silent"),
        ("load", "load encoder: silent"),
    ],
)
def test_a_device_vanishes_halfway(bench: Bench, role: str, words: str) -> None:
    asked = 0

    def pull_the_plug() -> None:
        nonlocal asked
        asked += 1
        if asked == 600:
            bench.world.wires[role].cut()

    said, recording = bench.stopped(RIG, SafetyStopError, pull_the_plug)
    assert words in said
    silence_ticks = RIG.limits.stale_after_ns // RIG.tick_ns
    assert 600 + silence_ticks - 5 < len(recording.measured.ticks) < 600 + silence_ticks + 5
    # Whoever cannot be told is stopped by its watchdog, of 300 ms.
    bench.world.advance(bench.world.now_ns + 310_000_000)
    assert bench.armed() == []


def program(*arguments: object) -> subprocess.Popen[str]:
    command = [str(PROGRAM), *map(str, arguments)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.long
def test_a_safety_stop_ends_the_program_with_its_code_and_keeps_the_recording(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(half_rate_text("sim-odrive").replace('power = "20 W"', 'power = "200 mW"'))
    with program("identify", rig, "--out", tmp_path / "out", "--json") as process:
        out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (ExitCode.SAFETY_STOP, "")
    *_, kept, why = err.splitlines()
    assert kept == f"the measurements are in {tmp_path / 'out' / 'sim-odrive.mcap'}"
    assert why.startswith("port power: ")
    assert "is outside [limits] power = 0.2 W; ask for less (" in why
    assert len(read_recording(tmp_path / "out" / "sim-odrive.mcap").measured.ticks) > 250


@pytest.mark.long
def test_an_interrupt_ends_the_program_with_its_code_and_keeps_the_recording(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.text)
    with program("identify", rig, "--out", tmp_path / "out", "--json") as process:
        assert process.stderr is not None
        while not process.stderr.readline().startswith("[2/6] calibrate"):
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    assert (process.returncode, out) == (ExitCode.INTERRUPTED, "")
    kept, why = err.splitlines()
    assert kept == f"the measurements are in {tmp_path / 'out' / 'sim-odrive.mcap'}"
    assert "stopped by the operator" in why
    recording = read_recording(tmp_path / "out" / "sim-odrive.mcap")
    assert_ended_in_order(recording, "stopped by the operator")
    assert len(recording.measured.ticks) > 1000
    assert set(last_states(recording).values()) == {AxisState.IDLE}
