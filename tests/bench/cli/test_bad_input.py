"""Files that cannot be used: one sentence with the place and the mend, no more; from the installed program too."""

import json
import subprocess
import sys
from collections.abc import Mapping
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import pytest
from mcap.writer import Writer

from norton_bench.cli.app import main
from norton_bench.errors import ExitCode
from norton_bench.procedures.options import FreeOptions, TareOptions
from norton_bench.rig.load import load_rig
from norton_bench.session.engine import record_session
from norton_bench.session.schema import Session, Step

ROOT = Path(__file__).parents[3]
RIG_FILE = ROOT / "rigs" / "sim-odrive.toml"
ALONE_FILE = ROOT / "rigs" / "sim-free-shaft.toml"
PROGRAM = Path(sys.executable).with_name("norton-bench")
SHORT = Session(
    (Step("tare", TareOptions(duration_s=0.5)), Step("free", FreeOptions(levels=3, dwell_s=0.2, duration_s=2.0))), ""
)


@dataclass(frozen=True)
class Done:
    """How a command ended, and what it said."""

    returncode: int
    stdout: str
    stderr: str


def norton_bench(folder: Path, *arguments: str) -> Done:
    """The command line in this process: a new one takes a second to begin."""
    with chdir(folder), redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
        code = main([*arguments, "--json"])
    return Done(code, out.getvalue(), err.getvalue())


def steps(*lines: str) -> str:
    return "".join(f"[[step]]\n{line}\n" for line in lines)


def rig(*replacements: tuple[str, str], file: Path = RIG_FILE) -> str:
    """A rig file in which one thing stands for another."""
    text = file.read_text()
    for right, wrong in replacements:
        assert right in text
        text = text.replace(right, wrong, 1)
    return text


NOWHERE = ("socket://localhost:7641", "./unplugged")
ON_NOTHING = ('interface = "udp_multicast"', 'interface = "virtual"')
TARE, CALIBRATE = 'do = "tare"', 'do = "calibrate"'


@dataclass(frozen=True)
class Case:
    """A command line, the files that it meets, how it must end, and what its one sentence must say."""

    command: str
    says: tuple[str, ...]
    files: Mapping[str, str]
    code: ExitCode = ExitCode.USAGE


def rig_case(text: str, *says: str, code: ExitCode = ExitCode.USAGE, more: str = "") -> Case:
    return Case(f"identify r.toml {more}", says, {"r.toml": text}, code)


def session_case(text: str, *says: str, file: Path = RIG_FILE, more: str = "") -> Case:
    return Case(f"run s.toml {more}", says, {"s.toml": f'rig = "{file}"\n{text}'})


