"""What a receiver makes of bytes that were sent at another baud rate: it samples the same line at its own times."""

from collections.abc import Iterator
from math import floor

_DATA_BITS = 8
_FRAME_BITS = 10  # start, eight data bits, stop


def heard_at(data: bytes, sent_baud: float, heard_baud: float) -> bytes:
    """``data``, sent back to back without parity and with one stop bit, as a UART of another rate receives it.

    The line rests before and after. A character whose stop bit is missing is handed over all the same, as most drivers
    do; the receiver then waits for the line to rest.
    """
    return bytes(_heard(_Line(data, sent_baud), 1 / heard_baud))


class _Line:
    """The level of the line at any time [s], counted from the first start bit."""

    def __init__(self, data: bytes, baud: float) -> None:
        self._bits = [bit for byte in data for bit in (0, *((byte >> place) & 1 for place in range(_DATA_BITS)), 1)]
        self._baud = baud

    def level(self, time_s: float) -> int:
        place = floor(time_s * self._baud)
        return self._bits[place] if 0 <= place < len(self._bits) else 1

    def next_fall_s(self, from_s: float) -> float | None:
        """When the line next goes from rest to a start bit; a line that is low already must rest first."""
        place = max(0, floor(from_s * self._baud))
        before = self.level(from_s)
        while place < len(self._bits):
            if before == 1 and self._bits[place] == 0:
                return max(from_s, place / self._baud)
            before = self._bits[place]
            place += 1
        return None


def _heard(line: _Line, bit_s: float) -> Iterator[int]:
    at_s = -bit_s
    while (start_s := line.next_fall_s(at_s)) is not None:
        # Half a bit in, a false start bit is seen for what it is.
        if line.level(start_s + 0.5 * bit_s) == 1:
            at_s = start_s + 0.5 * bit_s
            continue
        bits = (line.level(start_s + (1.5 + place) * bit_s) << place for place in range(_DATA_BITS))
        yield sum(bits)
        at_s = start_s + (_FRAME_BITS - 0.5) * bit_s
