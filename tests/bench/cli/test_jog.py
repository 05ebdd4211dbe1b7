"""``jog`` with values: it goes there and back, and refuses what it must before anything is opened."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli.app import main
from norton_bench.errors import ExitCode
from norton_bench.faults.host_loss import read_witness
from norton_bench.recording.reader import read_recording
from tests.bench.half_rate import HALF_RATE, half_rate
from tests.bench.served import rig_of_its_own, served

RIGS = Path(__file__).parents[3] / "rigs"
ODRIVE = str(RIGS / "sim-odrive.toml")


def jog(tmp_path: Path, capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict, str]:
    rig = tmp_path / "rig.toml"
    rig.write_text(half_rate("sim-odrive").text)
    code = main(["jog", str(rig), "--out", str(tmp_path / "out"), "--seed", "1", "--json", *arguments])
    said = capsys.readouterr()
    return code, json.loads(said.out), said.err


def test_values_are_held_and_everything_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found, said = jog(tmp_path, capsys, "--actuator", "50 mN*m", "--load-torque=-0.01", "--duration", "1 s")
    assert code == ExitCode.OK
    assert "moving: actuator +0.05 N*m, load -0.01 N*m, for 1 s; torques are switched off at 40 rad/s" in said
    assert "device actuator: odrive, can0 node 1" in said
    assert found["setpoints"] == "actuator +0.05 N*m, load -0.01 N*m"
    assert found["cut_short"] is None
    signals = {(each["device"], each["name"]): each for each in found["signals"]}
    assert signals["actuator", "command"]["value"] == pytest.approx(0.05, rel=1e-6)
    assert signals["load", "torque command"]["value"] == pytest.approx(-0.01, rel=1e-6)
    assert signals["actuator", "velocity"]["value"] > 5.0
    assert signals["actuator", "supply"]["unit"] == "V"
    recording = read_recording(Path(found["recording"]))
    assert recording.complete
    assert recording.measured.ticks["command"][-1] == 0.0


@pytest.mark.long
def test_an_imposed_velocity_is_calibrated_for_and_reached(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found, _ = jog(tmp_path, capsys, "--load-velocity", "5 rad/s", "--duration", "1.5 s")
    assert code == ExitCode.OK
    signals = {(each["device"], each["name"]): each for each in found["signals"]}
    assert signals["load", "velocity"]["value"] == pytest.approx(5.0, abs=0.5)
    assert signals["load", "velocity"]["greatest"] < 6.0  # nothing of the calibration, which is faster
    segments = read_recording(Path(found["recording"])).measured.segments
    assert list(dict.fromkeys(segment.procedure for segment in segments)) == ["tare", "calibrate", "jog"]


@pytest.mark.long
def test_a_body_on_a_spring_is_acted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The actuator's torque less its friction of 20 mN m turns the spring by their quotient."""
    body = ("--mass", "0.0005", "--damping", "20 mN*m*s/rad", "--stiffness", "0.5")
    code, found, _ = jog(tmp_path, capsys, *body, "--actuator", "0.1", "--duration", "2 s")
    assert code == ExitCode.OK
    assert found["setpoints"] == "actuator +0.1 N*m, body 0.0005 kg*m^2, 0.02 N*m*s/rad, 0.5 N*m/rad"
    ticks = read_recording(Path(found["recording"])).measured.ticks
    held = ticks[ticks["command"] >= 0.1 * (1 - 1e-6)][-100:]
    turned_rad = np.mean(held["load_position_rad"] - held["reference_position_rad"])
    assert 0.5 * turned_rad == pytest.approx(np.mean(held["torque_nm"]), abs=3e-3)
    assert 0.05 < 0.5 * turned_rad < 0.1


@pytest.mark.long
def test_a_body_that_the_load_cannot_act_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["jog", ODRIVE, "--mass", "0.5e-3 kg*m^2", "--out", str(tmp_path)]) == ExitCode.EXPERIMENT_FAILED
    said = capsys.readouterr().err
    assert "this bench cannot render 0.0005 kg*m^2 of mass" in said
    assert "it can with" in said


def test_a_value_that_cannot_be_held_is_a_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, found, said = jog(tmp_path, capsys, "--actuator", "0.3", "--speed", "10 rad/s")
    assert code == ExitCode.EXPERIMENT_FAILED
    assert "the shaft reached 10 rad/s" in found["cut_short"]
    assert "--speed allows more" in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([ODRIVE, "--actuator", "0.6"], "actuator stays at +0.5 N*m: the rig allows no more"),
        ([ODRIVE, "--load-velocity", "40"], "load stays at +36 rad/s"),
        ([ODRIVE, "--load-torque", "1", "--zero-torque"], "one of them at a time"),
        ([ODRIVE, "--mass", "1e-3", "--zero-torque"], "one of them at a time"),
        ([ODRIVE, "--damping=-0.1"], "no negative mass"),
        ([ODRIVE, "--damping", "0.1", "--wall", "0.2 rad"], "a wall needs a stiffness"),
        ([ODRIVE, "--stiffness", "0"], "for zero torque --zero-torque"),
        ([str(RIGS / "sim-in-situ.toml"), "--mass", "1e-3"], "needs a torque sensor"),
        ([ODRIVE, "--actuator", "1 rad"], "--actuator"),
        ([ODRIVE, "--actuator", "nan"], "must be finite"),
        ([ODRIVE, "--actuator", "0.1", "--duration", "0"], "more than 0 s"),
        ([ODRIVE, "--actuator", "0.1", "--dead-man", "1 s"], "--dead-man is for the screen"),
        ([ODRIVE, "--actuator", "0.1", "--speed", "80"], "90% of [limits] velocity"),
        ([ODRIVE, "--json"], "need values, such as --actuator 0.02"),
        ([ODRIVE], "needs a terminal"),
        ([str(RIGS / "sim-free-shaft.toml"), "--load-torque", "0.1"], "this rig has none"),
        ([str(RIGS / "sim-in-situ.toml"), "--zero-torque"], "needs a torque sensor"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_opened(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["jog", *arguments]) == ExitCode.USAGE
    assert said in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


@pytest.mark.long
@pytest.mark.wall_time
def test_served_devices_are_moved_and_left_idle(tmp_path: Path) -> None:
    rig = rig_of_its_own(tmp_path, group="239.74.163.88", **HALF_RATE)
    command = [sys.executable, "-m", "norton_bench", "jog", rig.place, "--backend", "hardware", "--json"]
    command += ["--actuator", "0.05", "--duration", "500 ms", "--out", str(tmp_path / "out")]
    with served(rig) as witness:
        done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=False)
        assert done.returncode == ExitCode.OK, done.stderr
        states = list(read_witness(witness))
    assert max(abs(state.velocity_rad_s) for state in states) > 3.0
    assert any(len(state.armed) == 2 for state in states)
    assert not states[-1].armed
    signals = {(each["device"], each["name"]): each for each in json.loads(done.stdout)["signals"]}
    assert signals["actuator", "command"]["value"] == pytest.approx(0.05, rel=1e-6)
    assert signals["actuator", "velocity"]["value"] > 3.0
