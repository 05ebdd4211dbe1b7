"""A session in a child process: its events come as in one process; it ends, drives idle, when its watcher does."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from norton_bench.errors import ExitCode
from norton_bench.events import (
    Ended,
    PartMeasured,
    Planned,
    SessionEvent,
    SessionState,
    StateChanged,
    StepBegun,
)
from norton_bench.recording.reader import read_recording
from norton_bench.session.hosted import HostedSession
from norton_bench.session.operator import Order
from norton_bench.session.schema import parse_session
from tests.bench.half_rate import half_rate, half_rate_text

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
RIG = half_rate("sim-odrive")
SHORT = '[[step]]\ndo = "tare"\nduration = "500 ms"\n[[step]]\ndo = "calibrate"\nduration = "2 s"\n'
# Several minutes of bench time: stopped long before its end.
LONG = SHORT + '[[step]]\ndo = "imposed"\nduration = "600 s"\n'
WAIT_S = 60.0


def hosted(out: Path, text: str) -> HostedSession:
    return HostedSession(RIG, parse_session(text, place="test"), out=out, seed=1)


def until(session: HostedSession, enough: Callable[[SessionEvent], bool]) -> list[SessionEvent]:
    """All events up to the first that is ``enough``, and what came with it."""
    heard: list[SessionEvent] = []
    end = time.monotonic() + WAIT_S
    while not any(map(enough, heard)):
        assert time.monotonic() < end, heard[-3:]
        heard += session.events()
        time.sleep(0.01)
    return heard


def over(event: SessionEvent) -> bool:
    return isinstance(event, Ended)


def summary(heard: list[SessionEvent]) -> Ended:
    assert isinstance(heard[-1], Ended)
    return heard[-1]


@pytest.fixture(scope="module")
def heard(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[SessionEvent]]:
    with hosted(tmp_path_factory.mktemp("short"), SHORT) as session:
        session.order(Order("mark", "the fan was on"))
        yield until(session, over)


def test_the_events_are_those_of_a_session(heard: list[SessionEvent]) -> None:
    (plan,) = (event for event in heard if isinstance(event, Planned))
    assert [step.name for step in plan.steps] == ["tare", "calibrate"]
    assert [event.name for event in heard if isinstance(event, StepBegun)] == ["tare", "calibrate"]
    states = [event.state for event in heard if isinstance(event, StateChanged)]
    assert states[0] is SessionState.PREPARING
    assert states[-3:] == [SessionState.RUNNING, SessionState.CONCLUDING, SessionState.DONE]
    assert summary(heard).exit_code == ExitCode.OK


def test_the_parts_are_what_was_recorded(heard: list[SessionEvent]) -> None:
    parts = [event for event in heard if isinstance(event, PartMeasured)]
    path = summary(heard).recording
    assert path is not None
    recorded = read_recording(path).measured
    ticks = sum(len(event.measured.ticks) for event in parts)
    assert ticks > 1000
    assert ticks == len(recorded.ticks) or any(event.dropped for event in parts)
    assert parts[-1].measured.frames == ()


def test_a_stop_ends_it_at_once(tmp_path: Path) -> None:
    with hosted(tmp_path, LONG) as session:
        until(session, lambda event: isinstance(event, PartMeasured))
        session.stop("space")
        end = summary(until(session, over))
    assert end.exit_code == ExitCode.INTERRUPTED
    assert end.failure == "stopped by the operator: space"
    assert end.recording is not None
    assert read_recording(end.recording).complete
    assert not session.running


def test_closing_ends_it_too(tmp_path: Path) -> None:
    session = hosted(tmp_path, LONG)
    until(session, lambda event: isinstance(event, PartMeasured))
    session.close()
    assert not session.running
    assert read_recording(tmp_path / "sim-odrive.mcap").complete


def test_closing_gives_up_a_fit(tmp_path: Path) -> None:
    """The drives are idle and the recording is whole by then: nobody has to wait."""
    session = hosted(tmp_path, SHORT + '[[step]]\ndo = "free"\nlevels = 3\ndwell = "100 ms"\nduration = "1 s"\n')
    until(session, lambda event: event == StateChanged(SessionState.CONCLUDING))
    session.close()
    assert not session.running
    assert read_recording(tmp_path / "sim-odrive.mcap").complete
    assert not (tmp_path / "sim-odrive.report.html").exists()


def test_the_death_of_a_child_is_reported(tmp_path: Path) -> None:
    with hosted(tmp_path, LONG) as session:
        until(session, lambda event: isinstance(event, PartMeasured))
        assert session.pid is not None
        os.kill(session.pid, signal.SIGKILL)
        end = summary(until(session, over))
    assert end.exit_code == ExitCode.EXPERIMENT_FAILED
    assert "exit code -9" in end.failure
    assert "norton-bench recover" in end.failure


WATCHER = """
import sys, time
from pathlib import Path
from norton_bench.events import PartMeasured
from norton_bench.rig.load import load_rig
from norton_bench.session.hosted import HostedSession
from norton_bench.session.schema import parse_session
if __name__ == "__main__":
    session = HostedSession(load_rig(sys.argv[1]), parse_session(sys.argv[3], place="test"), out=Path(sys.argv[2]))
    while not any(isinstance(event, PartMeasured) for event in session.events()):
        time.sleep(0.01)
    print(session.pid, flush=True)
    time.sleep(600)
"""


def test_a_watcher_that_is_killed_stops_the_session_and_leaves_the_recording_whole(tmp_path: Path) -> None:
    (tmp_path / "watcher.py").write_text(WATCHER)
    (tmp_path / "rig.toml").write_text(half_rate_text("sim-odrive"))
    command = [sys.executable, "watcher.py", "rig.toml", str(tmp_path), LONG]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True) as watcher:
        assert watcher.stdout is not None
        child = int(watcher.stdout.readline())
        watcher.kill()
    end = time.monotonic() + WAIT_S
    while Path(f"/proc/{child}").exists() and "zombie" not in Path(f"/proc/{child}/status").read_text():
        assert time.monotonic() < end
        time.sleep(0.05)
    recording = read_recording(tmp_path / "sim-odrive.mcap")
    assert recording.complete
    (stop,) = (event for event in recording.measured.events if event.kind == "stop")
    assert "the watcher is gone" in stop.text
