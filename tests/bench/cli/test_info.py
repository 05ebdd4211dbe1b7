"""``info``: what is shown of a recording."""

import json
from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli.app import main
from norton_bench.errors import ExitCode
from norton_bench.recording.recorder import Recorder
from norton_bench.records import TICK, Event, Measured


def recorded(path: Path, *, measured: bool) -> Path:
    """A tenth of a second, in which two ticks were skipped."""
    ticks = np.zeros(98, TICK)
    ticks["tick_ns"] = np.delete(np.arange(100), [50, 51]) * 1_000_000 + 10**9
    if measured:
        ticks["lateness_ns"], ticks["work_ns"], ticks["receive_ns"], ticks["put_ns"] = 2_000, 90_000, 30_000, 7_000
    with Recorder(path, rig_text="", metadata={"rig": "dyno", "loop": "on core 3"}, patience_s=5.0) as recorder:
        recorder.put(Measured(ticks=ticks, events=(Event(10**9, "watchdog", "seen to act"),)))
    return path


def test_it_tells_how_the_loop_kept_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = recorded(tmp_path / "a.mcap", measured=True)
    assert main(["info", str(path)]) == ExitCode.OK
    shown = capsys.readouterr().out
    assert "98 ticks at 1000 a second, 98.00 % of those that were due; 2 were skipped." in shown
    lines = {line.split("  ")[0].strip(): line.split() for line in shown.splitlines() if line.strip()}
    assert (lines["lateness"][1], lines["lateness"][-1]) == ("2.0", "2002.0")
    assert lines["- receive"][-1] == "30.0"
    assert lines["- put away"][-1] == "7.0"
    assert "on core 3" in shown
    assert "seen to act" in shown


def test_its_json_says_the_same_in_nanoseconds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = recorded(tmp_path / "a.mcap", measured=True)
    assert main(["info", str(path), "--json"]) == ExitCode.OK
    said = json.loads(capsys.readouterr().out)
    assert (said["rig"], said["loop"], said["complete"]) == ("dyno", "on core 3", True)
    assert (said["timing"]["ticks"], said["timing"]["skipped"], said["timing"]["tick_ns"]) == (98, 2, 1_000_000)
    assert said["timing"]["stages"]["receive"]["median_ns"] == 30_000
    assert said["events"] == [{"stamp_ns": 10**9, "kind": "watchdog", "text": "seen to act"}]


def test_lock_step_needs_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(recorded(tmp_path / "a.mcap", measured=False))]) == ExitCode.OK
    shown = capsys.readouterr().out
    assert "lateness" not in shown


def test_what_is_no_recording_is_said_to_be_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.mcap").write_text("no")
    assert main(["info", str(tmp_path / "a.mcap")]) == ExitCode.USAGE
    assert "a.mcap" in capsys.readouterr().err
