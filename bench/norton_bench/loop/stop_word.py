"""The operator's stop, in memory that all of our processes share: any of them sets it, the loop looks every tick."""

import multiprocessing
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.sharedctypes import RawArray
from types import FrameType

UNSAID = b"\0"
SAID = b"\1"
LONGEST_REASON_BYTES = 240
NO_REASON = "asked to stop"


def never_stop() -> str | None:
    """No operator is there to stop anything."""
    return None


class StopWord:
    """Set once, it stays. Goes to spawned processes as an argument; nothing of it outlives them.

    The first reason stays. Nothing in it waits, so that a signal handler may set it too.
    """

    def __init__(self) -> None:
        # Taken by the first that sets a reason, and never given back.
        self._turn = multiprocessing.get_context("spawn").Lock()
        self._said = RawArray("c", 1)
        self._reason = RawArray("c", LONGEST_REASON_BYTES + 1)

    def say(self, reason: str) -> None:
        """Stop, because of ``reason``; what is longer than 240 bytes is cut."""
        if self._turn.acquire(block=False):
            self._reason.value = _cut(reason)
        # Also where another is still writing its reason, or was killed over it: the stop must not wait for words.
        self._said[0] = SAID

    def heard(self) -> str | None:
        """The reason, once there is one; costs a look at one byte until then."""
        if self._said[0] == UNSAID:
            return None
        return self._reason.value.decode(errors="replace") or NO_REASON


def _cut(reason: str) -> bytes:
    """As UTF-8, without half a letter at the end, and up to the first NUL."""
    text = reason.partition("\0")[0].encode(errors="replace")[:LONGEST_REASON_BYTES]
    return text.decode(errors="ignore").encode()


@contextmanager
def operator_stop() -> Iterator[StopWord]:
    """Inside, Ctrl-C and SIGTERM stop the session in order; a second one raises KeyboardInterrupt."""
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