RIG_CASES = {
    "not TOML": rig_case("[rig\n", "r.toml: is not TOML: ", "line 1", "check quotes, brackets"),
    "limits that contradict": rig_case(
        rig(('torque = "1 N*m"', 'torque = "0.2 N*m"')),
        "r.toml: [actuator.command] limit: 0.5 N*m",
        "exceed [limits] torque = 0.2 N*m",
        "lower the command's limit or raise the torque's",
    ),
    "wrong unit of a true value": rig_case(
        rig(('inertia = "5e-5 kg*m^2"', 'inertia = "5e-5 kg"')),
        'r.toml: [simulated.actuator] inertia: "5e-5 kg" is not in kg*m^2',
        "write it like",
    ),
    "unknown true value": rig_case(
        rig(("\nstiffness = ", "\nstifness = ")),
        "r.toml: [simulated.torque_sensor] stifness is not known",
        "stiffness",
    ),
    "no port": rig_case(
        rig(ON_NOTHING, NOWHERE),
        "port ./unplugged: ",
        "is it plugged in",
        code=ExitCode.CONNECTION,
        more="--quiet --backend hardware",
    ),
    "a channel that is none": rig_case(
        rig(("239.74.163.4", "not-an-address"), file=ALONE_FILE),
        'r.toml: [bus.can0] channel: "not-an-address"',
        "must be a multicast address",
    ),
    "no bus": rig_case(
        rig(('interface = "udp_multicast"', 'interface = "socketcan"'), ("239.74.163.4", "can9"), file=ALONE_FILE),
        "[bus.can0] socketcan on can9: ",  # what comes then depends on the kernel: no CAN at all, or no such link
        "`",
        code=ExitCode.CONNECTION,
        more="--quiet --backend hardware",
    ),
    "nobody on the bus": rig_case(
        rig(ON_NOTHING, file=ALONE_FILE),
        "[actuator] ODrive node 1 on can0: does not answer",
        "is it powered and on this bus?",
        code=ExitCode.TIMEOUT,
        more="--quiet --backend hardware",
    ),
    "a recording in the way": Case(
        f"identify {RIG_FILE} --quiet --out .",
        ("sim-odrive.mcap is there already", "another name"),
        {"sim-odrive.mcap": ""},
    ),
    "an impossible seed": Case(
        f"identify {RIG_FILE} --quiet --seed -1 --dry-run", ("--seed", "A seed is 0 or greater; give --seed 1"), {}
    ),
    "an impossible seed of the file": rig_case(
        rig(("seed = 1\n", "seed = -1\n")), "[simulated] seed = -1", "greater than or equal", more="--dry-run"
    ),
    "a key of the section misspelt": rig_case(
        rig(("torque_limit", "torqe_limit")), '[load] torqe_limit: unknown key; did you mean "torque_limit"?'
    ),
    "a key of the driver misspelt": rig_case(
        rig(("watchdog = ", "watchdg = ")), '[actuator] watchdg: unknown key; did you mean "watchdog"?'
    ),
    "a true value that cannot be": rig_case(
        rig(('inertia = "5e-5 kg*m^2"', 'inertia = "-5e-5 kg*m^2"')),
        "[simulated.actuator] inertia = '-5e-5 kg*m^2' should be greater than 0",
        more="--dry-run",
    ),
    "faster than anything turns": rig_case(
        rig(('velocity = "80 rad/s"', 'velocity = "1e6 rad/s"')),
        '[limits] velocity: "1e6 rad/s" must be at most 200000',
        more="--dry-run",
    ),
    "beyond all measure": rig_case(
        rig(('velocity = "80 rad/s"', 'velocity = "1e300 rad/s"')), '"1e300 rad/s" is more than any bench meets'
    ),
    "a session": rig_case(
        steps(TARE), "r.toml: is a session file, not a rig file; norton-bench run SESSION runs it", more="--dry-run"
    ),
    "a column map": rig_case("[columns]\n", "r.toml: is a column map, not a rig file; norton-bench fit LOG"),
    "a network": rig_case("{}\n", "r.toml: is JSON, not TOML; is it a network file?", "network show"),
    "a percentage without its sign": Case(
        f"identify {RIG_FILE} --quiet --until 1",
        ("--until 1: is a percentage of each value, greater than 0 % and less than 100 %; write --until 1%",),
        {},
    ),
    "a bound of nothing": Case(
        f"identify {RIG_FILE} --quiet --at-most 300s", ("--at-most bounds the bench time of --until; add --until",), {}
    ),
    "no whole seed": Case(f"identify {RIG_FILE} --quiet --seed 1.5", ('--seed "1.5" is not a whole number',), {}),
    "a backend without a name": Case(
        f"identify {RIG_FILE} --quiet --backend=", ('Write "hardware" or "simulated", or leave it out',), {}
    ),
    "one argument too many": Case(
        f"identify {RIG_FILE} more.toml --quiet", ("more.toml: is not an argument of this command; leave it out",), {}
    ),
    "no processes at all": Case(f"faults {RIG_FILE} --quiet --jobs -3", ("--jobs", "Give at least one"), {}),
    "no experiments at a time": Case("paper --quiet --jobs 0", ("--jobs", "Give at least one"), {}),
    "a fraction in the place of a percentage": Case(
        f"identify {RIG_FILE} --quiet --until 0.01", ("write --until 0.01% or --until 1%, whichever is meant",), {}
    ),
}
SESSION_CASES = {
    "not TOML": session_case("[[step]\n", "s.toml: is not TOML: ", "line 2"),
    "unknown step": session_case(steps('do = "calibrat"'), '[step 1] do: "calibrat" is not', '"calibrate"?'),
    "wrong option": session_case(
        steps(TARE + '\nduration = "2 rad"'), 's.toml: [step 1, tare] duration: "2 rad" is not in s', "write it like"
    ),
    "out of order": session_case(
        steps(CALIBRATE, TARE),
        "s.toml: [step 1, calibrate] 'calibrate' needs 'tare'",
        'put a step do = "tare" before it',
    ),
    "validation of what was never tried": session_case(
        steps(TARE, CALIBRATE, 'do = "validate"'),
        "s.toml: [step 3, validate] 'validate' needs 'free'",
        'do = "free"',
    ),
    "no load": session_case(
        steps(TARE, 'do = "imposed"'),
        "sim-free-shaft.toml: step 'imposed' needs a load drive",
        "add a [load] section or leave the step out",
        file=ALONE_FILE,
    ),
    "nothing that holds the shaft": session_case(
        steps(TARE, 'do = "blocked"'),
        "sim-free-shaft.toml: step 'blocked' needs a torque sensor",
        "add a",
        file=ALONE_FILE,
    ),
    "too fast": session_case(
        steps(TARE, CALIBRATE, 'do = "imposed"\nvelocities = "-75:50:75 rad/s"'),
        "step 'imposed' asks for 75 rad/s, but [limits] velocity = 80 rad/s",
        "lower `velocities`",
    ),
    "a rig": Case(
        f"run {RIG_FILE} --quiet", ("is a rig file, not a session file; norton-bench identify RIG", "--rig RIG"), {}
    ),
    "longer than it can be fitted": session_case(
        steps(TARE + '\nduration = "1e9 s"'),
        "s.toml: [step 1, tare]: takes 1e+09 s; one step may take 3600 s at most",
        "repeat it",
        more="--dry-run",
    ),
    "longer than a day": session_case(
        steps(TARE + '\nduration = "3000 s"\nrepeat = 1000'),
        "s.toml: takes up to 3.006e+06 s in all; a session may take 24 h at most",
        "divide it into several sessions",
        more="--dry-run",
    ),
    "more levels than can be": session_case(
        steps(TARE, CALIBRATE, 'do = "free"\nlevels = 1000000000'), "[step 3, free] levels: 1000000000 must be at most"
    ),
    "an answer to nothing": session_case(
        steps(TARE), "--answer fixture=A: s.toml has no such prompt", more="--answer fixture=A --dry-run"
    ),
    "a prompt of a name that nothing can refer to": session_case(
        steps('do = "ask"\nname = "a b"\ntext = "Which?"'), "[step 1, ask] name: expected a plain name of letters"
    ),
    "more values than a range may have": session_case(
        steps(TARE, CALIBRATE, 'do = "imposed"\nvelocities = "0:1e-9:1 rad/s"'),
        "has more than 1000 values; make its step",
    ),
    "a key of any step misspelt": session_case(
        steps(TARE + "\nrepeet = 2"), '[step 1, tare] repeet: unknown key; did you mean "repeat"?'
    ),
    "a recording that is none": session_case(
        steps(TARE), "there is no recording nowhere.mcap", more="--resume nowhere.mcap"
    ),
    "no such rig": session_case(steps(TARE), "nowhere.toml: no such rig file", file=Path("nowhere.toml")),
}
CASES = {
    **{f"rig: {name}": case for name, case in RIG_CASES.items()},
    **{f"session: {name}": case for name, case in SESSION_CASES.items()},
}


