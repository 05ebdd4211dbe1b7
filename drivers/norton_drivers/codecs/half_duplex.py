"""What codecs of servos on a half-duplex line share: the master asks for registers, and the servo asked answers."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol


class Answer(NamedTuple):
    """What one servo said. ``error`` is the error byte; ``later_bytes`` came after it in the same chunk."""

    node: int
    error: int
    data: bytes = b""
    later_bytes: int = 0


class Answers(Protocol):
    """Finds answers in a byte stream, however it is cut. Its methods never raise."""

    def feed(self, data: bytes) -> list[Answer]:
        """The answers that ``data`` completes, oldest first."""
        ...

    def drop(self) -> None:
        """Forget what has begun: what comes next is the beginning of an answer."""
        ...


class Dialect(Protocol):
    """The questions of one protocol, and how long its answers are."""

    overhead: int  # bytes of an answer beside its data
    reads_together: bool  # whether several servos can be asked at once

    def answers(self) -> Answers: ...

    def ping(self, node: int) -> bytes: ...

    def read(self, node: int, address: int, length: int) -> bytes: ...

    def sync_read(self, address: int, length: int, nodes: Sequence[int]) -> bytes:
        """Each node answers for itself, in this order; one node where the protocol cannot ask several."""
        ...

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> bytes:
        """By node; all values have the same length. Nobody answers."""
        ...
