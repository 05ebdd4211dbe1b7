"""The operator's desk: orders are heard at every part, marks obeyed at once, and all else between procedures."""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import sleep

from norton_bench.errors import OperatorStopError
from norton_bench.session.operator import Operator, Order
from norton_bench.session.progress import Progress, Prompt, SessionState

# How often somebody who is waited for is looked after.
LOOK_S = 0.02


@dataclass
class Desk:
    """``put_away`` takes kind and text of what the recording shall tell. The wants are orders not yet carried out.

    All methods but :meth:`listen` belong between procedures, where the drives are idle.
    """

    operator: Operator
    progress: Progress
    put_away: Callable[[str, str], None]
    paused: bool = field(default=False, init=False)
    wants_tare: bool = field(default=False, init=False)
    wants_skip: bool = field(default=False, init=False)
    _answer: str | None = field(default=None, init=False)

    def listen(self) -> None:
        """Take the orders that have come. Returns at once."""
        for order in self.operator.orders():
            self._take(order)

    def obey_stop(self) -> None:
        """Raises OperatorStopError where the stop was said."""
        reason = self.operator.stop.heard()
        if reason is not None:
            said = f"stopped by the operator: {reason}"
            self.put_away("stop", said)
            raise OperatorStopError(said)

    def wait(self) -> None:
        """While paused: until something else is ordered. Raises OperatorStopError."""
        if not self.paused:
            return
        self.progress.state(SessionState.PAUSED)
        self.put_away("operator", "paused")
        while self.paused and not self.wants_tare:
            self._look()
        resumed = not self.paused
        # Orders are heard while this is put away, too: a new pause must not be told over.
        self.put_away("operator", "resumed" if resumed else "tare ordered")
        if not resumed:
            self.progress.state(SessionState.RUNNING)

    def ask(self, prompt: Prompt) -> str:
        """The operator's answer, one of the choices where there are any. Raises OperatorStopError."""
        self.progress.state(SessionState.ASKING)
        self._answer = None
        answer = self._next_answer(prompt)
        while prompt.choices and answer not in prompt.choices:
            self.progress.note(f'"{answer}" is none of {", ".join(prompt.choices)}')
            answer = self._next_answer(prompt)
        self.progress.state(SessionState.RUNNING)
        return answer

    def _next_answer(self, prompt: Prompt) -> str:
        self.progress.ask(prompt)
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
            self.put_away("operator", f"mark: {order.text}" if order.text else "mark")
        elif order.kind == "answer":
            self._answer = order.text
        elif order.kind == "tare":
            self.wants_tare = True
        elif order.kind == "skip":
            self.wants_skip = True
        elif order.kind == "pause" and not self.paused:
            self.paused = True
            self.progress.state(SessionState.PAUSING)
        elif order.kind == "resume" and self.paused:
            self.paused = False
            self.progress.state(SessionState.RUNNING)
