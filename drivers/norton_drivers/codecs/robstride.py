"""RobStride motors and Xiaomi's CyberGear in their own protocol, for either end of the wire.

Extended (29-bit) identifiers: communication type in bits 24 to 28, more data in bits 8 to 23, who is meant in bits 0 to
7. To a motor, bits 8 to 15 are the host's identifier, but in the command of operation mode, which has its torque there;
what a motor sends has its own identifier there, and in its feedback its mode and its faults above. Motion and gains are
16-bit integers, most significant byte first; numbers of parameters are little-endian.

Sources: RobStride's manuals of RS00, RS02, RS04 and RS05, as kim-xps12/robstride-python (ref/spec/spec_rs02_ja.md) and
zhangyan612/armController (leg/canDoc.md) transcribe them, sections on the private protocol and its parameters; the
CyberGear's manual in belovictor/cybergear-docs, sections 3.3.3, 4.1 and 4.2; huggingface/lerobot, pull request 4070
(a parameter that is none is answered with 1 in bits 16 to 23).
"""

from enum import IntEnum
from math import isfinite, pi
from struct import Struct
from typing import NamedTuple, Self

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.ranges import Goal, GoalCodes, Ranges

NODE_MAX = 0x7F
HOST_MAX = 0xFF
TIMEOUT_TICKS_PER_S = 20_000  # of canTimeout
_MIDDLE = 0x7FFF
_FOUR_WORDS = Struct(">HHHH")
_PARAMETER = Struct("<HH4s")
_FLOAT, _INTEGER = Struct("<f"), Struct("<I")
_FAULT_FRAME = Struct("<II")


class Kind(IntEnum):
    """Communication types."""

    GET_ID = 0
    CONTROL = 1
    FEEDBACK = 2
    ENABLE = 3
    STOP = 4
    ZERO = 6  # here is zero, from now on
    READ = 17
    WRITE = 18  # until it is switched off
    FAULTS = 21
    REPORT = 24


def identifier(kind: int, extra: int, target: int) -> int:
    """The 29-bit identifier."""
    return kind << 24 | extra << 8 | target


def split_id(arbitration_id: int) -> tuple[int, int, int]:
    """Communication type, the 16 bits of more data, and who is meant."""
    return arbitration_id >> 24 & 0x1F, arbitration_id >> 8 & 0xFFFF, arbitration_id & 0xFF


# What the integers of each model span: position, velocity, torque, then the greatest kp and kd.
_SMALL, _LARGE = (500.0, 5.0), (5000.0, 100.0)
_TURNS = 4 * pi
MODELS = {
    "cybergear": Ranges(12.5, 30.0, 12.0, 16, *_SMALL),
    "rs00": Ranges(_TURNS, 33.0, 14.0, 16, *_SMALL),
    "rs01": Ranges(_TURNS, 44.0, 17.0, 16, *_SMALL),
    "rs02": Ranges(_TURNS, 44.0, 17.0, 16, *_SMALL),
    "rs03": Ranges(_TURNS, 20.0, 60.0, 16, *_LARGE),
    "rs04": Ranges(_TURNS, 15.0, 120.0, 16, *_LARGE),
    "rs05": Ranges(_TURNS, 50.0, 5.5, 16, *_SMALL),
    "rs06": Ranges(_TURNS, 50.0, 36.0, 16, *_LARGE),
}


def torque_value(node: int, torque_code: int) -> tuple[int, bytes]:
    """A command of torque alone: both gains are zero, so that position and velocity (here near zero) say nothing."""
    return goal_value(node, GoalCodes(_MIDDLE, _MIDDLE, 0, 0, torque_code))


def goal_value(node: int, codes: GoalCodes) -> tuple[int, bytes]:
    """A command of a position and a velocity with their gains, and a torque beside them."""
    return identifier(Kind.CONTROL, codes.torque, node), _FOUR_WORDS.pack(*codes[:4])


def goal_of(extra: int, data: bytes | bytearray, ranges: Ranges) -> Goal:
    """A command as the motor reads it. Raises CodecError for one cut short."""
    position, velocity, stiffness, damping = _unpacked(_FOUR_WORDS, data, "command")
    return ranges.goal_of(GoalCodes(position, velocity, stiffness, damping, extra))


class Mode(IntEnum):
    """What a motor says that it does."""

    RESET = 0  # it is let go of
    CALIBRATION = 1
    RUN = 2


class Feedback(NamedTuple):
    """What a motor says upon nearly every frame to it. ``faults`` are six bits."""

    node: int
    mode: int
    faults: int
    position_code: int
    velocity_code: int
    torque_code: int
    tenths_c: int

    @property
    def codes(self) -> tuple[int, int, int]:
        return self.position_code, self.velocity_code, self.torque_code

    def encode(self, host: int) -> tuple[int, bytes]:
        extra = (self.mode & 3) << 14 | (self.faults & 0x3F) << 8 | self.node
        words = (code & 0xFFFF for code in self[3:])
        return identifier(Kind.FEEDBACK, extra, host), _FOUR_WORDS.pack(*words)

    @classmethod
    def decode(cls, extra: int, data: bytes | bytearray) -> Self:
        """Of the 16 bits in the identifier, and the payload. Raises CodecError for another length than 8."""
        if len(data) != _FOUR_WORDS.size:
            raise CodecError(f"feedback: {len(data)} bytes where 8 are sent")
        return cls(extra & 0xFF, extra >> 14, extra >> 8 & 0x3F, *_FOUR_WORDS.unpack(data))


