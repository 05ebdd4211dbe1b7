"""An operator at a simulated bench: orders are obeyed between procedures, prompts wait, and the recording tells."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from norton_bench.errors import OperatorStopError, SafetyStopError, UsageError
from norton_bench.events import (
    Ended,
    Note,
    Planned,
    PlannedStep,
    Question,
    SessionEvent,
    SessionState,
    StateChanged,
    StepBegun,
)
from norton_bench.loop.stop_word import StopWord
from norton_bench.procedures.options import TareOptions
from norton_bench.procedures.tare import RestOptions, RestProcedure, TareProcedure
from norton_bench.recording.reader import read_recording
from norton_bench.session.engine import run_script, run_session
from norton_bench.session.operator import Answers, Order
from norton_bench.session.schema import parse_session
from norton_bench.session.script import Ask, Script, SoFar
from tests.bench.half_rate import half_rate

RIG = half_rate("sim-odrive")
TARE = TareProcedure(TareOptions(duration_s=0.5))
REST = RestProcedure(RestOptions(duration_s=0.2))


@dataclass
class Attendant:
    """Watches a session, and gives what ``orders`` holds for a state as soon as the session has come to it."""

    planned: dict[SessionState, list[Order]] = field(default_factory=dict)
    answers: bool = True
    stop: StopWord = field(default_factory=StopWord)
    heard: list[str] = field(default_factory=list)
    plans: list[Sequence[PlannedStep]] = field(default_factory=list)
    steps: list[tuple[int, str]] = field(default_factory=list)
    summary: Ended | None = None
    replies: deque[str] = field(default_factory=deque)
    _waiting: list[Order] = field(default_factory=list)

    def orders(self) -> Sequence[Order]:
        orders, self._waiting = self._waiting, []
        return orders

    def watch(self, event: SessionEvent) -> None:
        match event:
            case StateChanged(state):
                self.heard.append(state.value)
                self._waiting += self.planned.pop(state, [])
            case Question(prompt):
                self.heard.append(prompt.text)
                self._waiting.append(Order("answer", self.replies.popleft()))
            case Note(text):
                self.heard.append(text)
            case Planned(steps):
                self.plans.append(steps)
            case StepBegun(index, name):
                self.steps.append((index, name))
            case Ended():
                self.summary = event


def events(out: Path, *kinds: str) -> list[str]:
    recording = read_recording(out / "sim-odrive.mcap")
    assert recording.complete
    return [event.text for event in recording.measured.events if event.kind in kinds]


def performed(script: Callable[[SoFar], Script], out: Path, attendant: Attendant, **more: Answers) -> None:
    run_script(RIG, script, out=out, seed=1, on_event=attendant.watch, operator=attendant, **more)


def two_rests(_so_far: SoFar) -> Script:
    yield REST
    yield REST


def test_a_pause_holds_the_session_between_procedures(tmp_path: Path) -> None:
    attendant = Attendant(
        {
            SessionState.RUNNING: [Order("mark", "fan on"), Order("pause")],
            SessionState.PAUSED: [Order("mark", "fan off"), Order("resume")],
        }
    )
    performed(two_rests, tmp_path, attendant)
    states = [text for text in attendant.heard if text in {state.value for state in SessionState}]
    assert states[:5] == ["preparing", "running", "pausing", "paused", "running"]
    assert events(tmp_path, "operator", "step") == [
        "mark: fan on",
        "paused",
        "mark: fan off",
        "resumed",
        "rest",
        "rest",
    ]


@pytest.mark.long
def test_a_tare_that_is_ordered_is_no_step_of_the_session(tmp_path: Path) -> None:
    attendant = Attendant({SessionState.RUNNING: [Order("tare")]})
    performed(two_rests, tmp_path, attendant)
    assert any(text.startswith("tare: +0.00") for text in attendant.heard)
    recording = read_recording(tmp_path / "sim-odrive.mcap")
    assert "tare" in {segment.procedure for segment in recording.measured.segments}
    assert events(tmp_path, "step") == ["rest", "rest"]


@pytest.mark.long
def test_a_step_is_left_out_unless_others_need_it(tmp_path: Path) -> None:
    text = '[[step]]\ndo = "rest"\nduration = "200 ms"\n[[step]]\ndo = "tare"\nduration = "500 ms"\n'
    attendant = Attendant({SessionState.RUNNING: [Order("skip")]})
    session = parse_session(text, place="test")
    run_session(RIG, session, out=tmp_path, seed=1, on_event=attendant.watch, operator=attendant)
    assert events(tmp_path, "operator", "step") == ["left out: rest", "tare"]
    needed = '[[step]]\ndo = "tare"\nduration = "500 ms"\n[[step]]\ndo = "calibrate"\nduration = "2 s"\n'
    attendant = Attendant({SessionState.RUNNING: [Order("skip")]})
    again = tmp_path / "again"
    again.mkdir()
    run_session(
        RIG, parse_session(needed, place="test"), out=again, seed=1, on_event=attendant.watch, operator=attendant
    )
    assert "'tare' cannot be left out: 'calibrate' builds on it" in attendant.heard
    assert events(again, "step") == ["tare", "calibrate"]


def asking(so_far: SoFar) -> Script:
    yield Ask("fixture", "Which fixture?", ("A", "B"))
    if so_far.answers["fixture"] == "B":
        yield REST
    yield Ask("name", "Who are you?")


def test_prompts_wait_for_an_answer_that_is_allowed(tmp_path: Path) -> None:
    attendant = Attendant(replies=deque(["C", " B ", "Ada"]))
    performed(asking, tmp_path, attendant)
    assert attendant.heard.count("Which fixture?") == 2
    assert '"C" must be one of A, B' in attendant.heard
    assert events(tmp_path, "answer", "step") == ["fixture: B", "rest", "name: Ada"]
    assert attendant.steps == [(0, "ask"), (1, "rest"), (2, "ask")]
    assert [len(plan) for plan in attendant.plans] == [0, 1, 2, 3]


def test_prompts_may_be_answered_beforehand(tmp_path: Path) -> None:
    performed(asking, tmp_path, Attendant(answers=False), answers=Answers({"name": "Ada"}, yes=True))
    assert events(tmp_path, "answer") == ["fixture: A", "name: Ada"]


def test_a_script_is_told_how_a_script_answers(tmp_path: Path) -> None:
    said = (
        r'the script: asks "Which fixture\?".*; give it answers=Answers\(\{"fixture": "A"\}\) or answers=Answers\(yes='
    )
    with pytest.raises(UsageError, match=said):
        performed(asking, tmp_path, Attendant(answers=False))


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        (
            Answers({"name": "Ada"}),
            r'test: asks "Which fixture\?", and nobody is there to answer; run it on a terminal',
        ),
        (Answers({"fixture": "C"}, yes=True), "--answer fixture=C: must be one of A, B"),
        (
            Answers({"fixtur": "A"}, yes=True),
            r'--answer fixtur=A: test has no such prompt; did you mean "fixture"',
        ),
    ],
)
def test_without_answers_nothing_is_opened(answers: Answers, said: str, tmp_path: Path) -> None:
    text = '[[step]]\ndo = "ask"\nname = "fixture"\ntext = "Which fixture?"\nchoices = ["A", "B"]\n'
    text += '[[step]]\ndo = "ask"\nname = "name"\ntext = "Who?"\n'
    with pytest.raises(UsageError, match=said):
        run_session(RIG, parse_session(text, place="test"), out=tmp_path, answers=answers)
    assert list(tmp_path.iterdir()) == []


def cleared_up(_so_far: SoFar) -> Script:
    try:
        yield TARE
    finally:
        yield REST
        yield Ask("clamp", "Take the clamp off.")


def test_a_stop_between_procedures_moves_nothing_more(tmp_path: Path) -> None:
    attendant = Attendant()
    attendant.stop.say("space")
    with pytest.raises(OperatorStopError, match="stopped by the operator: space"):
        performed(cleared_up, tmp_path, attendant)
    assert attendant.heard[-3:] == ["left out 'rest': after this end nothing may move", "Take the clamp off.", "failed"]
    assert events(tmp_path, "stop", "step") == ["stopped by the operator: space"]
    assert attendant.summary is not None
    assert attendant.summary.failure == "stopped by the operator: space"
    assert attendant.summary.recording == tmp_path / "sim-odrive.mcap"


def test_after_a_safety_stop_prompts_are_asked_and_nothing_moves(tmp_path: Path) -> None:
    fault = '[[fault]]\nkind = "dropout"\non = "torque_sensor"\nafter = "armed"\nat = "200 ms"\n'
    text = '[[step]]\ndo = "tare"\n[[step]]\ndo = "rest"\nalways = true\n'
    text += '[[step]]\ndo = "ask"\nname = "clamp"\ntext = "Take the clamp off."\nalways = true\n' + fault
    attendant = Attendant(replies=deque(["done"]))
    with pytest.raises(SafetyStopError, match="torque sensor: silent"):
        run_session(
            RIG, parse_session(text, place="test"), out=tmp_path, seed=1, on_event=attendant.watch, operator=attendant
        )
    assert "left out 'rest': after this end nothing may move" in attendant.heard
    assert events(tmp_path, "answer", "step") == ["clamp: done"]
