"""``rig new`` as a program: asked through a real terminal, and scripted; it never writes over a file unasked."""

import json
import os
import pty
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from norton_bench.cli import app
from norton_bench.errors import ExitCode
from norton_bench.rig.load import load_rig

ROOT = Path(__file__).parents[3]
PROGRAM = [sys.executable, "-c", "import sys; from norton_bench.cli.app import main; sys.exit(main())"]
ALONE = (
    "--set", "actuator.driver=odrive", "--set", "actuator.node=3", "--set", "actuator.command=0.5 N*m",
    "--set", "bus.can0.channel=can7", "--set", "limits.velocity=60 rad/s",
)  # fmt: skip


# What is asked of rigs/sim-odrive.toml, in order: what a rig needs, and what that file sets besides.
QUESTIONS = (
    "rig.name", "rig.rate", "actuator.driver", "actuator.bus", "actuator.node", "actuator.firmware",
    "actuator.watchdog", "actuator.counts_per_turn", "actuator.model", "actuator.command", "load.driver", "load.bus",
    "load.node", "load.firmware", "load.watchdog", "load.counts_per_turn", "load.direction", "load.torque_limit",
    "torque_sensor.driver", "torque_sensor.port", "torque_sensor.axis", "torque_sensor.range",
    "torque_sensor.direction", "bus.can0.interface", "bus.can0.channel", "bus.can0.bitrate", "limits.torque",
    "limits.velocity", "limits.position", "limits.temperature", "limits.power", "limits.stale_after",
    "limits.stall_after", "simulated.twin",
)  # fmt: skip


