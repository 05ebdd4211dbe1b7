"""Ctrl-C as the operator's stop: asked for once, the loop ends by itself with the drives idle; twice, all ends."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def operator_stop() -> Iterator[Callable[[], str | None]]:
    """Inside, the yielded function returns the reason to stop once there is one, else None."""
    reasons: list[str] = []

    def ask(number: int, _frame: FrameType | None) -> None:
        if reasons:
            raise KeyboardInterrupt
        reasons.append("stopped by the operator" if number == signal.SIGINT else "asked to end")

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: reasons[0] if reasons else None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
