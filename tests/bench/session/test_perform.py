"""Scripts are performed to their end: what fails is thrown back into them, and their last turns move nothing."""

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from norton_bench.errors import ExperimentError, OperatorStopError, SafetyStopError
from norton_bench.session.script import MOST_LAST_TURNS, Remark, Script, perform
from norton_drivers.errors import ConnectionFailedError

FINAL = (SafetyStopError("too fast"), OperatorStopError("space"), ConnectionFailedError("can0 is gone"))


@dataclass
class Stage:
    """Performs remarks; one that says so fails."""

    failing: dict[str, Exception] = field(default_factory=dict)
    done: list[str] = field(default_factory=list)
    last: list[str] = field(default_factory=list)

    def turn(self, yielded: object) -> None:
        assert isinstance(yielded, Remark)
        if yielded.text in self.failing:
            raise self.failing[yielded.text]
        self.done.append(yielded.text)

    def last_turn(self, yielded: object, error: Exception) -> None:
        assert isinstance(yielded, Remark)
        self.last.append(yielded.text)


def tidy() -> Script:
    try:
        yield Remark("one")
        yield Remark("two")
    finally:
        yield Remark("clear up")


def stubborn() -> Script:
    while True:
        try:
            yield Remark("one")
            yield Remark("two")
        except Exception:
            pass


def forgiving() -> Script:
    try:
        yield Remark("two")
    except ExperimentError:
        yield Remark("instead")
    yield Remark("three")


def test_all_turns_come_in_order() -> None:
    stage = Stage()
    perform(tidy(), stage)
    assert (stage.done, stage.last) == (["one", "two", "clear up"], [])


def test_a_failed_experiment_is_cleared_up_and_told() -> None:
    stage = Stage({"two": ExperimentError("no fit")})
    with pytest.raises(ExperimentError, match="no fit"):
        perform(tidy(), stage)
    assert (stage.done, stage.last) == (["one", "clear up"], [])


def test_a_script_may_go_on_after_a_failed_experiment() -> None:
    stage = Stage({"two": ExperimentError("no fit")})
    perform(forgiving(), stage)
    assert stage.done == ["instead", "three"]


@pytest.mark.parametrize("error", FINAL, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize(("script", "last"), [(tidy, ["clear up"]), (forgiving, [])])
def test_what_is_final_leaves_last_turns_only(error: Exception, script: Callable[[], Script], last: list[str]) -> None:
    stage = Stage({"two": error})
    with pytest.raises(type(error), match=str(error)):
        perform(script(), stage)
    assert stage.last == last


def test_a_script_that_will_not_end_is_ended() -> None:
    stage = Stage({"two": FINAL[0]})
    with pytest.raises(SafetyStopError):
        perform(stubborn(), stage)
    assert len(stage.last) == MOST_LAST_TURNS


def test_when_the_program_itself_ends_there_are_no_last_turns() -> None:
    stage = Stage({"two": KeyboardInterrupt()})  # type: ignore[dict-item]
    with pytest.raises(KeyboardInterrupt):
        perform(tidy(), stage)
    assert (stage.done, stage.last) == (["one"], [])
