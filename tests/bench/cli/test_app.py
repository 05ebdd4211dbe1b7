"""The commands: what they need, what they say, what they end with."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import pytest

from norton_bench.cli import app
from norton_bench.errors import (
    BenchError,
    ExitCode,
    ExperimentError,
    OperatorStopError,
    RigError,
    SafetyStopError,
    UsageError,
    exit_code_of,
)
from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError, WiringError

ROOT = Path(__file__).parents[3]
RIG = ROOT / "rigs" / "sim-odrive.toml"

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: object) -> tuple[int, str, str]:
        code = app.main([str(each) for each in arguments])
        streams = capsys.readouterr()
        return code, streams.out, streams.err

    return run


def program(*arguments: object) -> subprocess.CompletedProcess[str]:
    code = "import sys; from norton_bench.cli.app import main; sys.exit(main())"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)


EVERY_COMMAND = [
    *app.COMMANDS,
    *(f"{group} {name}" for group, (_, commands) in app.GROUPS.items() for name in commands),
]
HEAVY = "numba textual matplotlib pyarrow norton_sim scipy numpy pint can canopen filterpy pydantic h5py google mcap"


@pytest.mark.long
def test_help_version_and_completion_import_nothing_heavy() -> None:
    """What takes longer than 0.1 s, or makes it long together: all of these end within 0.3 s of processor time."""
    code = f"""
import sys
from norton_bench.cli.app import main
for words in sys.argv[1:]:
    code = main(words.split())
    heavy = [name for name in "{HEAVY}".split() if name in sys.modules]
    print(words, code, *heavy, sep="|", file=sys.stderr)
