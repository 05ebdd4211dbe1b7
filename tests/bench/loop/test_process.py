"""The loop in a process of its own, on served devices in wall time: it ticks, it hands on, and whatever dies, the
drives end idle."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from norton_bench.errors import ExperimentError, OperatorStopError, SafetyStopError, UsageError
from norton_bench.faults.host_loss import last_state, read_witness
from norton_bench.loop import process as process_module
from norton_bench.loop.loop import HELD_S
from norton_bench.loop.orders import SILENT_NS
from norton_bench.loop.process import LoopProcess
from norton_bench.loop.stop_word import StopWord
from norton_bench.procedures.waves import coasting
from norton_bench.records import NO_SEGMENT, Measured, join
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use
from norton_drivers.errors import ConnectionFailedError
from tests.bench.half_rate import HALF_RATE
from tests.bench.served import rig_of_its_own, served
from tests.processes import children, process_lives, soon

pytestmark = pytest.mark.wall_time
TABLES = ("motion", "load_motion", "torque", "current", "load_current")
SESSION = Path(__file__).with_name("session_to_lose.py")
TICK_NS = 2_000_000


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return rig_of_its_own(tmp_path_factory.mktemp("loop"), **HALF_RATE)


@pytest.fixture(scope="module")
def witness(rig: Rig) -> Iterator[Path]:
    with served(rig) as witness:
        yield witness


@contextmanager
def opened(rig: Rig, stop: StopWord | None = None) -> Iterator[tuple[LoopProcess, list[Measured]]]:
    parts: list[Measured] = []
    with LoopProcess(rig, stop) as loop:
        loop.subscribe(parts.append)
        yield loop, parts
    assert not process_lives(loop.pid)


def push(seconds: float, command: float = 0.02) -> Segment:
    return coasting("test", "push", Use.PREPARE, np.full(round(seconds * 1e9 / TICK_NS), command))


def stumble_after(loop: LoopProcess, segment: Segment) -> None:
    with loop.running():
        loop.run(segment)
        raise ExperimentError("not enough")


def armed(witness: Path) -> tuple[str, ...]:
    state = last_state(witness)
    assert state is not None
    return state.armed


def once_it_ticks(loop: LoopProcess, parts: list[Measured], act: Callable[[], None]) -> list[int]:
    """``act`` after some ticks; when that was stands in the list, once it was."""
    acted_ns: list[int] = []

    def take(part: Measured) -> None:
        parts.append(part)
        if not acted_ns and sum(len(each.ticks) for each in parts) > 50:
            acted_ns.append(time.monotonic_ns())
            act()

    loop.subscribe(take)
    return acted_ns


@pytest.mark.long
def test_it_ticks_alone_and_hands_on_all_that_it_sees(rig: Rig, witness: Path) -> None:
    with opened(rig) as (loop, parts):
        assert len(list(Path(f"/proc/{loop.pid}/task").iterdir())) == 1
        assert loop.place.startswith("in a process of its own")
        assert [identity.driver for identity in loop.identify()] == ["odrive", "odrive", "bota"]
        with loop.running():
            assert armed(witness) == ("actuator", "load")
            first, second = loop.run(push(0.5)), loop.run(push(0.5))
        assert armed(witness) == ()
        assert loop.lost == 0
    whole = join([first, second])
    assert [segment.index for segment in whole.segments] == [0, 1]
    for measured, segment in ((first, whole.segments[0]), (second, whole.segments[1])):
        stamps = measured.ticks["tick_ns"]
        assert segment.start_ns <= stamps[0] <= stamps[-1] < segment.end_ns
        assert np.all(np.diff(stamps) % TICK_NS == 0)
        assert set(measured.ticks["segment"]) == {segment.index}
        assert measured.ticks["command"] == pytest.approx(0.02)
    handed_on = join(parts)
    within = handed_on.ticks["segment"] != NO_SEGMENT
    assert handed_on.ticks[within].tobytes() == whole.ticks.tobytes()
    for name in TABLES:  # what came before the first segment and after the last is in the recording alone
        assert getattr(whole, name).tobytes() in getattr(handed_on, name).tobytes(), name
    for stream in (whole.motion, whole.load_motion, whole.torque):
        assert len(stream) > 0.9 * len(whole.ticks)
        assert np.all(np.diff(stream["sequence"]) > 0)
        assert np.all(np.diff(stream["arrival_ns"]) >= 0)
    frames = handed_on.frames
    assert {frame.channel for frame in frames} == {"can0", rig.wiring.torque_sensor.port}  # type: ignore[union-attr]
    assert sum(frame.sent for frame in frames) >= 2 * len(whole.ticks)
    assert all(whole.ticks[stage].min() >= 0 for stage in ("receive_ns", "control_ns", "guard_ns", "send_ns"))
    work_ns = sum(whole.ticks[stage] for stage in ("receive_ns", "control_ns", "guard_ns", "send_ns"))
    assert np.all(np.abs(whole.ticks["work_ns"] - work_ns) <= whole.ticks["receive_ns"])


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2, reason="no core to be had")
def test_its_core_is_its_own_and_awake_while_drives_are_enabled(rig: Rig, witness: Path) -> None:
    before = os.sched_getaffinity(0)
    with opened(rig) as (loop, _):
        if len(before - os.sched_getaffinity(loop.pid)) == 0:
            pytest.skip("another test's loop has the core")
        (core,) = os.sched_getaffinity(loop.pid)
        assert loop.place.endswith(f", core {core}")
        assert os.sched_getaffinity(0) == before - {core}
        assert children(loop.pid) == []
        with loop.running():
            loop.run(push(1.0))  # while it starts
            (sleepless,) = children(loop.pid)
            assert os.sched_getscheduler(sleepless) == os.SCHED_IDLE
            assert os.sched_getaffinity(sleepless) == {core}
        assert children(loop.pid) == []
    assert os.sched_getaffinity(0) == before


@pytest.mark.long
def test_the_operators_word_stops_it_at_the_next_tick(rig: Rig, witness: Path) -> None:
    stop = StopWord()
    with opened(rig, stop) as (loop, parts):
        said = once_it_ticks(loop, parts, lambda: stop.say("space"))
        with pytest.raises(OperatorStopError, match="space"), loop.running():
            loop.run(push(20.0))
        assert armed(witness) == ()
    last_ns = int(join(parts).ticks["tick_ns"][-1])
    assert last_ns - said[0] < 25 * TICK_NS  # one tick, on a machine that nothing else uses
    assert [event.kind for event in join(parts).events] == ["stop"]


@pytest.mark.long
def test_a_session_that_is_late_or_stumbles_and_may_go_on(rig: Rig, witness: Path) -> None:
    """One loop serves them all."""
    with opened(rig) as (loop, parts):
        late_finds_its_bench_held(loop, parts, witness)
        stumbling_idles_the_drives(loop, parts, witness)
        stumbling_over_what_the_held_bench_measured_idles_the_drives(loop, witness)
        loop.subscribe(parts.append)
        thinking_with_the_drives_enabled_idles_them(loop, parts, witness)


def late_finds_its_bench_held(loop: LoopProcess, parts: list[Measured], witness: Path) -> None:
    """For longer than the loop itself might stand still (200 ms): it does not stand still."""
    with loop.running():
        loop.run(push(0.1))
        time.sleep(0.4)
        assert armed(witness) != ()
        second = loop.run(push(0.1))
    assert set(second.ticks["segment"]) == {second.segments[0].index}
    ticks = join(parts).ticks
    assert 0.3e9 < TICK_NS * np.count_nonzero(ticks["segment"] == NO_SEGMENT) < 1.0e9
    assert [segment.index for segment in join(parts).segments] == [0, 1]


def stumble(part: Measured) -> None:
    if len(part.ticks):
        raise ZeroDivisionError


def stumbling_idles_the_drives(loop: LoopProcess, parts: list[Measured], witness: Path) -> None:
    parts.clear()
    with pytest.raises(ExperimentError, match="not enough"):
        stumble_after(loop, push(0.1))
    assert armed(witness) == ()
    assert [event.text for event in join(parts).events] == ["not enough"]
    loop.subscribe(stumble)
    with pytest.raises(ZeroDivisionError), loop.running():
        loop.run(push(20.0))
    assert armed(witness) == ()
    loop.subscribe(parts.append)
    with loop.running():
        assert len(loop.run(push(0.1)).ticks) > 25


def stumbling_over_what_the_held_bench_measured_idles_the_drives(loop: LoopProcess, witness: Path) -> None:
    answered = loop._wait_for_answer

    def late(within_s: float) -> object:
        answer = answered(within_s)
        time.sleep(0.05)  # ticks have been run by then
        return answer

    loop.subscribe(stumble)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "_wait_for_answer", late)
        with pytest.raises(ZeroDivisionError), loop.running():
            pass
    assert armed(witness) == ()


def thinking_with_the_drives_enabled_idles_them(loop: LoopProcess, parts: list[Measured], witness: Path) -> None:
    def think() -> None:
        with loop.running():
            loop.run(push(0.1))
            soon(lambda: armed(witness) == (), HELD_S + 2.0)
            loop.run(push(0.1))

    with pytest.raises(SafetyStopError, match=r"within 5 s what comes .* decide with the drives idle") as stop:
        think()
    assert stop.value.by == "stall"
    assert "decide with the drives idle" in join(parts).events[-1].text
    loop.reset_guard("thought about it")
    with loop.running():
        loop.run(push(0.05))


@pytest.mark.long
def test_the_guard_trips_there_and_is_reset_from_here(tmp_path: Path) -> None:
    rig = rig_of_its_own(tmp_path, "239.74.163.66", **HALF_RATE, **{'velocity = "80 rad/s"': 'velocity = "5 rad/s"'})
    with served(rig) as witness, opened(rig) as (loop, parts):
        with pytest.raises(SafetyStopError, match=r"outside \[limits\] velocity = 5 rad/s") as stopped, loop.running():
            loop.run(push(20.0, 0.3))
        assert stopped.value.by == "velocity"
        assert armed(witness) == ()
        with pytest.raises(SafetyStopError, match="nothing is enabled again"), loop.running():
            pass
        with pytest.raises(UsageError):
            loop.reset_guard(" ")
        loop.reset_guard("looked at it")
        assert "looked at it" in join(parts).events[-1].text
        soon(lambda: abs(last_state(witness).velocity_rad_s) < 1.0, 10.0)  # type: ignore[union-attr]
        with loop.running():
            loop.run(push(0.05))


def test_what_opening_fails_with_is_raised_here(rig: Rig, tmp_path: Path) -> None:
    missing = rig_of_its_own(tmp_path)
    with pytest.raises(ConnectionFailedError, match="cannot open it"):
        LoopProcess(missing)


@pytest.mark.parametrize(
    ("number", "words", "within_s"),
    [(signal.SIGKILL, "ended by SIGKILL", 0.7), (signal.SIGSTOP, "has not been heard for 1 s", 0.7)],
    ids=["killed", "stopped"],
)
def test_a_loop_that_is_lost_is_said_and_its_drives_end_idle(
    rig: Rig, witness: Path, number: int, words: str, within_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process_module, "TICKS_WITHIN_S", 1.0)
    with opened(rig) as (loop, parts):
        struck_ns = once_it_ticks(loop, parts, lambda: os.kill(loop.pid, number))
        with pytest.raises(SafetyStopError, match=words) as lost, loop.running():
            loop.run(push(20.0))
        assert lost.value.by == "loop"
        soon(lambda: armed(witness) == (), within_s)
        driven_ns = [state.stamp_ns for state in read_witness(witness) if state.armed][-1]
        assert driven_ns - struck_ns[0] < within_s * 1e9
        with pytest.raises(SafetyStopError, match=words):
            loop.identify()
    measured = join(parts)
    # All that it ever put away is there, and the session's word on its end.
    assert measured.ticks["tick_ns"][-1] > struck_ns[0] - 10 * TICK_NS
    assert words in measured.events[-1].text
    assert str(lost.value) == measured.events[-1].text


@pytest.mark.parametrize(
    ("number", "within_s"),
    [(signal.SIGKILL, 0.3), (signal.SIGSTOP, SILENT_NS * 1e-9 + 0.3)],
    ids=["killed", "stopped"],
)
def test_a_loop_whose_session_is_lost_idles_the_drives(rig: Rig, witness: Path, number: int, within_s: float) -> None:
    with subprocess.Popen([sys.executable, str(SESSION), rig.place], stdout=subprocess.PIPE, text=True) as session:
        assert session.stdout is not None
        pid = int(session.stdout.readline())
        soon(lambda: armed(witness) == ("actuator", "load"), 5.0)
        time.sleep(0.3)
        try:
            session.send_signal(number)
            # Sooner than the drives' watchdogs, or, where the session may yet wake up, fed until it is given up.
            soon(lambda: armed(witness) == (), within_s)
        finally:
            session.kill()
    soon(lambda: not process_lives(pid), 5.0)


def test_a_session_that_stood_still_looks_once_more_before_it_calls_its_loop_silent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As on a virtual machine that was paused: the first look after it sees nothing new, the next one does."""
    loop, now_s = Listening(), iter([0.0, 200.0, 200.04])
    waits = iter([[], [], [loop._orders]])
    monkeypatch.setattr(process_module, "wait", lambda *_: next(waits))
    monkeypatch.setattr(time, "monotonic", lambda: next(now_s))
    assert loop._answer(lambda: None, 120.0) == "answer"


def test_a_loop_that_says_nothing_is_silent_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = iter([0.0, 200.0, *np.arange(200.04, 400.0, 0.04).tolist()])
    loop = Listening()
    monkeypatch.setattr(process_module, "wait", lambda *_: [])
    monkeypatch.setattr(time, "monotonic", lambda: next(now_s))
    with pytest.raises(SafetyStopError, match="has not been heard for 120 s"):
        loop._answer(lambda: None, 120.0)
    assert next(now_s) == pytest.approx(260.1, abs=0.1)


class Listening(LoopProcess):
    """Without a process: what it would hear is put in by hand."""

    def __init__(self) -> None:
        self._inbox = SimpleNamespace(ticks=0)  # type: ignore[assignment]
        self._process = SimpleNamespace(sentinel=0, kill=lambda: None)  # type: ignore[assignment]
        self._orders = SimpleNamespace(recv=lambda: "answer")  # type: ignore[assignment]

    def _beat(self) -> None:
        """Nobody to beat for."""

    def _lost(self, how: str) -> SafetyStopError:
        return SafetyStopError(how, "loop")
