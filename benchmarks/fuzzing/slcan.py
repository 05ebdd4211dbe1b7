"""slcan: CAN frames in lines on a serial line."""

import re
from collections.abc import Sequence
from random import Random

from norton_drivers.codecs.slcan import SlcanFrame, SlcanStream

from .streams import StreamCodec


class SlcanLine:
    """Frames in lines; a damaged digit makes another frame, which nothing can tell."""

    by_chance = 0.0
    _GRAMMAR = re.compile(
        rb"(?:[tr](?P<i>[0-7][0-9a-fA-F]{2})|[TR](?P<j>[01][0-9a-fA-F]{7}))(?P<n>[0-8])(?P<rest>[0-9a-fA-F]*)"
    )

    def __init__(self) -> None:
        self._stream = SlcanStream()
        self._begun = b""

    def message(self, random: Random) -> tuple[bytes, object]:
        extended, remote = random.random() < 0.5, random.random() < 0.1
        length = random.randint(0, 8)
        data = b"" if remote else random.randbytes(length)
        frame = SlcanFrame(random.getrandbits(29 if extended else 11), data, length, extended, remote)
        return frame.encode(), frame

    def told(self, wire: bytes) -> Sequence[object]:
        *lines, self._begun = re.split(rb"[\r\a]", self._begun + wire)
        return [frame for line in lines if (frame := self._frame_in(line)) is not None]

    def hear(self, data: bytes) -> Sequence[object]:
        self._stream.feed(data)
        heard = list(self._stream.frames)
        self._stream.frames.clear()
        return heard

    def pause(self) -> None:
        """The line has no pauses."""

    def close(self) -> None:
        """Nothing to release."""

    def _frame_in(self, line: bytes) -> SlcanFrame | None:
        """By the grammar in Lawicel's manuals; case matters in the first letter alone."""
        found = self._GRAMMAR.fullmatch(line)
        if found is None:
            return None
        letter, identifier = line[:1], found["i"] or found["j"]
        extended, remote = letter.isupper(), letter in b"rR"
        length = int(found["n"])
        size = 0 if remote else 2 * length
        if len(found["rest"]) not in (size, size + 4):
            return None
        return SlcanFrame(int(identifier, 16), bytes.fromhex(found["rest"][:size].decode()), length, extended, remote)


def slcan_lines() -> StreamCodec:
    return StreamCodec("slcan lines", "form: letter, digits, length", SlcanLine)