"""
    asked = ["--help", "-V", *(f"{command} --help" for command in (*app.GROUPS, *EVERY_COMMAND)), "completion bash"]
    done = subprocess.run(
        [sys.executable, "-c", code, *asked], cwd=ROOT, capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.count("Usage: norton-bench") == len(asked) - 2
    assert done.stderr.splitlines() == [f"{words}|0" for words in asked]


@pytest.mark.parametrize("flag", ["--version", "-V"])
def test_the_version_is_that_of_the_package(run: Run, flag: str) -> None:
    assert run(flag) == (ExitCode.OK, f"{version('norton-bench')}\n", "")


@pytest.mark.long
@pytest.mark.parametrize("arguments", [["--help"], ["-V"], ["rig"], ["devices"], ["devices", "--json"], ["info"]])
@pytest.mark.parametrize("closed", [1, 2])
def test_a_reader_who_has_left_is_no_failure(arguments: list[str], closed: int) -> None:
    """As ``| head -1``: the pipe is there, and nobody reads it."""
    reading, writing = os.pipe()
    os.close(reading)
    streams = {1: subprocess.PIPE, 2: subprocess.PIPE, closed: writing}
    code = "import sys; from norton_bench.cli.app import main; sys.exit(main())"
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments], cwd=ROOT, stdout=streams[1], stderr=streams[2]
    ) as process:
        os.close(writing)
        said = b"".join(filter(None, process.communicate(timeout=60)))
    assert process.returncode == (ExitCode.USAGE if arguments == ["info"] else ExitCode.OK)
    assert b"Traceback" not in said
    assert b"Unexpected failure" not in said


@pytest.mark.long
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no full device")
@pytest.mark.parametrize("arguments", [["--help"], ["-V"], ["devices"], ["devices", "--json"], ["completion", "bash"]])
def test_output_that_cannot_be_written_is_told(arguments: list[str]) -> None:
    code = "import sys; from norton_bench.cli.app import main; sys.exit(main())"
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == ExitCode.USAGE
    assert done.stderr == "the output cannot be written (No space left on device); send it to another file\n"


@pytest.mark.parametrize(("shell", "begins"), [("bash", "# Bash completion"), ("zsh", "#compdef"), ("fish", "# Fish")])
def test_a_shell_can_complete_every_command(run: Run, shell: str, begins: str) -> None:
    code, out, err = run("completion", shell)
    assert (code, err) == (ExitCode.OK, "")
    assert out.startswith(begins)
    assert all(name in out for name in (*app.COMMANDS, *app.GROUPS, "--until", "--resume"))


def test_the_completion_is_put_where_the_shell_looks(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    code, out, err = run("completion", "bash", "--install")
    assert (code, err) == (ExitCode.OK, "")
    assert tmp_path in Path(out.strip()).parents
    assert "identify" in Path(out.strip()).read_text()


def test_help_names_every_command(run: Run) -> None:
    code, out, _ = run("--help")
    assert code == ExitCode.OK
    assert all(name in out for name in (*app.COMMANDS, *app.GROUPS, "--debug", "130"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["identfy"], "identify"),
        (["identify"], "RIG"),
        (["identify", RIG, "--sed", "3"], "--seed"),
        (["identify", RIG, "--seed", "three"], "three"),
        (["export", "x.mcap", "--format", "xls"], "parquet"),
        (["identify", "rigs/none.toml"], "no such rig file"),
        (["run", "sessions/none.toml"], "no such session file"),
        (["sim", "truth", "rigs/none.toml"], "no such rig file"),
        (["sim", "serve", "rigs/none.toml"], "no such rig file"),
        (["rig", "check", "rigs/none.toml"], "no such rig file"),
        (["rig", "check", RIG, "--backend", "hardwear"], 'did you mean "hardware"?'),
        (["recover", "none.mcap"], "none.mcap"),
        (["export", "none.mcap"], "none.mcap"),
    ],
)
def test_wrong_usage_is_one_sentence_and_exit_code_2(
    run: Run, arguments: list[object], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    code, out, err = run(*arguments)
    assert code == ExitCode.USAGE
    assert out == ""
    assert said in err
    assert len(err.splitlines()) == 1


def test_every_mistake_of_a_rig_file_is_a_line(run: Run, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.read_text().replace("stale_after", "stale_aftr").replace('"80 rad/s"', '"80 Hz"'))
    code, out, err = run("identify", rig, "--json")
    assert (code, out) == (ExitCode.USAGE, "")
    assert sorted(line.split(": ")[1] for line in err.splitlines()) == ["[limits] stale_aftr", "[limits] velocity"]


@pytest.mark.long
def test_as_a_program_too() -> None:
    done = program("identify", "rigs/none.toml")
    assert done.returncode == ExitCode.USAGE
    assert done.stdout == ""
    assert done.stderr.splitlines() == [line for line in done.stderr.splitlines() if "no such rig file" in line]


def test_a_session_without_a_rig_says_how_to_name_one(run: Run, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text('[[step]]\ndo = "tare"\n')
    code, _, err = run("run", tmp_path / "s.toml")
    assert code == ExitCode.USAGE
    assert 'add rig = "../rigs/my-rig.toml", or give --rig' in err


def test_a_folder_that_cannot_be_made_is_told_before_anything_moves(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code, _, err = run("identify", RIG, "--out", tmp_path / "file" / "runs")
    assert code == ExitCode.USAGE
    assert "choose another with --out" in err


@pytest.mark.long
def test_an_unplugged_rig_ends_with_the_connection_or_the_timeout_code(run: Run, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    text = (
        RIG.read_text().replace('"udp_multicast"', '"virtual"').replace("socket://localhost:7641", str(tmp_path / "no"))
    )
    rig.write_text(text)
    code, out, err = run("rig", "check", rig, "--backend", "hardware", "--json")
    assert code == ExitCode.TIMEOUT  # of the first that is wrong: the actuator's drive is on a bus with nobody
    assert [device["problems"] != [] for device in json.loads(out)["devices"]] == [True, True, True]
    assert len(err.splitlines()) == 3


def test_the_simulated_rig_is_all_right(run: Run) -> None:
    code, out, err = run("rig", "check", RIG, "--json")
    assert (code, err) == (ExitCode.OK, "")
    actuator, load, sensor = json.loads(out)["devices"]
    assert actuator["firmware"].startswith("0.6")
    assert actuator["streams"]["motion"]["rate_hz"] == pytest.approx(1000, rel=0.01)
    assert load["streams"]["motion"]["readings"] == pytest.approx(1000, abs=10)
    assert 0 < sensor["streams"]["torque"]["age_s"] < 2e-3


def test_the_rig_check_for_people_names_devices_and_streams(run: Run) -> None:
    code, out, _ = run("rig", "check", RIG)
    assert code == ExitCode.OK
    assert all(word in out for word in ("actuator: odrive", "torque_sensor: bota", "motion", "1000 Hz"))


@pytest.mark.long
def test_readings_slower_than_they_may_be_are_told(run: Run, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.read_text().replace('"1 kHz"', '"5 kHz"').replace('stale_after = "100', 'stale_after = "0.5'))
    code, _, err = run("rig", "check", rig)
    assert code == ExitCode.EXPERIMENT_FAILED
    assert "[actuator] motion readings come at 1000 Hz with gaps of up to 1." in err


def test_the_truth_is_what_the_rig_file_says(run: Run) -> None:
    code, out, _ = run("sim", "truth", RIG, "--json")
    assert code == ExitCode.OK
    parameters = json.loads(out)["parameters"]
    assert parameters["inertia"] == {"value": pytest.approx(5e-5), "unit": "kg*m^2"}
    assert parameters["torque_gain"]["value"] == pytest.approx(18 * 0.05)
    assert "amplifier_bandwidth" in run("sim", "truth", RIG)[1]


@pytest.mark.long
def test_devices_are_listed(run: Run) -> None:
    code, out, _ = run("devices", "--json")
    assert code == ExitCode.OK
    assert all(set(port) > {"kind", "channel", "description"} for port in json.loads(out)["ports"])


def test_an_unexpected_failure_is_a_sentence_and_a_traceback_only_on_demand(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("norton_bench.cli.check.check_data", lambda checks: 1 / 0)
    code, _, err = run("rig", "check", RIG)
    assert code == ExitCode.EXPERIMENT_FAILED
    assert len(err.splitlines()) == 1
    assert "ZeroDivisionError" in err
    assert "--debug" in err
    assert "Traceback" in run("rig", "check", RIG, "--debug")[2]


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (BenchError("x"), 1),
        (ExperimentError("x"), 1),
        (UsageError("x"), 2),
        (RigError("x"), 2),
        (WiringError("x"), 2),
        (ConnectionFailedError("x"), 3),
        (DeviceTimeoutError("x"), 4),
        (DeviceError("x"), 1),
        (SafetyStopError("x"), 5),
        (OperatorStopError("x"), 130),
        (KeyboardInterrupt(), 130),
        (ValueError("x"), 1),
    ],
)
def test_every_error_has_its_exit_code(error: BaseException, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        raise error

    assert exit_code_of(error) == code
    assert app.run_safely(fail, debug=False) == code
    assert len(capsys.readouterr().err.splitlines()) == 1
