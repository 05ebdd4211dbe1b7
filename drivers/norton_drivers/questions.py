"""Asking a device that speaks only when it is spoken to: one question at a time, and a lost answer ends nothing."""

from collections.abc import Callable

from norton_drivers.link import Link

# The first answer after a port was opened may be to a question that somebody else asked.
ANSWERS_THAT_TELL = 2


class Questions:
    """Asks again as soon as the last answer is there, or after ``timeout_s`` where none came.

    Answers do not say what they answer. One that comes after a question was given up may be that question's own, late;
    so nothing more is asked until the other, if there is one, must have come too, and found nobody waiting.

    ``ask`` sends the question. ``pause_s`` is how long the device or its line wants to be left alone after an answer.
    ``answers`` and ``unanswered`` count. While ``hushed``, nothing is asked.
    """

    def __init__(self, link: Link, ask: Callable[[], None], timeout_s: float, pause_s: float = 0.0) -> None:
        self.answers = 0
        self.unanswered = 0
        self.hushed = False
        self._ask = ask
        self._clock = link.clock
        self._timeout_ns = round(timeout_s * 1e9)
        self._pause_ns = round(pause_s * 1e9)
        self._asked_ns: int | None = None
        self._overdue = False
        self._given_up = False  # whether the question before the present one got no answer
        self._free_ns = 0  # when the next question may be asked
        link.questions.append(self.ask_if_due)

    def ask_if_due(self) -> None:
        """Ask, where nothing is awaited and the line may be used. Raises ConnectionFailedError."""
        now_ns = self._clock.now_ns()
        if self.hushed:
            return
        if self._asked_ns is None:
            if now_ns >= self._free_ns:
                self._given_up = False
                self._send(now_ns)
        elif now_ns < self._asked_ns + self._timeout_ns:
            return
        elif not self._overdue:
            # This computer may have stood still, with the answer waiting in its buffers: the ports come first.
            self._overdue = True
        else:
            self.unanswered += 1
            self._given_up = True
            self._send(now_ns)

    def answered(self, arrival_ns: int) -> int | None:
        """Take note of an answer, and ask anew. Returns when it was asked for, None where nothing was awaited.

        Raises ConnectionFailedError.
        """
        asked_ns = self._asked_ns
        if asked_ns is not None:
            self.answers += 1
            self._asked_ns = None
            self._free_ns = asked_ns + self._timeout_ns if self._given_up else arrival_ns + self._pause_ns
            # At once rather than at the next poll: a tick is as long as some devices take to answer. But a device that
            # takes no time at all must not keep the poll from ending.
            if self._clock.now_ns() > asked_ns:
                self.ask_if_due()
        return asked_ns

    def _send(self, now_ns: int) -> None:
        self._asked_ns, self._overdue = now_ns, False
        self._ask()
