"""The real screen in a real terminal, on devices that another process serves in wall time: space stops them.

`sim serve --witness` tells when the drives stopped to be armed, on the machine's own clock.
"""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from norton_bench.faults.host_loss import last_state, read_witness
from tests.bench.half_rate import half_rate_text

ROOT = Path(__file__).parents[3]
BENCH = [sys.executable, "-m", "norton_bench"]
GROUP = "239.74.163.83"
TICK_NS, WATCHDOG_NS = 2_000_000, 300_000_000
NOTICED_WITHIN_NS = 1_000_000_000  # that a process is gone, by the session it started
STARTS_WITHIN_S, STOPS_WITHIN_S = 120.0, 20.0

pytestmark = [
    pytest.mark.long,
    pytest.mark.wall_time,
    pytest.mark.skipif(shutil.which("tmux") is None, reason="there is no tmux: nothing else shows a real terminal"),
]


class Terminal:
    """A tmux server of this test's own, with one window."""

    def __init__(self, socket: Path) -> None:
        self._tmux = ["tmux", "-S", str(socket), "-f", "/dev/null"]

    def open(self, command: str, columns: int, rows: int) -> None:
        self._run("new-session", "-d", "-x", str(columns), "-y", str(rows), command)

    def press(self, *keys: str) -> tuple[int, int]:
        """The machine's monotonic time [ns] before anything was sent, and once the terminal has it."""
        before_ns = time.monotonic_ns()
        self._run("send-keys", *keys)
        return before_ns, time.monotonic_ns()

    def shown(self) -> str:
        return self._run("capture-pane", "-p")

    def close(self) -> None:
        subprocess.run([*self._tmux, "kill-server"], capture_output=True, check=False)

    def _run(self, *arguments: str) -> str:
        return subprocess.run([*self._tmux, *arguments], capture_output=True, text=True, check=True).stdout


def until(came: Callable[[], bool], within_s: float, what: Callable[[], str]) -> None:
    end = time.monotonic() + within_s
    while not came():
        assert time.monotonic() < end, what()
        time.sleep(0.02)


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """The dynamometer, on a multicast group and a port of this test's own."""
    text = half_rate_text("sim-odrive")
    path = tmp_path / "rig.toml"
    text = text.replace("239.74.163.2", GROUP).replace("socket://localhost:7641", f"{tmp_path}/bota")
    # A machine that runs other tests meanwhile stands still for longer; below the watchdogs all the same.
    path.write_text(text.replace('stale_after = "100 ms"', 'stale_after = "250 ms"').replace('"100 ms" ', '"250 ms" '))
    return path


@pytest.fixture
def witness(rig: Path) -> Iterator[Path]:
    path = rig.with_name("witness.csv")
    with subprocess.Popen(
        [*BENCH, "sim", "serve", str(rig), "--witness", str(path)], cwd=ROOT, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        assert "serving" in process.stderr.readline()
        yield path
        process.kill()


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path / "tmux")
    yield terminal
    terminal.close()


# A field takes what is typed for itself: where space stops there, it stops anywhere.
@pytest.mark.parametrize("way", ["space in a field", "the terminal is gone", "space by hand"])
def test_the_drives_are_idle_at_once(rig: Path, witness: Path, terminal: Terminal, tmp_path: Path, way: str) -> None:
    session = ROOT / "sessions" / "quick.toml"
    by_hand = way == "space by hand"
    what = ["jog", str(rig)] if by_hand else ["ui", str(rig), str(session)]
    command = [*BENCH, *what, "--backend", "hardware", "--out", str(tmp_path / "runs")]
    terminal.open(f"cd {ROOT} && PYTHONPATH={os.environ.get('PYTHONPATH', ROOT)} {' '.join(command)}", 80, 24)
    until(lambda: "READY" in terminal.shown(), STARTS_WITHIN_S, terminal.shown)
    terminal.press("s")

    def moving() -> bool:
        if by_hand and "setpoints" in terminal.shown() and "+0.05 N·m" not in terminal.shown():
            terminal.press("Up")
        state = last_state(witness)
        return state is not None and abs(state.velocity_rad_s) > 0.1 and len(state.armed) == 2

    until(moving, STARTS_WITHIN_S, terminal.shown)
    gone = way == "the terminal is gone"
    if gone:
        before_ns = time.monotonic_ns()
        terminal.close()
        asked_ns = time.monotonic_ns()
    else:
        terminal.press("k" if by_hand else "m")
        until(
            lambda: ("Calibrate the load?" if by_hand else "Mark this moment") in terminal.shown(),
            STOPS_WITHIN_S,
            terminal.shown,
        )
        before_ns, asked_ns = terminal.press("Space")
    until(lambda: not armed_now(witness), STOPS_WITHIN_S, lambda: f"still armed: {last_state(witness)}")
    idle_ns = next(state.stamp_ns for state in read_witness(witness) if state.stamp_ns > before_ns and not state.armed)
    assert idle_ns - asked_ns <= (NOTICED_WITHIN_NS if gone else TICK_NS + WATCHDOG_NS)
    if not gone:
        until(lambda: "STOPPED" in terminal.shown(), STOPS_WITHIN_S, terminal.shown)
        terminal.press("Escape")
        until(lambda: "Mark this moment" not in terminal.shown(), STOPS_WITHIN_S, terminal.shown)
        terminal.press("4")
        until(lambda: "stopped by the operator: the operator, by key" in terminal.shown(), 30.0, terminal.shown)
    time.sleep(0.5)
    assert not armed_now(witness)


def armed_now(witness: Path) -> tuple[str, ...]:
    state = last_state(witness)
    return () if state is None else state.armed
