"""Ctrl-C as the operator's stop: asked for once, the loop ends by itself with the drives idle; twice, all ends."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from norton_bench.loop.stop_word import StopWord


@contextmanager
def operator_stop() -> Iterator[StopWord]:
    """Inside, the yielded word is said once there is a reason to stop."""
    stop = StopWord()

    def ask(number: int, _frame: FrameType | None) -> None:
        if stop.heard() is not None:
            raise KeyboardInterrupt
        stop.say("Ctrl-C" if number == signal.SIGINT else "asked to end")

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
