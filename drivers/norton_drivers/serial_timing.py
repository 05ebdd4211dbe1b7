"""Time on a serial line: when a message was complete, and how often a line carries a drive's commands and answers."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final, TypeVar

Message = TypeVar("Message")

BITS_PER_BYTE = 10  # start, eight data bits, stop
# A device's own USB port has no baud rate, but some rate must be asked for; at full speed it carries about as much.
USB: Final = 0
USB_BAUD: Final = 1_000_000


def opened_at(baud: int) -> int:
    """The rate with which a port is opened: that of its UART, or any for a device's own USB port (:data:`USB`)."""
    return baud or USB_BAUD


class ByteStamps:
    """Computes when a message on a serial line was complete, from the arrival of the bytes it was read with.

    Bytes come one by one: a message was complete before those that followed it in the same chunk.

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
    ) -> list[tuple[Message, int]]:
        """Messages of ``length`` bytes that stood one behind the other, each with when it was complete."""
        stamped: list[tuple[Message, int]] = []
        for later, message in zip(range(len(messages) - 1, -1, -1), messages, strict=True):
            stamped.append((message, self.complete_ns(arrival_ns, later_bytes + later * length)))
        return stamped


# Of what a line carries one way, at most: a queue that is never empty grows.
MOST_SHARE: Final = 0.9
# A reading in fewer ticks than one of these shows neither the guard nor the fit what the loop does.
MOST_TICKS: Final = 4


@dataclass(frozen=True)
class Exchange:
    """What crosses the line of a drive that is commanded in every tick and asked as soon as it has answered.

    Lengths are the longest in bytes; ``echo_bytes`` is what the drive answers to a command, ``aside_bytes_s`` what is
    asked beside, in bytes a second. Both directions are separate, as on UARTs and USB. ``thinking_s`` passes in the
    drive between a question and its answer.
    """

    baud: int
    command_bytes: int
    question_bytes: int
    answer_bytes: int
    thinking_s: float
    echo_bytes: int = 0
    aside_bytes_s: float = 0.0

    @property
    def round_s(self) -> float:
        """From a question to its answer, without what adapters add."""
        return (self.question_bytes + self.answer_bytes + self.echo_bytes) * self._byte_s + self.thinking_s

    @property
    def greatest_rate_hz(self) -> float:
        """Of a loop that gets a reading in every tick."""
        left_over = max(MOST_SHARE - self.aside_bytes_s * self._byte_s, 1e-3)
        there_s = (self.command_bytes + self.question_bytes) * self._byte_s / left_over
        return 1 / max(there_s, self.round_s)

    def ticks(self, tick_s: float) -> int:
        """From one reading to the next."""
        return max(1, ceil(self.round_s / tick_s - 1e-9))

    def share_there(self, tick_s: float) -> float:
        """Of what the line carries to the drive."""
        a_tick = self.command_bytes + self.question_bytes / self.ticks(tick_s) + self.aside_bytes_s * tick_s
        return a_tick * self._byte_s / tick_s

    def share_back(self, tick_s: float) -> float:
        """Of what the line carries from the drive."""
        return (self.echo_bytes + self.answer_bytes / self.ticks(tick_s)) * self._byte_s / tick_s

    def serves(self, tick_s: float) -> bool:
        """Whether a loop with this tick can use it."""
        busiest = max(self.share_there(tick_s), self.share_back(tick_s))
        return busiest <= MOST_SHARE and self.ticks(tick_s) <= MOST_TICKS

    @property
    def _byte_s(self) -> float:
        return BITS_PER_BYTE / opened_at(self.baud)