UNDERVOLTAGE, DRIVER_FAULT, TOO_HOT = 1 << 0, 1 << 1, 1 << 2
_FEEDBACK_FAULTS = (
    "supply voltage too low: is the supply on?",
    "too much current, or a fault of its driver",
    "too hot",
    "encoder fault",
    "overload (in a CyberGear: Hall encoder fault)",
    "its encoder is not calibrated",
)
DETAIL_TOO_HOT, DETAIL_DRIVER, DETAIL_UNDERVOLTAGE = 1 << 0, 1 << 1, 1 << 2
_FAULTS = {
    0: "motor too hot",
    1: "driver chip fault",
    2: "supply voltage too low: is the supply on?",
    3: "supply voltage too high: can the supply take back what is braked?",
    4: "too much current in phase B",
    5: "too much current in phase C",
    7: "its encoder is not calibrated",
    8: "hardware identification fault",
    9: "position initialisation fault",
    14: "stalled for too long",
    16: "too much current in phase A",
}


def describe_feedback(faults: int) -> str:
    """The faults in feedback, in words; "" for none."""
    return "; ".join(words for bit, words in enumerate(_FEEDBACK_FAULTS) if faults >> bit & 1)


def faults_value(node: int, host: int, faults: int, warnings: int = 0) -> tuple[int, bytes]:
    """The frame that a motor sends when something is wrong."""
    return identifier(Kind.FAULTS, node, host), _FAULT_FRAME.pack(faults, warnings)


def describe_faults(data: bytes | bytearray) -> tuple[str, ...]:
    """The faults in such a frame, in words; unknown bits are said as such. Raises CodecError for one cut short."""
    faults, _ = _unpacked(_FAULT_FRAME, data, "faults")
    return tuple(_FAULTS.get(bit, f"unknown fault (bit {bit})") for bit in range(32) if faults >> bit & 1)


class Parameter(IntEnum):
    """Some of the parameters that can be read and written."""

    RUN_MODE = 0x7005
    IQ_REF = 0x7006
    LIMIT_TORQUE = 0x700B
    MECH_POS = 0x7019
    VBUS = 0x701C
    CAN_TIMEOUT = 0x7028


OPERATION_MODE, CURRENT_MODE = 0, 3  # of RUN_MODE
_INTEGERS = (Parameter.RUN_MODE, Parameter.CAN_TIMEOUT)


def read_value(node: int, host: int, parameter: int) -> tuple[int, bytes]:
    """The question for a parameter."""
    return identifier(Kind.READ, host, node), _PARAMETER.pack(parameter, 0, bytes(4))


def write_value(node: int, host: int, parameter: int, value: float) -> tuple[int, bytes]:
    """A parameter's new value; it is answered with feedback. Raises CodecError for what does not fit."""
    return identifier(Kind.WRITE, host, node), _PARAMETER.pack(parameter, 0, raw_of(parameter, value))


def answer_value(node: int, host: int, parameter: int, raw: bytes | None) -> tuple[int, bytes]:
    """The answer to a question; None where there is no such parameter."""
    extra = node if raw is not None else 1 << 8 | node
    return identifier(Kind.READ, extra, host), _PARAMETER.pack(parameter, 0, raw or bytes(4))


def parameter_of(data: bytes | bytearray) -> tuple[int, bytes]:
    """Which parameter a question, an answer or a new value is of, and its four bytes. Raises CodecError."""
    if len(data) < _PARAMETER.size:
        raise CodecError(f"parameter: {len(data)} bytes where {_PARAMETER.size} are needed")
    index, _, raw = _PARAMETER.unpack_from(data)
    return index, raw


def raw_of(parameter: int, value: float) -> bytes:
    """The four bytes that hold ``value``. Raises CodecError for what does not fit."""
    if not isfinite(value) or abs(value) > 3.4e38:
        raise CodecError(f"parameter 0x{parameter:X}: not a number that it can hold")
    if parameter not in _INTEGERS:
        return _FLOAT.pack(value)
    if not 0 <= round(value) < 1 << 32:
        raise CodecError(f"parameter 0x{parameter:X}: {value:g} does not fit")
    return _INTEGER.pack(round(value))


def value_of(parameter: int, raw: bytes) -> float:
    """The number in a parameter's four bytes."""
    return float((_INTEGER if parameter in _INTEGERS else _FLOAT).unpack(raw)[0])


# A frame that stops the motor with these two bytes is answered with the firmware's version, by newer firmware.
VERSION_QUESTION = bytes((0x00, 0xC4)) + bytes(6)
_VERSION_HEAD = bytes((0x00, 0xC4, 0x56))


def version_value(version: bytes) -> bytes:
    """The payload that tells it, of four bytes."""
    return _VERSION_HEAD + version + bytes(1)


def version_of(data: bytes | bytearray) -> str | None:
    """The firmware's version in what came; None for ordinary feedback."""
    if len(data) != 8 or data[:3] != _VERSION_HEAD:
        return None
    return ".".join(str(byte) for byte in data[3:7])


def models_limited_to(torque_nm: float) -> tuple[str, ...]:
    """The models whose limit_torque is this, as they are delivered."""
    return tuple(name for name, ranges in MODELS.items() if abs(ranges.torque_nm - torque_nm) < 1e-3)


def _unpacked(layout: Struct, data: bytes | bytearray, message: str) -> tuple[int, ...]:
    if len(data) < layout.size:
        raise CodecError(f"{message}: {len(data)} bytes where {layout.size} are needed")
    return layout.unpack_from(data)
