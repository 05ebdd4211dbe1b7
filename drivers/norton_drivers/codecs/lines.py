"""Lines of ASCII text with one number in each: bytes to lines, lines to numbers, and back.

There is no checksum: a changed digit gives another number. What can be told is told by form. A whole line between two
line ends must be one number of the expected shape, and, where the sensor's lines are all of one width, of that width:
then no lost character goes unnoticed either. Noise makes a line that is a number now and then, but hardly two in a row:
so a number is believed only where the line before it was one too.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Final, NamedTuple

from norton_drivers.codecs.common import CodecError

LINE_MAX: Final = 80

_DIGITS: Final = rb"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?"


class Line(NamedTuple):
    """A line without its end, and how many bytes of the same chunk came after that end."""

    text: bytes
    later_bytes: int


class LineStream:
    """Cuts a byte stream at CR, LF or both; what it finds does not depend on how the stream is cut.

    Empty lines are none. ``overlong`` counts stretches without an end that no line can be as long as.
    """

    def __init__(self, *, mid_line: bool, longest: int = LINE_MAX) -> None:
        """``mid_line``: the stream may begin within a line, whose end alone would then look like one. ``longest`` is
        what a line may have."""
        self._longest = longest
        self.overlong = 0
        self._rest = b""
        self._skipping = mid_line

    def feed(self, data: bytes) -> list[Line]:
        """The lines completed by ``data``, oldest first. Never raises."""
        lines: list[Line] = []
        later = len(data)
        for piece in data.replace(b"\r", b"\n").split(b"\n")[:-1]:
            later -= len(piece) + 1
            text, self._rest = self._rest + piece, b""
            if text and not self._skips(text):
                lines.append(Line(text, later))
            self._skipping = False
        self._keep(data[len(data) - later :])
        return lines

    def drop(self) -> None:
        """Forget the line that has begun."""
        self._rest, self._skipping = b"", False

    def _skips(self, text: bytes) -> bool:
        if not self._skipping and len(text) > self._longest:
            self.overlong += 1
            return True
        return self._skipping

    def _keep(self, rest: bytes) -> None:
        self._rest = b"" if self._skipping else self._rest + rest
        if len(self._rest) > self._longest:
            self.overlong += 1
            self._rest, self._skipping = b"", True


@dataclass(frozen=True)
class NumberFormat:
    """What a line must be: ``unit`` is the text behind the number, ``field`` (from 1) which of the fields that
    ``separator`` parts it is, ``width`` the characters of the whole line, 0 where they vary, ``signed`` whether a sign
    must stand before the number."""

    unit: str = ""
    separator: str = ""
    field: int = 1
    width: int = 0
    signed: bool = False

    def number_in(self, text: bytes) -> float | None:
        """The number; None where the line is not of this form."""
        if self.width and len(text) != self.width:
            return None
        fields = text.split(self.separator.encode()) if self.separator else [text]
        if len(fields) < self.field:
            return None
        match = self._pattern.fullmatch(fields[self.field - 1])
        number = float(match[1].replace(b" ", b"")) if match else None
        return number if number is not None and isfinite(number) else None

    @cached_property
    def _pattern(self) -> re.Pattern[bytes]:
        sign = rb"[+-]" if self.signed else rb"[+-]?"
        return re.compile(rb" *(" + sign + rb" *" + _DIGITS + rb") *" + re.escape(self.unit.encode()) + rb" *")


class Numbers:
    """The numbers in lines. ``garbled`` counts lines that are none; ``believed``: two lines in a row were numbers."""

    def __init__(self, form: NumberFormat) -> None:
        self.garbled = 0
        self.believed = False
        self._form = form
        self._in_a_row = False

    def take(self, text: bytes) -> float | None:
        """The number in the next line; None where there is none."""
        number = self._form.number_in(text)
        self.believed = self._in_a_row and number is not None
        self._in_a_row = number is not None
        self.garbled += number is None
        return number


def signed_text(number: float, before: int, after: int) -> bytes:
    """A number as such sensors print it: a sign, ``before`` digits with leading zeros, a point, ``after`` digits.

    Raises CodecError for what so many digits cannot say.
    """
    text = f"{number:+0{before + after + 2}.{after}f}"
    if not isfinite(number) or len(text) != before + after + 2:
        raise CodecError(f"a number with {before} digits before and {after} after the point cannot say {number}")
    return text.encode()
