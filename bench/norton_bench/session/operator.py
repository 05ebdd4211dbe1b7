"""The operator of a session gives a stop, which the loop obeys at once, and orders that wait for the next checkpoint.

A checkpoint lies between two procedures, and between two rounds of an adaptive step: the drives are idle there.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import sleep
from typing import Literal, Protocol

from norton_bench.errors import OperatorStopError, UsageError, nearest
from norton_bench.events import Note, Prompt, Question, SessionState, StateChanged, Watcher
from norton_bench.loop.stop_word import StopWord

Kind = Literal["pause", "resume", "tare", "mark", "skip", "answer", "jog"]


@dataclass(frozen=True)
class Order:
    """One order. ``text`` is the text of a mark, the answer to the last prompt, or what to move; else empty.

    ``pause`` and ``resume`` hold the session at the next checkpoint; ``tare`` measures bench and sensor at rest there;
    ``skip`` leaves out the step that would come next there. ``mark`` is put into the recording at once. ``jog`` is for
    a bench that is moved by hand (:class:`norton_bench.jog.hands.Board`).
    """

    kind: Kind
    text: str = ""


class Operator(Protocol):
    """Who gives orders to a session. ``answers`` is False where nobody is there to answer prompts."""

    @property
    def stop(self) -> StopWord: ...
    @property
    def answers(self) -> bool: ...
    def orders(self) -> Sequence[Order]:
        """The orders since the last call, in order. Must return at once."""
        ...


class Nobody:
    """No operator: no orders, and no answers to prompts."""

    answers = False

    def __init__(self, stop: StopWord | None = None) -> None:
        self.stop = StopWord() if stop is None else stop

    def orders(self) -> Sequence[Order]:
        return ()


YES = "yes"


@dataclass(frozen=True)
class Answers:
    """Answers to prompts, given before the session starts, so that it can run without an operator.

    ``given`` are by name of the prompt. With ``yes``, every other prompt gets its first choice, or "yes".
    """

    given: Mapping[str, str] = field(default_factory=dict)
    yes: bool = False

    def to(self, prompt: Prompt) -> str | None:
        """The answer to ``prompt``; None where the operator must be asked."""
        if prompt.name in self.given:
            return self.given[prompt.name]
        if not self.yes:
            return None
        return prompt.choices[0] if prompt.choices else YES

    def check(self, prompts: Sequence[Prompt], place: str, *, somebody: bool) -> None:
        """Raises UsageError for answers that fit no prompt, and for unanswered prompts where ``somebody`` is False."""
        names = {prompt.name: prompt for prompt in prompts}
        for name, answer in self.given.items():
            if name not in names:
                raise UsageError(f"--answer {name}={answer}: {place} has no such prompt; {nearest(name, names)}")
            choices = names[name].choices
            if choices and answer not in choices:
                raise UsageError(f"--answer {name}={answer}: must be one of {', '.join(choices)}")
        for prompt in prompts:
            if not somebody and self.to(prompt) is None:
                raise unanswered(prompt, place)


def unanswered(prompt: Prompt, place: str) -> UsageError:
    """The error for a prompt of a session that nobody can answer."""
    return _nobody_answers(prompt, place, f"run it on a terminal, or answer with --answer {prompt.name}=... or --yes")


def unanswered_by_script(prompt: Prompt) -> UsageError:
    """The same for a prompt of a program's own script, which has no command line."""
    answer = prompt.choices[0] if prompt.choices else YES
    return _nobody_answers(
        prompt,
        "the script",
        f'give it answers=Answers({{"{prompt.name}": "{answer}"}}) or answers=Answers(yes=True) '
        "(norton_bench.session.operator), or an operator",
    )


def _nobody_answers(prompt: Prompt, place: str, mend: str) -> UsageError:
    return UsageError(f'{place}: asks "{prompt.text}", and nobody is there to answer; {mend}')


NO_ANSWERS = Answers()


def parsed(written: Sequence[str]) -> dict[str, str]:
    """Parse ``["fixture=A"]``; by name. Raises UsageError for an answer without a name, and for a name given twice."""
    given: dict[str, str] = {}
    for assignment in written:
        name, equals, answer = assignment.partition("=")
        if not equals or not name:
            raise UsageError(f"--answer {assignment}: write it like --answer fixture=A")
        if name in given:
            raise UsageError(f"--answer {name}: is given twice; give it once")
        given[name] = answer
    return given


# How often the session looks for an answer or an order while it waits.
LOOK_S = 0.02


@dataclass
class OperatorOrders:
    """Takes the operator's orders at every part. A mark is recorded at once; all else is done between procedures.

    ``record`` puts an event into the recording: its kind and its text. ``paused`` and the ``wants_...`` are orders not
    yet carried out. All methods but :meth:`listen` belong between procedures, where the drives are idle.
    """

    operator: Operator
    emit: Watcher
    record: Callable[[str, str], None]
    paused: bool = field(default=False, init=False)
    wants_tare: bool = field(default=False, init=False)
    wants_skip: bool = field(default=False, init=False)
    _answer: str | None = field(default=None, init=False)

    def listen(self) -> None:
        """Take the orders that have come. Never waits."""
        for order in self.operator.orders():
            self._take(order)

    def obey_stop(self) -> None:
        """Raises OperatorStopError where the operator has stopped the session."""
        reason = self.operator.stop.heard()
        if reason is not None:
            message = f"stopped by the operator: {reason}"
            self.record("stop", message)
            raise OperatorStopError(message)

    def wait(self) -> None:
        """While paused: until something else is ordered. Raises OperatorStopError."""
        if not self.paused:
            return
        self.emit(StateChanged(SessionState.PAUSED))
        self.record("operator", "paused")
        while self.paused and not self.wants_tare:
            self._look()
        resumed = not self.paused
        # Orders are taken while this is recorded, too: the state of a new pause must stay the last one.
        self.record("operator", "resumed" if resumed else "tare ordered")
        if not resumed:
            self.emit(StateChanged(SessionState.RUNNING))

    def ask(self, prompt: Prompt) -> str:
        """The operator's answer, one of the choices where there are any. Raises OperatorStopError."""
        self.emit(StateChanged(SessionState.ASKING))
        self._answer = None
        answer = self._next_answer(prompt)
        while prompt.choices and answer not in prompt.choices:
            self.emit(Note(f'"{answer}" must be one of {", ".join(prompt.choices)}'))
            answer = self._next_answer(prompt)
        self.emit(StateChanged(SessionState.RUNNING))
        return answer

    def _next_answer(self, prompt: Prompt) -> str:
        self.emit(Question(prompt))
        while self._answer is None:
            self._look()
        answer, self._answer = self._answer.strip(), None
        return answer

    def _look(self) -> None:
        sleep(LOOK_S)
        self.listen()
        self.obey_stop()

    def _take(self, order: Order) -> None:
        if order.kind == "mark":
            self.record("operator", f"mark: {order.text}" if order.text else "mark")
        elif order.kind == "answer":
            self._answer = order.text
        elif order.kind == "tare":
            self.wants_tare = True
        elif order.kind == "skip":
            self.wants_skip = True
        elif order.kind == "pause" and not self.paused:
            self.paused = True
            self.emit(StateChanged(SessionState.PAUSING))
        elif order.kind == "resume" and self.paused:
            self.paused = False
            self.emit(StateChanged(SessionState.RUNNING))
