"""SimpleFOC's Commander on a serial line: what is said to a motor and what it answers, for either end of the line.

A line begins with the motor's letter. ``M0.5`` newline sets the target, and is answered with it; ``MMG7`` asks for
target; voltage q; d; current q; d; velocity; angle; ``ME`` asks whether the motor is enabled, ``ME1`` enables it;
``MT2`` chooses the torque's controller, ``MC0`` torque as what is controlled, ``MLC9`` and ``MLU12`` limit current and
voltage. ``?`` lists the letters, ``#5`` sets the decimals, ``@1`` prints bare values. Nothing has a checksum.
Source: simplefoc/Arduino-FOC 2.3.4, src/communication/Commander.cpp (``run``, ``motor``, ``motion``, ``target``),
Commander.h (lines of up to 20 characters; ``VerboseMode``), commands.h.
"""

import re
from math import isfinite
from typing import Final, NamedTuple

from norton_drivers.codecs.common import CodecError

COMMAND_MAX: Final = 20
SCAN: Final = b"?\n"
BARE_VALUES: Final = b"@1\n"
BARE_VALUES_SET: Final = "on!"
TORQUE_SET: Final = "torque"
CONTROLLERS: Final = {"voltage": (0, "volt"), "dc": (1, "dc curr"), "foc": (2, "foc curr")}
NUMBERS: Final = 7

_NUMBER: Final = re.compile(r"-?\d+\.\d+")
_LETTER: Final = re.compile(r"\??([A-Za-z]):.*")


class MotorState(NamedTuple):
    """The answer to ``MG7``; target and q voltage and current [A, V], velocity [rad/s], angle [rad]."""

    target: float
    voltage_q: float
    voltage_d: float
    current_q: float
    current_d: float
    velocity: float
    angle: float


def said(letter: str, what: str) -> bytes:
    """A line to the motor. Raises CodecError for one that is too long."""
    data = f"{letter}{what}\n".encode()
    if len(data) > COMMAND_MAX:
        raise CodecError(f"SimpleFOC: {data!r} is longer than the {COMMAND_MAX} characters that the library takes")
    return data


def target_text(value: float, decimals: int) -> str:
    """Raises CodecError for what is no number."""
    if not (isfinite(value) and abs(value) < 1e5):
        raise CodecError(f"SimpleFOC: a target of {value:g} cannot be said")
    return f"{value:.{decimals}f}"


def state_text(state: MotorState, decimals: int) -> str:
    """As it is answered."""
    return ";".join(f"{value:.{decimals}f}" for value in state)


def state_in(text: str) -> MotorState | None:
    """None for another line."""
    parts = text.split(";")
    if len(parts) != NUMBERS or not all(map(_NUMBER.fullmatch, parts)):
        return None
    return MotorState(*map(float, parts))


def flag_in(text: str) -> bool | None:
    """Whether the motor is enabled; None for another line, such as a target, which has a point."""
    return text == "1" if text in ("0", "1") else None


def letter_in(text: str) -> str | None:
    """The letter of one command in the answer to ``?``; None for another line."""
    match = _LETTER.fullmatch(text)
    return None if match is None else match[1]


def longest_state(decimals: int) -> int:
    """Bytes of the answer with up to four characters before each point."""
    return NUMBERS * (4 + decimals + 1) + NUMBERS - 1 + 2