@pytest.mark.long
@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_a_file_that_cannot_be_used_is_one_sentence(case: Case, tmp_path: Path) -> None:
    for name, text in case.files.items():
        (tmp_path / name).write_text(text)
    done = norton_bench(tmp_path, *case.command.split())
    assert (done.returncode, done.stdout) == (case.code, "")
    (sentence,) = done.stderr.splitlines()
    assert all(part in sentence for part in case.says), sentence
    assert not (tmp_path / "runs").exists() or not any((tmp_path / "runs").iterdir())


def test_a_rig_in_the_place_of_a_network_is_told(tmp_path: Path) -> None:
    done = norton_bench(tmp_path, "network", "show", str(RIG_FILE))
    assert done.returncode == ExitCode.USAGE
    assert "sim-odrive.toml: is a TOML file; give a network file (JSON)" in done.stderr


def test_a_recording_in_the_place_of_a_file_is_told(tmp_path: Path) -> None:
    (tmp_path / "r.mcap").write_bytes(b"\x89MCAP0\r\n")
    done = norton_bench(tmp_path, "run", "r.mcap", "--quiet")
    assert (done.returncode, done.stdout) == (ExitCode.USAGE, "")
    assert "r.mcap: is a recording, not a session file; norton-bench fit RECORDING" in done.stderr


def test_a_mark_at_the_beginning_of_a_file_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text(RIG_FILE.read_text(), encoding="utf-8-sig")
    (tmp_path / "s.toml").write_text('rig = "r.toml"\n' + steps(TARE), encoding="utf-8-sig")
    done = norton_bench(tmp_path, "run", "s.toml", "--dry-run")
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")


