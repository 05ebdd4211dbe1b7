"""An arm measured through frames and bytes, and what becomes of it when a joint fails."""

import json
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli.app import main
from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.joints.arm import load_arm
from norton_bench.joints.bench import open_benches
from norton_bench.loop.stop_word import never_stop
from norton_bench.loop.together import run_together, running_together
from norton_bench.recording.reader import read_recording
from norton_bench.rig.load import simulator
from norton_bench.segments import Segment, Use
from norton_drivers.errors import DeviceError

FILE = Path(__file__).parents[3] / "rigs" / "two-joints" / "arm.toml"


def with_fault(arm, joint: int, **fault: str):
    simulated = {**arm.rigs[joint].simulated, "fault": [fault]}
    rigs = list(arm.rigs)
    rigs[joint] = replace(rigs[joint], simulated=simulated)
    return replace(arm, rigs=tuple(rigs))


@pytest.mark.parametrize("joint", [0, 1])
def test_both_joints_are_idle_when_one_loses_a_device(tmp_path, joint):
    arm = with_fault(load_arm(FILE), joint, kind="dropout", on="torque_sensor", at="1500 ms")
    rest = Segment("rest", "rest", Use.PREPARE, np.zeros(4000))
    with open_benches(arm, tmp_path, seed=1, planned_s=5.0, stop_request=never_stop) as benches:
        with pytest.raises(SafetyStopError, match="torque"), running_together(benches.loops):
            run_together(benches.loops, (rest, rest))
        assert not any(loop.devices._still_enabled() for loop in benches.loops)
    for rig in arm.rigs:
        recorded = read_recording(tmp_path / f"{rig.name}.mcap").measured
        assert any(event.kind == "stop" for event in recorded.events)
        assert 0.5e9 < recorded.ticks["tick_ns"][-1] - recorded.ticks["tick_ns"][0] < 4e9


def test_no_drive_is_enabled_where_another_cannot_be(tmp_path):
    arm = with_fault(load_arm(FILE), 1, kind="drop", on="load", towards="device", at="500 ms")
    with open_benches(arm, tmp_path, seed=1, planned_s=5.0, stop_request=never_stop) as benches:
        benches.loops[0].devices.clock.wait_until_ns(600_000_000)
        with pytest.raises(DeviceError, match="load"), running_together(benches.loops):
            raise AssertionError("the elbow's load can be enabled")
        assert not any(loop.devices._still_enabled() for loop in benches.loops)


def lose_a_recording(folder: Path, enabled: list) -> None:
    """Rest, and have the process die that records the shoulder; what is still enabled then goes to ``enabled``."""
    rest = Segment("rest", "rest", Use.PREPARE, np.zeros(1000))
    with open_benches(load_arm(FILE), folder, seed=1, planned_s=5.0, stop_request=never_stop) as benches:
        try:
            with running_together(benches.loops):
                run_together(benches.loops, (rest, rest))
                os.kill(benches.recorders[0].writer_pid, signal.SIGKILL)
                run_together(benches.loops, (rest, rest))
        finally:
            enabled += [loop.devices._still_enabled() for loop in benches.loops]


def test_both_joints_are_idle_when_a_recording_breaks_down(tmp_path):
    enabled: list = []
    with pytest.raises(ExperimentError, match="shoulder"):
        lose_a_recording(tmp_path, enabled)
    assert enabled == [[], []]


def test_segments_run_on_the_same_ticks(tmp_path):
    arm = load_arm(FILE)
    rest = Segment("rest", "rest", Use.PREPARE, np.zeros(300))
    with (
        open_benches(arm, tmp_path, seed=1, planned_s=5.0, stop_request=never_stop) as benches,
        running_together(benches.loops),
    ):
        shoulder, elbow = run_together(benches.loops, (rest, rest))
    assert len(shoulder.ticks) == len(elbow.ticks) == 300
    np.testing.assert_array_equal(shoulder.ticks["tick_ns"], elbow.ticks["tick_ns"])


@pytest.mark.long
def test_an_arm_is_measured_from_the_command_line(tmp_path, capsys):
    assert main(["joints", str(FILE), "--seed", "3", "--out", str(tmp_path), "--json", "--quiet"]) == 0
    data = json.loads(capsys.readouterr().out)
    arm = load_arm(FILE)
    true = simulator("true_joints")(arm.benches, arm.simulated, place=arm.place)
    for name, matrix in true.items():
        off = np.abs(np.array(data[name]["value"]) - matrix)
        # Of twelve entries at one seed: 3 half-widths are 6 deviations.
        assert np.all(off <= 3 * np.array(data[name]["half_width"])), name
        assert np.all(off <= 0.03 * np.abs(matrix)), name
    assert data["adequate"]
    assert max(data["source"]["torque_left_nm"]) < 0.1
    assert (tmp_path / "arm.html").is_file()
    assert main(["joints", str(FILE), "--again", str(tmp_path), "--json", "--quiet"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["stiffness"] == data["stiffness"]
    other = tmp_path / "other"
    shutil.copytree(FILE.parent, other)
    text = (other / "arm.toml").read_text()
    (other / "arm.toml").write_text(text.replace('period = "4 s"', 'period = "2 s"'))
    assert main(["joints", str(other / "arm.toml"), "--again", str(tmp_path), "--quiet"]) == 2
    assert "was measured with other options" in capsys.readouterr().err
    assert main(["joints", str(FILE), "--again", str(tmp_path / "nowhere"), "--quiet"]) == 2
    assert not (tmp_path / "nowhere").exists()