class Conversation:
    """A program on a pseudo-terminal: what it says is read, what is typed is written."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.terminal, far = pty.openpty()
        paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        environment = {**os.environ, "PYTHONPATH": paths, "TERM": "dumb", "COLUMNS": "200"}
        self.process = subprocess.Popen(
            [*PROGRAM, *arguments], cwd=folder, env=environment, stdin=far, stdout=far, stderr=far
        )
        os.close(far)
        self.said = ""
        self._unread = ""

    def expect(self, words: str, within_s: float = 30.0) -> None:
        """Read on until ``words`` were said, and no further."""
        deadline_s = time.monotonic() + within_s
        while words not in self._unread:
            ready, _, _ = select.select([self.terminal], [], [], max(0.0, deadline_s - time.monotonic()))
            assert ready, f"{words!r} was not said: {self._unread!r}"
            news = os.read(self.terminal, 4096).decode()
            self.said += news
            self._unread += news
        self._unread = self._unread.partition(words)[2]

    def answer(self, question: str, text: str) -> None:
        self.expect(f"{question}:" if question[-1] not in "])" else question)
        os.write(self.terminal, f"{text}\n".encode())

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self.terminal)


@pytest.fixture
def conversation(tmp_path: Path) -> Iterator[Conversation]:
    made = Conversation(tmp_path, "rig", "new", "asked.toml")
    yield made
    made.close()


@pytest.mark.long
@pytest.mark.wall_time
def test_a_person_is_asked_again_until_the_answer_can_be(conversation: Conversation, tmp_path: Path) -> None:
    for question, answer in (
        ("rig.name", ""),
        ("rig.rate", "500 Hz"),
        ("actuator.driver", "odrive"),
        ("actuator.bus", ""),
        ("actuator.node", "99"),
        ("actuator.node", "5"),
        ("actuator.model", ""),
        ("actuator.command", "0.5 N*m"),
        ("load.driver", ""),
        ("torque_sensor.driver", "none"),
        ("rig.shaft", ""),
        ("bus.can0.interface", "udp_multicast"),
        ("bus.can0.channel", "10.0.0.1"),
        ("bus.can0.channel", "239.74.163.9"),
        ("bus.can0.bitrate", ""),
        ("limits.velocity", "60 rad/s"),
        ("limits.position", ""),
        ("limits.temperature", ""),
        ("simulated.twin", ""),
    ):
        conversation.answer(question, answer)
    conversation.answer("[simulated/hardware/none] (simulated)", "")
    conversation.expect("next: rehearse it with norton-bench identify asked.toml --backend simulated", within_s=90)
    assert conversation.process.wait(timeout=10) == 0
    rig = load_rig(tmp_path / "asked.toml")
    assert (rig.name, rig.tick_ns, rig.wiring.actuator.options) == (
        "asked",
        2_000_000,
        {"node": 5, "watchdog": 0.3},
    )
    assert "must be a multicast address" in conversation.said
    assert "99 must be at most 63" in conversation.said
    assert "actuator.driver: the device under test: its driver (cia402, cubemars, " in conversation.said
    assert conversation.said.count("slcan") <= 2  # adapters are named once
    assert "norton-bench identify can run on it: tare, free, validate" in conversation.said


@pytest.mark.long
@pytest.mark.wall_time
def test_a_person_steps_back(conversation: Conversation, tmp_path: Path) -> None:
    for question, answer in (
        ("rig.name", "<"),  # there is nothing before it
        ("rig.name", "first"),
        ("rig.rate", "1 kHz"),
        ("actuator.driver", "odrive"),
        ("actuator.bus", "<"),
        ("actuator.driver", "vesc"),
        ("actuator.bus", "can7"),
        ("actuator.node", "4"),
        ("actuator.pole_pairs", "<"),
        ("actuator.node", "<"),
        ("actuator.bus: the name of its CAN bus, a new one or one named before [can7]", "can8"),
        ("actuator.node: the VESC ID, 0 to 254 [4]", ""),  # what was answered is proposed again
        ("actuator.pole_pairs", "7"),
        ("actuator.mode", "torque"),
        ("actuator.torque_constant", "<"),
        ("actuator.mode", "current"),
        ("actuator.position", ""),
        ("actuator.minimum_current", "10 mA"),
        ("actuator.model", ""),
        ("actuator.command", "0.5 N*m"),
        ("actuator.command", "5 A"),
        ("load.driver", ""),
        ("torque_sensor.driver", "none"),
        ("rig.shaft", ""),
        ("bus.can8.interface", "slcan"),
        ("bus.can8.channel", "/dev/ttyACM0"),
        ("bus.can8.bitrate", ""),
        ("limits.velocity", "60 rad/s"),
        ("limits.position", ""),
        ("limits.temperature", ""),
        ("simulated.twin", "none"),
        ("(nothing moves) [hardware/none] (none)", ""),
    ):
        conversation.answer(question, answer)
    conversation.expect("next: norton-bench rig check asked.toml --backend hardware")
    assert conversation.process.wait(timeout=10) == 0
    rig = load_rig(tmp_path / "asked.toml")
    (bus,) = rig.wiring.buses
    assert (rig.name, bus.name, bus.bitrate_bit_s, rig.command.unit) == ("first", "can8", 500_000, "A")
    assert rig.wiring.actuator.options["node"] == 4
    assert 'takes commands in "A" as it is set here; write it like 5 A' in conversation.said
    assert "can0" not in conversation.said.partition("bus.can8.channel")[2].partition("bus.can8.bitrate")[0]


@pytest.mark.long
@pytest.mark.wall_time
def test_contradictions_are_told_and_asked_once_more(tmp_path: Path) -> None:
    source = (ROOT / "rigs" / "sim-odrive.toml").read_text()
    (tmp_path / "odd.toml").write_text(source.replace('torque = "1 N*m"  ', 'torque = "0.1 N*m"'))
    conversation = Conversation(tmp_path, "rig", "new", "again.toml", "--from", "odd.toml")
    try:
        conversation.expect("rig.name:")
        os.write(conversation.terminal, b"\n" * len(QUESTIONS))  # every answer as the other file has it
        conversation.expect("contradict each other")
        for question in QUESTIONS:
            conversation.answer(question, "1 N*m" if question == "limits.torque" else "")
        conversation.expect("again.toml is written")
        conversation.answer("[simulated/hardware/none] (simulated)", "none")
        assert "exceed [limits] torque = 0.1 N*m" in conversation.said
        assert conversation.process.wait(timeout=10) == 0
        assert load_rig(tmp_path / "again.toml").limits.torque_nm == 1.0
    finally:
        conversation.close()


def run(tmp_path: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, "rig", "new", *arguments], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, timeout=60, check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip


@pytest.mark.long
def test_scripted(tmp_path: Path) -> None:
    done = run(tmp_path, "r.toml", *ALONE, "--json")
    said = json.loads(done.stdout)
    assert (done.returncode, said["rig"], said["backend"]) == (0, "r.toml", "simulated")
    assert (said["check"]["problems"], said["check"]["identify"]) == ([], None)
    assert load_rig(tmp_path / "r.toml").wiring.buses[0].channel == "can7"
    alone = run(tmp_path, "s.toml", *ALONE, "--set", "simulated.twin=none", "--json")
    assert (alone.returncode, json.loads(alone.stdout)) == (0, {"rig": "s.toml"})


@pytest.mark.long
def test_checked_on_the_hardware_where_that_is_said(tmp_path: Path) -> None:
    """There is none: the file is written all the same, and the exit code is the check's."""
    done = run(tmp_path, "r.toml", *ALONE, "--check", "hardware")
    assert done.returncode == ExitCode.CONNECTION
    assert "[bus.can0] socketcan on can7" in done.stderr
    assert load_rig(tmp_path / "r.toml").wiring.buses[0].channel == "can7"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("r.toml", *ALONE[:-2]), "limits.velocity is not answered: add --set limits.velocity=60 rad/s"),
        (("r.toml", *ALONE, "--set", "actuator.nodee=1"), "actuator.nodee: nobody asked for that"),
        (("r.toml", *ALONE, "--set", "node"), "write it like --set actuator.node=1"),
        (("nowhere/r.toml", *ALONE), "cannot be written (No such file or directory)"),
        (("r.toml", "--from", "none.toml"), "no such rig file"),
        (("there.toml", *ALONE), "there.toml exists already; name another file, or add --force"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    tmp_path: Path, arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("mine")
    code = app.main(["rig", "new", *arguments, "--yes"])
    streams = capsys.readouterr()
    assert (code, streams.out) == (ExitCode.USAGE, "")
    (sentence,) = streams.err.splitlines()
    assert words in sentence
    assert (tmp_path / "there.toml").read_text() == "mine"


def test_written_over_when_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("old")
    assert app.main(["rig", "new", "there.toml", *ALONE, "--yes", "--force"]) == ExitCode.OK
    assert load_rig("there.toml").name == "there"


def test_a_file_named_after_the_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert app.main(["rig", "new", *ALONE, "--set", "rig.name=dyno-3", "--yes"]) == ExitCode.OK
    assert load_rig("dyno-3.toml").name == "dyno-3"
