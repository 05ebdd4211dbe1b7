"""Ctrl-C as the operator's stop: asked for once, the loop ends by itself with the drives idle; twice, all ends."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from bench.loop.stop_word import StopWord


@contextmanager
def operator_stop() -> Iterator[StopWord]:
    """Inside, the yielded word is said when the operator, or the system, asks to stop."""
    word = StopWord()

    def ask(number: int, _frame: FrameType | None) -> None:
        if word.heard() is not None:
            raise KeyboardInterrupt
        word.say("stopped by the operator" if number == signal.SIGINT else "asked to end")

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield word
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
