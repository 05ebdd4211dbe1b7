"""The program at a real terminal: Ctrl-C once pauses, twice stops, prompts are answered with a line."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from norton_bench.cli.app import main
from norton_bench.errors import ExitCode
from norton_bench.recording.reader import read_recording
from tests.bench.half_rate import half_rate_text

ROOT = Path(__file__).parents[3]
WAIT_S = 90.0
RUN = [sys.executable, "-m", "norton_bench", "run", "s.toml", "--rig", "rig.toml", "--out", "out"]
# Without the process that identifies meanwhile.
UNWATCHED = ("--no-live",)
LONG = """\
[[step]]
do = "tare"
duration = "500 ms"
[[step]]
do = "rest"
duration = "500 ms"
repeat = 60
"""
ASKING = """\
[[step]]
do = "ask"
name = "fixture"
text = "Which fixture is mounted?"
choices = ["A", "B"]
[[step]]
do = "rest"
duration = "200 ms"
when = { answer = "fixture", is = "B" }
"""


@dataclass
class Terminal:
    """The program on a pseudo-terminal, in a session of its own as a shell would give it."""

    folder: Path
    session: str
    said: str = ""
    more: tuple[str, ...] = UNWATCHED
    _process: subprocess.Popen[bytes] = field(init=False)
    _master: int = field(init=False)

    def __post_init__(self) -> None:
        (self.folder / "s.toml").write_text(self.session)
        (self.folder / "rig.toml").write_text(half_rate_text("sim-odrive"))
        self._master, slave = pty.openpty()
        command = [*RUN, *self.more]
        self._process = subprocess.Popen(
            command,
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "100"},
            stdin=slave,
            stdout=slave,
            stderr=slave,
            preexec_fn=own_terminal,  # noqa: PLW1509  (no threads here)
        )
        os.close(slave)

    def _read(self) -> str:
        try:
            return os.read(self._master, 65536).decode(errors="replace")
        except OSError:  # nobody has the other end open any more
            raise AssertionError(f"it has ended: {self.said[-2000:]}") from None

    def until(self, words: str) -> None:
        """Read until it has said this since it was last asked."""
        end = time.monotonic() + WAIT_S
        while words not in self.said:
            assert time.monotonic() < end, self.said[-2000:]
            if select.select([self._master], [], [], 0.2)[0]:
                self.said += self._read()
        self.said = self.said.partition(words)[2]

    def type(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def signal(self, number: int) -> None:
        self._process.send_signal(number)

    def end(self) -> int:
        """Its exit code, with all that it said."""
        end = time.monotonic() + WAIT_S
        while self._process.poll() is None and time.monotonic() < end:
            self._drain()
        self._drain()
        return self._process.wait(1.0)

    def close(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        os.close(self._master)

    def events(self) -> list[str]:
        recording = read_recording(self.folder / "out" / "sim-odrive.mcap")
        assert recording.complete
        return [event.text for event in recording.measured.events if event.kind in ("operator", "stop", "answer")]

    def _drain(self) -> None:
        while select.select([self._master], [], [], 0.1)[0]:
            try:
                self.said += os.read(self._master, 65536).decode(errors="replace")
            except OSError:  # the other end is closed
                return


def own_terminal() -> None:
    """So that Ctrl-C on it becomes a signal."""
    import fcntl
    import termios

    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[list[Terminal]]:
    opened: list[Terminal] = []
    yield opened
    for terminal in opened:
        terminal.close()


def test_ctrl_c_pauses_enter_goes_on_and_ctrl_c_twice_stops(tmp_path: Path, terminals: list[Terminal]) -> None:
    terminal = Terminal(tmp_path, LONG, more=())  # Ctrl-C reaches the process that identifies, too
    terminals.append(terminal)
    terminal.until("/61 tare")
    terminal.type("\x03")
    terminal.until("will pause after this procedure; Ctrl-C again stops now")
    terminal.until("Paused; the drives are idle. Enter: resume")
    terminal.type("\n")
    terminal.until("going on")
    terminal.type("\x03")
    terminal.until("will pause after this procedure")
    terminal.type("\x03")
    assert terminal.end() == ExitCode.INTERRUPTED
    assert "stopped by the operator: Ctrl-C" in terminal.said
    assert terminal.events()[:2] == ["paused", "resumed"]
    assert terminal.events()[-1] == "stopped by the operator: Ctrl-C"


@pytest.mark.long
def test_a_paused_session_can_be_aborted(tmp_path: Path, terminals: list[Terminal]) -> None:
    terminal = Terminal(tmp_path, LONG)
    terminals.append(terminal)
    terminal.until("/61 tare")
    terminal.type("\x03")
    terminal.until("Paused")
    terminal.type("what\n")
    terminal.until("Paused")
    terminal.type("a\n")
    assert terminal.end() == ExitCode.INTERRUPTED
    assert "stopped by the operator: aborted while paused" in terminal.said


@pytest.mark.long
def test_a_prompt_is_answered_with_a_line(tmp_path: Path, terminals: list[Terminal]) -> None:
    terminal = Terminal(tmp_path, ASKING)
    terminals.append(terminal)
    terminal.until("Which fixture is mounted? [A/B]")
    terminal.type("C\n")
    terminal.until('"C" must be one of A, B')
    terminal.until("Which fixture is mounted? [A/B]")
    terminal.type("B\n")
    assert terminal.end() == ExitCode.OK
    assert terminal.events() == ["fixture: B"]
    assert re.search(r"recording +out/sim-odrive.mcap", terminal.said)


@pytest.mark.long
def test_sigterm_stops_at_once(tmp_path: Path, terminals: list[Terminal]) -> None:
    terminal = Terminal(tmp_path, LONG)
    terminals.append(terminal)
    terminal.until("/61 rest")
    terminal.signal(signal.SIGTERM)
    assert terminal.end() == ExitCode.INTERRUPTED
    assert terminal.events() == ["stopped by the operator: asked to end"]


def test_without_a_terminal_prompts_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(ASKING)
    (tmp_path / "rig.toml").write_text(half_rate_text("sim-odrive"))
    with Path(os.devnull).open() as nobody:
        monkeypatch.setattr(sys, "stdin", nobody)
        assert main(["run", "s.toml", "--rig", "rig.toml", "--out", "out"]) == ExitCode.USAGE
    assert capsys.readouterr().err.splitlines()[-1] == (
        's.toml: asks "Which fixture is mounted?", and nobody is there to answer; run it on a terminal, or answer with '
        "--answer fixture=... or --yes"
    )
