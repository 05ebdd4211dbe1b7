"""MIT mode (mini-cheetah): one command frame and one reply frame of scaled integers, for either end of the wire.

Standard identifiers: a command goes to the motor's own, a reply to the master's. Most significant bit first, a command
is position 16, velocity 12, kp 12, kd 12, torque 12 bits; a reply is the motor's identifier, position 16, velocity 12
and torque 12 bits, and on CubeMars' drives a temperature and an error. What the integers span differs between motors
(:class:`norton_drivers.codecs.ranges.Ranges`), and nothing in a frame tells. Sources: bgkatz/motorcontrol,
Core/Src/can.c (``pack_reply``, ``unpack_cmd``), math_ops.c, stm32f4xx_it.c; CubeMars, AK Series Actuator Driver Manual
V1.0.8, section 5.3.
"""

from enum import IntEnum
from typing import NamedTuple, Self

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.ranges import Goal, GoalCodes, Ranges

IDENTIFIER_MAX = 0x7FF
NODE_MAX = 0xFF  # a reply's first byte must hold it

_LAST_POSITION = (1 << 16) - 1
CODES = 1 << 12  # of velocity, torque, and either gain
_LAST_SHORT = CODES - 1
_COMMAND_LENGTH = 8
_REPLY_LENGTHS = (6, 7, 8)
SPECIAL_HEAD = b"\xff" * 7

NO_ERROR = 0
_ERRORS = (
    "no error",
    "too hot",
    "too much current",
    "supply voltage too high",
    "supply voltage too low: is the supply on?",
    "encoder fault",
    "phase currents unbalanced: the hardware may be damaged",
)
ERRORS_MAX = len(_ERRORS) - 1


class Special(IntEnum):
    """Frames of seven bytes FF and one of these; none of them counts as a command for the drive's timeout."""

    ENABLE = 0xFC
    DISABLE = 0xFD
    ZERO = 0xFE  # here is zero, from now on

    def encode(self) -> bytes:
        return SPECIAL_HEAD + bytes((self,))


def special_of(data: bytes | bytearray) -> Special | None:
    """Which special frame this is; None for a command."""
    if len(data) != _COMMAND_LENGTH or data[:7] != SPECIAL_HEAD:
        return None
    return next((special for special in Special if special == data[7]), None)


def command_value(torque_code: int) -> bytes:
    """A command of torque alone: both gains are zero, so that position and velocity (here near zero) say nothing."""
    position, velocity = _LAST_POSITION // 2, _LAST_SHORT // 2
    packed = position << 48 | velocity << 36 | torque_code
    return packed.to_bytes(_COMMAND_LENGTH, "big")


def goal_value(codes: GoalCodes) -> bytes:
    """A command of a position and a velocity with their gains, and a torque beside them."""
    position, velocity, stiffness, damping, torque = codes
    packed = position << 48 | velocity << 36 | stiffness << 24 | damping << 12 | torque
    return packed.to_bytes(_COMMAND_LENGTH, "big")


def torque_code_of(data: bytes | bytearray) -> int:
    """The torque in a command. Raises CodecError for one cut short."""
    if len(data) < _COMMAND_LENGTH:
        raise CodecError(f"command: {len(data)} bytes where {_COMMAND_LENGTH} are needed")
    return (data[6] & 0xF) << 8 | data[7]


def goal_of(data: bytes | bytearray, ranges: Ranges) -> Goal:
    """A command as the drive reads it. Raises CodecError for one cut short."""
    torque = torque_code_of(data)
    packed = int.from_bytes(data[:_COMMAND_LENGTH], "big")
    velocity, stiffness, damping = (packed >> shift & _LAST_SHORT for shift in (36, 24, 12))
    return ranges.goal_of(GoalCodes(packed >> 48, velocity, stiffness, damping, torque))


class Reply(NamedTuple):
    """What a motor says upon every frame to it. ``temperature`` and ``error`` are bytes as sent, None where absent."""

    node: int
    position_code: int
    velocity_code: int
    torque_code: int
    temperature: int | None = None
    error: int | None = None

    @classmethod
    def of(cls, node: int, position_rad: float, velocity_rad_s: float, torque_nm: float, ranges: Ranges) -> Self:
        """As the drive casts its measurements: what is beyond its range makes a code beyond its bits."""
        return cls(node, *ranges.cut(position_rad, velocity_rad_s, torque_nm))

    def encode(self) -> bytes:
        """Codes beyond their bits wrap, and run into their neighbours, as in the firmware, which does not clamp."""
        position, velocity, torque = self.position_code, self.velocity_code, self.torque_code
        data = bytes(
            (
                self.node,
                position >> 8 & 0xFF,
                position & 0xFF,
                velocity >> 4 & 0xFF,
                ((velocity & 0xF) << 4) + (torque >> 8) & 0xFF,
                torque & 0xFF,
            )
        )
        tail = (byte for byte in (self.temperature, self.error) if byte is not None)
        return data + bytes(tail)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        """Raises CodecError for another length than 6, 7 or 8."""
        if len(data) not in _REPLY_LENGTHS:
            raise CodecError(f"reply: {len(data)} bytes where 6, 7 or 8 are sent")
        return cls(
            data[0],
            data[1] << 8 | data[2],
            data[3] << 4 | data[4] >> 4,
            (data[4] & 0xF) << 8 | data[5],
            data[6] if len(data) > 6 else None,
            data[7] if len(data) > 7 else None,
        )


def describe_error(error: int) -> str:
    """CubeMars' error byte in words; unknown numbers are said as such."""
    return _ERRORS[error] if error <= ERRORS_MAX else f"unknown error {error}"
