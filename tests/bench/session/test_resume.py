"""A session that was interrupted goes on behind its last finished step, and its results are of both recordings."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import OperatorStopError, UsageError
from norton_bench.events import Note, PartMeasured, PlannedStep, Question, SessionEvent, StepBegun
from norton_bench.loop.stop_word import StopWord
from norton_bench.recording.reader import read_recording
from norton_bench.records import Measured
from norton_bench.result import Result
from norton_bench.session import engine
from norton_bench.session.conclusion import conclude_recording
from norton_bench.session.engine import run_session
from norton_bench.session.operator import Order
from norton_bench.session.resume import EarlierSession, before, read_earlier
from norton_bench.session.schema import parse_session
from tests.bench.half_rate import half_rate
from tests.bench.session.conclusions import fit_alone

pytestmark = pytest.mark.long

RIG = half_rate("sim-odrive")
TEXT = """\
[[step]]
do = "ask"
name = "fixture"
text = "Which fixture?"
[[step]]
do = "tare"
duration = "500 ms"
[[step]]
do = "calibrate"
duration = "4 s"
[[step]]
do = "imposed"
when = { answer = "fixture", is = "A" }
velocities = ["-15 rad/s", "15 rad/s"]
commands = 1
amplitude = "30 %"
duration = "1 s"
[[step]]
do = "imposed"
commands = 1
amplitude = "30 %"
duration = "1 s"
"""
SESSION = parse_session(TEXT, place="test.toml")


@dataclass
class Stopper:
    """Answers with A, and stops when step ``at`` has measured for a while."""

    at: int
    answers: bool = True
    stop: StopWord = field(default_factory=StopWord)
    steps: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    _parts: int = 0
    _orders: list[Order] = field(default_factory=list)

    def orders(self) -> Sequence[Order]:
        orders, self._orders = self._orders, []
        return orders

    def watch(self, event: SessionEvent) -> None:
        match event:
            case Question():
                self._orders.append(Order("answer", "A"))
            case Note(text):
                self.notes.append(text)
            case StepBegun(_, name):
                self.steps.append(name)
                self._parts = 0
            case PartMeasured():
                self._parts += 1
                if len(self.steps) == self.at and self._parts > 8:
                    self.stop.say("enough")


@dataclass(frozen=True)
class Both:
    whole: Result
    first: Path
    resumed: Result
    watched: Stopper


def ran(out: Path, watcher: Stopper, resume: Path | None = None) -> Result:
    out.mkdir()
    with fit_alone():
        return run_session(
            RIG, SESSION, out=out, seed=1, on_event=watcher.watch, operator=watcher, resume=resume, live=False
        )


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Both:
    folder = tmp_path_factory.mktemp("resume")
    whole = ran(folder / "whole", Stopper(at=99))
    with pytest.raises(OperatorStopError):
        ran(folder / "first", Stopper(at=5))
    watched = Stopper(at=99)
    return Both(whole, folder / "first", ran(folder / "second", watched, folder / "first"), watched)


def test_only_what_was_not_finished_is_done_again(both: Both) -> None:
    done = read_recording(both.resumed.recording).measured
    assert {segment.procedure for segment in done.segments} == {"imposed"}
    assert [event.text for event in done.events if event.kind == "step"] == ["imposed"]
    assert any("of which 3 procedures were finished" in note for note in both.watched.notes)
    assert both.watched.steps == ["ask", "tare", "calibrate", "imposed", "imposed"]


def test_what_was_known_is_known_again(both: Both) -> None:
    assert both.resumed.knowledge.tare == both.whole.knowledge.tare
    again, once = both.resumed.knowledge.calibration, both.whole.knowledge.calibration
    assert again is not None
    assert once is not None
    assert again.inertia_kgm2 == pytest.approx(once.inertia_kgm2, rel=1e-3)


def test_the_results_are_of_both_recordings(both: Both) -> None:
    names = [segment.procedure for segment in both.resumed.measured.segments]
    whole = [segment.procedure for segment in both.whole.measured.segments]
    assert names == whole
    for name in ("torque_gain", "inertia", "viscous_damping", "coulomb_torque"):
        one, other = both.whole.parameter(name), both.resumed.parameter(name)
        assert abs(one.value - other.value) < 4 * np.hypot(one.std, other.std), name
        assert other.interval < 2 * one.interval
    fits = [result.fit for result in (both.whole, both.resumed)]
    assert fits[0] is not None
    assert fits[1] is not None
    assert fits[1].samples == pytest.approx(fits[0].samples, rel=0.02)


def test_a_recording_that_resumes_another_is_fitted_with_it(both: Both, tmp_path: Path) -> None:
    with fit_alone():
        fit = conclude_recording(both.resumed.recording, tmp_path).fit
    assert fit is not None
    assert fit.estimate("inertia").value == both.resumed.parameter("inertia").value


def planned(*names: str) -> list[PlannedStep]:
    """A name with "?" is of a step that may be left out."""
    return [PlannedStep(name.rstrip("?"), 1.0, certain=not name.endswith("?")) for name in names]


@pytest.mark.parametrize(
    ("plan", "finished"),
    [
        ("ask tare calibrate imposed? imposed", "tare calibrate imposed"),
        ("tare calibrate imposed? free? imposed validate", "tare calibrate imposed validate"),
        ("tare calibrate rest? rest? rest? free", "tare calibrate rest rest free"),
        ("tare calibrate refine validate", "tare calibrate refine refine refine"),
        ("tare calibrate free", ""),
    ],
)
def test_what_a_session_may_have_finished_is_taken(plan: str, finished: str) -> None:
    """No error is raised."""
    records = [(name, Measured()) for name in finished.split()]
    EarlierSession("r.mcap", (), deque(records)).check(planned(*plan.split()))


@pytest.mark.parametrize(
    ("plan", "finished", "said"),
    [
        ("tare free", "tare calibrate", "there 'calibrate' came next, where this session has 'free'"),
        ("tare calibrate? free", "tare blocked", "there 'blocked' came next"),
        ("tare calibrate", "tare calibrate free", "has more finished steps than this session"),
        ("free tare", "tare", "there 'tare' came next, where this session has 'free'"),
    ],
)
def test_what_it_cannot_have_finished_is_refused(plan: str, finished: str, said: str) -> None:
    records = [(name, Measured()) for name in finished.split()]
    with pytest.raises(UsageError, match=said):
        EarlierSession("r.mcap", (), deque(records)).check(planned(*plan.split()))


def test_the_wrong_recording_is_refused_before_anything_is_opened(both: Both, monkeypatch: pytest.MonkeyPatch) -> None:
    other = parse_session('[[step]]\ndo = "tare"\n[[step]]\ndo = "rest"\n', place="other.toml")
    monkeypatch.setattr(engine, "load_backend", None)
    with pytest.raises(UsageError, match="resume with the session that was recorded"):
        run_session(RIG, other, out=both.first, seed=1, resume=both.first)


def test_records_are_put_before_the_later_one(both: Both) -> None:
    later = read_recording(both.resumed.recording).measured
    earlier = before(read_earlier(both.first, RIG).records, later)
    assert [len(record.events) for record in earlier] == [0, 0, 0]
    for name, stamp in (("ticks", "tick_ns"), ("motion", "arrival_ns"), ("torque", "arrival_ns")):
        stamps = np.concatenate([getattr(record, name)[stamp] for record in (*earlier, later)])
        assert np.all(np.diff(stamps) > 0), name
    numbers = np.concatenate([record.torque["sequence"] for record in (*earlier, later)])
    assert np.all(np.diff(numbers) > 0)
    indices = [segment.index for record in earlier for segment in record.segments]
    assert max(indices) < -1
    assert len(indices) == len(set(indices))


def test_another_session_is_refused(both: Both, tmp_path: Path) -> None:
    other = parse_session('[[step]]\ndo = "rest"\n', place="other.toml")
    with pytest.raises(UsageError, match="there 'tare' came next, where this session has 'rest'; resume with the"):
        run_session(RIG, other, out=tmp_path, resume=both.first)


@pytest.mark.parametrize("shorter", [1, 2])
def test_a_shorter_session_is_refused(both: Both, tmp_path: Path, shorter: int) -> None:
    steps = tuple(step for step in SESSION.steps if getattr(step, "do", "") != "ask")[:shorter]
    with pytest.raises(UsageError, match="has more finished steps than this session"):
        run_session(RIG, replace(SESSION, steps=steps), out=tmp_path, resume=both.first)


def test_another_rig_is_refused(both: Both, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="was recorded with rig = sim-odrive, this rig has other; resume on the same"):
        run_session(replace(RIG, name="other"), SESSION, out=tmp_path, resume=both.first, operator=Stopper(at=99))


def test_nothing_to_resume_is_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"holds no recording \(.mcap\); name the one to resume"):
        run_session(RIG, SESSION, out=tmp_path, resume=tmp_path, operator=Stopper(at=99))
