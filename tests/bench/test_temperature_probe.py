"""A signal that nothing is computed with: recorded, exported and shown, and its silence stops nothing."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from norton_bench.check.check import check_rig
from norton_bench.errors import RigError
from norton_bench.jog.signals import BenchSignals
from norton_bench.loop.process import LoopProcess
from norton_bench.procedures.waves import coasting
from norton_bench.recording.export import export
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.records import Measured, join
from norton_bench.report.streams import stream_qualities
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.screen.picture.parts import BenchHealth
from norton_bench.segments import Segment, Use
from norton_sim.firmware.serial_sensors import ROOM_C, CelsiusProbe
from tests.bench.bench_in_simulation import opened
from tests.bench.served import RIG_FILE, rig_of_its_own, served

SECTION = '[temperature_sensor]\ndriver = "celsius"\nport = "{port}"\n\n[simulated]'


def with_probe(port: str = "/dev/ttyUSB9") -> Rig:
    text = RIG_FILE.read_text()
    assert text.count("\n[simulated]\n") == 1
    return parse_rig(text.replace("\n[simulated]\n", f"\n{SECTION.format(port=port)}\n"), place="probe.toml")


def resting(seconds: float) -> Segment:
    return coasting("test", "rest", Use.PREPARE, np.zeros(round(seconds * 1e3)))


@pytest.fixture(scope="module")
def parts() -> list[Measured]:
    """Three seconds, after two of which the probe falls silent."""
    with opened(with_probe()) as bench:
        bench.after(2.0, lambda: bench.cut("temperature_sensor"))
        with bench.loop.running():
            bench.loop.run(resting(6.0))
    return bench.parts


def test_its_silence_stops_nothing_and_its_readings_are_there(parts: list[Measured]) -> None:
    measured = join(parts)
    assert len(measured.ticks) == 6000
    assert set(measured.temperature["temperature_c"]) == {ROOM_C}
    assert 2 <= len(measured.temperature) <= 4
    assert np.diff(measured.temperature["arrival_ns"]) == pytest.approx(5e8, rel=1e-3)


def test_it_is_recorded_and_exported(parts: list[Measured], tmp_path: Path) -> None:
    with Recorder(tmp_path / "r.mcap", rig_text="", metadata={}, patience_s=10.0) as recorder:
        for part in parts:
            recorder.put(part)
    kept = read_recording(tmp_path / "r.mcap").measured.temperature
    assert kept.tobytes() == join(parts).temperature.tobytes()
    export(tmp_path / "r.mcap", "csv", tmp_path)
    with (tmp_path / "r.temperature.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["temperature_c"]) for row in rows] == [ROOM_C] * len(kept)
    (quality,) = [each for each in stream_qualities(join(parts)) if each.name == "housing temperature"]
    assert quality.rate_hz == pytest.approx(2.0, rel=1e-3)


def test_it_is_shown_with_its_age_and_as_silent_once_it_is(parts: list[Measured]) -> None:
    rig = with_probe()
    signals, health = BenchSignals(rig), BenchHealth(rig)
    states = []
    for part in parts:
        signals.take(part)
        health.take(part)
        states.append([pulse.state for pulse in health.devices()])
    (seen,) = [each for each in signals.seen() if each.device == "temperature sensor"]
    assert (seen.name, seen.value, seen.least, seen.greatest, seen.unit) == (
        "temperature",
        ROOM_C,
        ROOM_C,
        ROOM_C,
        "°C",
    )
    assert 3.5 < seen.age_s < 4.7
    assert states[20] == ["ok"] * 4
    assert states[-1] == ["ok", "ok", "ok", "silent"]


def test_a_check_of_the_rig_finds_it_or_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = with_probe()
    found = check_rig(rig)
    assert not found.problems()
    assert [each.identity.driver for each in found.devices if each.identity] == ["odrive", "odrive", "bota", "celsius"]
    monkeypatch.setattr(CelsiusProbe, "_send", lambda self, stamp_ns: None)
    (problem,) = check_rig(rig).problems()
    assert str(problem).startswith("[temperature_sensor] probe on /dev/ttyUSB9: no number in 3 s; check power, port")


def test_mistakes_in_its_section_are_told_with_their_place() -> None:
    text = RIG_FILE.read_text().replace("\n[simulated]\n", f"\n{SECTION.format(port='x')}\n")
    with pytest.raises(RigError, match=r'\[temperature_sensor\] driver: "bota" is not installed; .*celsius'):
        parse_rig(text.replace('driver = "celsius"', 'driver = "bota"'), place="probe.toml")
    with pytest.raises(RigError, match=r"\[temperature_sensor\] range: unknown"):
        parse_rig(text.replace('driver = "celsius"', 'driver = "celsius"\nrange = 3'), place="probe.toml")


@pytest.mark.long
@pytest.mark.wall_time
def test_a_loop_in_a_process_of_its_own_hears_it_on_a_pseudo_terminal(tmp_path: Path) -> None:
    section = SECTION.format(port=tmp_path / "probe")
    rig = rig_of_its_own(tmp_path, f"239.74.163.{os.getpid() % 200 + 20}", **{"\n[simulated]\n": f"\n{section}\n"})
    parts: list[Measured] = []
    with served(rig), LoopProcess(rig) as loop:
        loop.subscribe(parts.append)
        assert [each.driver for each in loop.identify()] == ["odrive", "odrive", "bota", "celsius"]
        with loop.running():
            loop.run(resting(2.0))
    assert set(join(parts).temperature["temperature_c"]) == {ROOM_C}
    assert len(join(parts).temperature) >= 3
