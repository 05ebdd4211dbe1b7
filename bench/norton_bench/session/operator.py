"""What an operator asks of a session: to stop, which the loop obeys at once, and orders that wait for a checkpoint.

A checkpoint lies between procedures, and between the rounds of an adaptive step: the drives are idle there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from norton_bench.loop.stop_word import StopWord

Kind = Literal["pause", "resume", "tare", "mark", "skip", "answer", "jog"]


@dataclass(frozen=True)
class Order:
    """One order. ``text`` is what a mark says, the answer to the prompt that was asked last, or what is to be moved;
    else empty.

    ``pause`` and ``resume`` hold the session at the next checkpoint; ``tare`` measures bench and sensor at rest there;
    ``skip`` leaves out the step that would come next there. ``mark`` is put into the recording at once. ``jog`` is for
    whoever moves the bench by hand (:mod:`norton_bench.jog.board`).
    """

    kind: Kind
    text: str = ""


class Operator(Protocol):
    """Somebody who watches a session. ``answers`` tells whether prompts will be answered at all."""

    @property
    def stop(self) -> StopWord: ...
    @property
    def answers(self) -> bool: ...
    def orders(self) -> Sequence[Order]:
        """Those that came since this was last asked, in order. Must return at once."""
        ...


class Nobody:
    """Nobody is there: nothing is ever ordered, and a prompt would wait forever."""

    answers = False

    def __init__(self, stop: StopWord | None = None) -> None:
        self.stop = StopWord() if stop is None else stop

    def orders(self) -> Sequence[Order]:
        return ()