@pytest.mark.long
def test_a_port_that_is_not_there_is_told_in_the_systems_words_once(tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text(rig(ON_NOTHING, NOWHERE))
    done = norton_bench(tmp_path, "rig", "check", "r.toml", "--backend", "hardware")
    assert (
        "port ./unplugged: cannot open it at 460800 baud (No such file or directory); is it plugged in" in done.stderr
    )


def test_the_installed_program_says_the_same(tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text("[rig\n")
    command = [str(PROGRAM), *RIG_CASES["not TOML"].command.split()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    here = norton_bench(tmp_path, *command[1:])
    assert (done.returncode, done.stdout, done.stderr) == (here.returncode, here.stdout, here.stderr)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, three quarters of it, and things that are none."""
    folder = tmp_path_factory.mktemp("recordings")
    whole = record_session(load_rig(ALONE_FILE), SHORT, out=folder / "whole", seed=1, live=False).recording.rename(
        folder / "whole.mcap"
    )
    content = whole.read_bytes()
    (folder / "cut.mcap").write_bytes(content[: len(content) * 3 // 4])
    (folder / "empty.mcap").write_bytes(b"")
    (folder / "notes.txt").write_text("not a recording")
    (folder / "folder.mcap").mkdir()
    tared = Session(SHORT.steps[:1], "")
    record_session(load_rig(ALONE_FILE), tared, out=folder / "tare", seed=1, live=False).recording.rename(
        folder / "tare.mcap"
    )
    with (folder / "foreign.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("anything", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/anything", "json", schema), 0, b"{}", 0)
        writer.finish()
    return folder


NO_RECORDING: dict[str, tuple[str, ...]] = {
    "missing.mcap": ("there is no recording missing.mcap", "check the name"),
    "empty.mcap": ("empty.mcap is empty", "name a .mcap file"),
    "notes.txt": ("notes.txt is not an MCAP recording", "name a .mcap file"),
    "folder.mcap": ("folder.mcap is a folder", "name the .mcap file in it"),
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("command", "mend"),
    [
        ("fit", "holds numbers; record joint states"),  # to "fit", it is a log of another program
        ("report", "name one of its recordings"),
        ("export", "name one of its recordings"),
        ("recover", "there is nothing to recover"),
    ],
)
def test_what_is_no_recording_of_ours_is_one_sentence(recordings: Path, command: str, mend: str) -> None:
    refused(recordings, command, "foreign.mcap", "foreign.mcap", mend)


@pytest.mark.parametrize("name", NO_RECORDING)
def test_a_recording_that_cannot_be_opened_is_one_sentence(recordings: Path, name: str) -> None:
    refused(recordings, "fit", name, *NO_RECORDING[name])


@pytest.mark.parametrize("command", ["fit", "export"])
def test_a_recording_that_was_cut_off_says_how_to_rescue_it(recordings: Path, command: str) -> None:
    refused(recordings, command, "cut.mcap", "cut.mcap is cut off after", "norton-bench recover cut.mcap")


def test_a_recording_with_nothing_to_fit_says_what_to_record(recordings: Path) -> None:
    refused(recordings, "fit", "tare.mcap", "no segment made for identification", "record one with 'free'")


@pytest.mark.parametrize("command", ["fit", "export"])
def test_a_folder_that_cannot_be_made_is_one_sentence(recordings: Path, command: str) -> None:
    refused(recordings, command, "whole.mcap", "notes.txt", "choose another", more=("--out", "notes.txt"))


def refused(folder: Path, command: str, name: str, *says: str, more: tuple[str, ...] = ()) -> None:
    before = sorted(folder.rglob("*"))
    done = norton_bench(folder, command, name, *more)  # not --quiet: what is refused is not begun
    assert (done.returncode, done.stdout) == (ExitCode.USAGE, "")
    (sentence,) = done.stderr.splitlines()
    assert all(part in sentence for part in says), sentence
    assert sorted(folder.rglob("*")) == before


def test_what_was_cut_off_is_recovered_and_then_fitted(recordings: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((recordings / "cut.mcap").read_bytes())
    done = norton_bench(tmp_path, "recover", "cut.mcap")
    assert (done.returncode, done.stderr) == (ExitCode.OK, "")
    rescue = json.loads(done.stdout)
    assert (rescue["recording"], rescue["was_complete"]) == ("cut.recovered.mcap", False)
    again = norton_bench(tmp_path, "recover", "cut.mcap")
    assert again.returncode == ExitCode.USAGE
    assert again.stderr.startswith("cut.recovered.mcap is there already")
    fitted = norton_bench(tmp_path, "fit", "cut.recovered.mcap", "--quiet")
    assert (fitted.returncode, fitted.stderr) == (ExitCode.OK, "")
    found = json.loads(fitted.stdout)
    assert found["converged"] is True
    assert found["parameters"]["amplifier_bandwidth"]["value"] == pytest.approx(600, rel=0.15)
    assert found["parameters"]["inertia"] == {"value": None, "std": None, "unit": "kg*m^2", "status": "ratio only"}
    assert Path(tmp_path, found["report"]).is_file()
    assert cut.read_bytes() == (recordings / "cut.mcap").read_bytes()
