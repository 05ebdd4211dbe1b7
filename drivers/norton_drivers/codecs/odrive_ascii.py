"""ODrive's ASCII protocol on UART and USB, firmware 0.5 and 0.6: lines of text both ways, for either end of the line.

``c 0 0.125*123`` newline commands a torque [N m] to motor 0; ``f 0*118`` asks for feedback, ``1.250000 -0.500000*14``
CR newline are position [turns] and velocity [turns/s]; ``r`` reads a property, ``w`` writes one, ``u`` feeds a motor's
watchdog (as ``c`` does, but not ``f``, ``r`` and ``w``), ``sc`` clears errors. The checksum, the exclusive or of all
that stands before the asterisk, may be left out; who sends it gets it back, and a line whose checksum is wrong is
passed over without a word. Commands are not answered; a question for a property that is not there is ("invalid
property"). Sources: ODrive's ``Firmware/communication/ascii_protocol.cpp`` of firmware 0.5.6 (``process_line``,
``respond``: 64 characters; ``cmd_read_property``: nine); ODrive manual, "ASCII Protocol" (0.5.5 and 0.6: the vector
``r vbus_voltage *93``; a response is dropped where the one before it is still being sent).
"""

import re
from collections.abc import Iterator
from functools import reduce
from math import isfinite
from operator import xor
from typing import Final, NamedTuple

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.lines import LineStream

UNKNOWN: Final = "unknown command"
INVALID_PROPERTY: Final = "invalid property"
CLEAR_ERRORS: Final = "sc"
POSITION_STEP_REV: Final = 1e-6  # %f
TORQUE_STEP_NM: Final = 1e-6
LONGEST_TORQUE: Final = len(b"c 0 -0.123456*123\n")
LONGEST_FEEDBACK: Final = len(b"-123.123456 -12.123456*123\r\n")

_SUMMED: Final = re.compile(rb"([\x20-\x7e]*)\*(\d{1,3})")
_NUMBER: Final = r"-?\d+(?:\.\d*)?"
_FEEDBACK: Final = re.compile(rf"({_NUMBER}) ({_NUMBER})")
_VALUE: Final = re.compile(_NUMBER)


def line(text: str, end: bytes = b"\n") -> bytes:
    """A line with its checksum; the drive's own end with CR as well."""
    data = text.encode()
    return b"%s*%d%s" % (data, reduce(xor, data, 0), end)


def text_in(data: bytes) -> str:
    """What a line without its end says. Raises CodecError where its checksum is missing or wrong."""
    match = _SUMMED.fullmatch(data)
    if match is None or reduce(xor, match[1], 0) != int(match[2]):
        raise CodecError(f"ODrive line: {data[:40]!r}")
    return match[1].decode()


class Told(NamedTuple):
    """What one line says, and how many bytes of the same chunk came after it."""

    text: str
    later_bytes: int


class TextStream:
    """Finds lines with a checksum; ``garbled`` counts those whose checksum is missing or wrong."""

    def __init__(self) -> None:
        self.garbled = 0
        self._lines = LineStream(mid_line=False)

    def feed(self, data: bytes) -> Iterator[Told]:
        """Those completed by ``data``, oldest first. Never raises."""
        for each in self._lines.feed(data):
            try:
                yield Told(text_in(each.text), each.later_bytes)
            except CodecError:
                self.garbled += 1


def torque_text(axis: int, torque_nm: float) -> str:
    """The command of a torque, to the nearest micronewton metre. Raises CodecError for what is no number."""
    if not (isfinite(torque_nm) and abs(torque_nm) < 1e6):
        raise CodecError(f"torque: {torque_nm:g} N*m cannot be said")
    return f"c {axis} {torque_nm:.6f}"


def feedback_text(position_rev: float, velocity_rev_s: float) -> str:
    """The answer to ``f``."""
    return f"{position_rev:.6f} {velocity_rev_s:.6f}"


def feedback_in(text: str) -> tuple[float, float] | None:
    """Position [turns] and velocity [turns/s]; None for another answer."""
    match = _FEEDBACK.fullmatch(text)
    return None if match is None else (float(match[1]), float(match[2]))


def number_in(text: str) -> float | None:
    """A property's value; None for another answer."""
    return float(text) if _VALUE.fullmatch(text) else None
