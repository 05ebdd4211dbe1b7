"""The operator at the command line: Ctrl-C pauses or stops, and prompts are answered with a line."""

import select
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from norton_bench.cli.output import complain
from norton_bench.events import Prompt, Question, SessionEvent, SessionState, StateChanged
from norton_bench.loop.stop_word import StopWord
from norton_bench.session.operator import Order

PAUSED = "Paused; the drives are idle. Enter: resume, t: tare, s: leave out the next step, a: abort."
WORDS = {"": "resume", "r": "resume", "t": "tare", "s": "skip", "a": "abort"}


class CommandLineOperator:
    """Takes signals and, at a terminal, lines. It watches the session to know what a line answers."""

    def __init__(self, *, at_terminal: bool) -> None:
        self.stop = StopWord()
        self.answers = at_terminal
        self._orders: list[Order] = []
        self._pausing = False
        self._prompt: Prompt | None = None
        self._paused = False

    def orders(self) -> Sequence[Order]:
        if (self._paused or self._prompt is not None) and select.select([sys.stdin], [], [], 0.0)[0]:
            self._take(sys.stdin.readline())
        orders, self._orders = self._orders, []
        return orders

    def watch(self, event: SessionEvent) -> None:
        """Take an event of the session: it decides what the next line of the operator answers."""
        match event:
            case StateChanged(state):
                self._follow(state)
            case Question(prompt):
                self._prompt = prompt
                _say(f"{prompt.text} " + (f"[{'/'.join(prompt.choices)}] " if prompt.choices else "[Enter] "))

    def _follow(self, state: SessionState) -> None:
        was_paused, self._paused = self._paused, state is SessionState.PAUSED
        if state is SessionState.PAUSING:
            _say("will pause after this procedure; Ctrl-C again stops now")
        elif state is SessionState.PAUSED:
            _say(PAUSED)
        elif state is SessionState.RUNNING:
            self._pausing = False
            if was_paused:
                _say("going on")

    def interrupt(self, number: int, _frame: FrameType | None) -> None:
        """The signal handler. While the session is stopping already it raises KeyboardInterrupt."""
        if self.stop.heard() is not None:
            raise KeyboardInterrupt
        if number == signal.SIGTERM:
            self.stop.say("asked to end")
        elif self.answers and not self._pausing and not self._paused and self._prompt is None:
            self._pausing = True
            self._orders.append(Order("pause"))
        else:
            self.stop.say("Ctrl-C")

    def _take(self, line: str) -> None:
        if not line:
            self.stop.say("the terminal was closed")
        elif self._prompt is not None:
            self._prompt = None
            self._orders.append(Order("answer", line.strip()))
        else:
            self._obey(line.strip().lower())

    def _obey(self, word: str) -> None:
        meant = WORDS.get(word[:1])
        if meant is None:
            _say(PAUSED)
        elif meant == "abort":
            self.stop.say("aborted while paused")
        elif meant == "resume":
            self._orders.append(Order("resume"))
        elif meant == "tare":
            self._orders.append(Order("tare"))
        else:
            self._orders += [Order("skip"), Order("resume")]


@contextmanager
def operator_here() -> Iterator[CommandLineOperator]:
    """Inside, signals go to the operator. With a terminal for input and output there are prompts, else only the
    stop."""
    operator = CommandLineOperator(at_terminal=sys.stdin.isatty() and sys.stderr.isatty())
    before = {number: signal.signal(number, operator.interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield operator
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _say(text: str) -> None:
    """Print, also with ``--quiet``: the session waits for an answer."""
    complain(text)
