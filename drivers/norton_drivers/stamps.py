"""When a message on a serial line was complete, told from when the bytes it was read with had arrived."""

from collections.abc import Iterator, Sequence
from typing import TypeVar

Message = TypeVar("Message")

BITS_PER_BYTE = 10  # start, eight data bits, stop


class ByteStamps:
    """Bytes come one by one: a message was complete before those that followed it in the same chunk.

    Stamps never run backwards: adapters that pile bytes up hand them over closer together than they can have come.
    """

    def __init__(self, baud: int) -> None:
        self._byte_ns = BITS_PER_BYTE * 1e9 / baud
        self._last_ns = 0

    def complete_ns(self, arrival_ns: int, later_bytes: int) -> int:
        """For a message with ``later_bytes`` after it in a chunk whose last byte arrived at ``arrival_ns``."""
        self._last_ns = max(self._last_ns, arrival_ns - round(later_bytes * self._byte_ns))
        return self._last_ns

    def each(
        self, messages: Sequence[Message], length: int, arrival_ns: int, later_bytes: int
    ) -> Iterator[tuple[Message, int]]:
        """Messages of ``length`` bytes that stood one behind the other, each with when it was complete."""
        later_bytes += length * len(messages)
        for message in messages:
            later_bytes -= length
            yield message, self.complete_ns(arrival_ns, later_bytes)
