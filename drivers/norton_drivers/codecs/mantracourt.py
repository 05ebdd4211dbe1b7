"""Mantracourt DSC strain gauge converters, ASCII protocol: questions and answers.

``!001:SOUT?`` CR asks station 001 for its selected output; ``+00032.100`` CR is the answer, ``?`` CR that the command
is not understood. Station 000 is all stations at once, and none of them answers. There is no checksum, and an answer
does not say whose it is. Sources: Mantracourt, "DSC User Manual", appendix B "Communication Protocol: ASCII"; the same
maker's list of commands (SOUT selected output, SYS main output, VER, SERL, SERH, DP and DPB digits after and before
the point).
"""

import re
from typing import Final

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.lines import NumberFormat

BAUD: Final = 115_200
BROADCAST: Final = 0
STATION_MAX: Final = 999
NOT_UNDERSTOOD: Final = b"?"
ANSWER: Final = NumberFormat(signed=True)

_QUESTION: Final = re.compile(rb"!(\d{3}):([A-Z0-9]{1,4})\?")


def question(station: int, command: str) -> bytes:
    """What asks ``station`` for a value, with its CR. Raises CodecError for what no question can be."""
    text = f"!{station:03d}:{command}?".encode()
    if not 0 <= station <= STATION_MAX or _QUESTION.fullmatch(text) is None:
        raise CodecError(f"Mantracourt question: station {station}, command {command!r}")
    return text + b"\r"


def question_in(line: bytes) -> tuple[int, str]:
    """Station and command of a question without its CR. Raises CodecError."""
    match = _QUESTION.fullmatch(line.upper())
    if match is None:
        raise CodecError(f"not a Mantracourt question: {line[:40]!r}")
    return int(match[1]), match[2].decode()
