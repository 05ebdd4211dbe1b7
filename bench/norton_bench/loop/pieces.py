"""Messages over a pipe, in pieces that are there whole or not at all: who reads never waits for who writes.

A long segment is more than a pipe holds. Read at once, its rest is waited for, and whoever writes it may be kept from
the processor meanwhile, which a loop must not be.
"""

import pickle
import select
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

# Up to this, multiprocessing's pipes write a message and its length at once.
PIECE_BYTES = 16_000
# In one go: a tick has time for as many.
AT_ONCE = 8
MORE, LAST = b"\0", b"\1"


def send_in_pieces(pipe: "Connection[Any, Any]", message: object) -> None:
    """Returns when all of it is in the pipe. Raises OSError where nobody reads any more."""
    data = pickle.dumps(message)
    for at in range(0, len(data), PIECE_BYTES):
        piece = data[at : at + PIECE_BYTES]
        pipe.send_bytes((LAST if at + PIECE_BYTES >= len(data) else MORE) + piece)


@dataclass
class PieceReader:
    """The far end of :func:`send_in_pieces`."""

    pipe: "Connection[Any, Any]"
    _pieces: list[bytes] = field(default_factory=list, init=False)
    _whole: bool = field(default=False, init=False)  # a message, or the pipe's end

    def __post_init__(self) -> None:
        self._something_waits = _waiting_in(self.pipe)

    def ready(self) -> bool:
        """Take what waits; whether there is a message to read, or the pipe's end. Never waits."""
        for _ in range(AT_ONCE):
            if self._whole or not self._something_waits():
                break
            self._take()
        return self._whole

    def read(self) -> Any:
        """The next message, waited for. Raises EOFError where the pipe has ended, OSError where it is closed."""
        while not self._whole:
            self._take()
        pieces, self._pieces, self._whole = self._pieces, [], False
        if not pieces or not pieces[-1].startswith(LAST):
            raise EOFError
        return pickle.loads(b"".join([piece[1:] for piece in pieces]))

    def _take(self) -> None:
        try:
            self._pieces.append(self.pipe.recv_bytes())
        except (EOFError, ConnectionResetError):
            self._whole = True
        else:
            self._whole = self._pieces[-1].startswith(LAST)


def _waiting_in(pipe: "Connection[Any, Any]") -> Callable[[], bool]:
    """Whether there is something to read in the pipe, or its end. Its own ``poll`` takes half of a tick's work."""
    if not hasattr(select, "poll"):  # Windows
        return pipe.poll
    poller = select.poll()
    poller.register(pipe, select.POLLIN)
    return lambda: bool(poller.poll(0))
