"""Damiao DM motors in their MIT mode: feedback with a status, and registers, for either end of the wire.

Commands are those of MIT mode (:mod:`norton_drivers.codecs.mit`), to the motor's own identifier; one more special
frame clears a fault. What comes back, under the master's identifier, has the motor's identifier in the lower half of
its first byte and the status in the upper one, and ends with two temperatures. Registers are read and written by frames
to 0x7FF, which name the motor in their first two bytes; the answer has the same form, under the master's identifier.
Numbers in registers are little-endian.

Sources: python-damiao-driver 1.0.6, core/motor.py (register table, ``decode_sensor_feedback``,
``_send_register_cmd``); umeow0716/damiao_firmware, recovered from Damiao's DM4310 V5017: app/src/can_protocol.c
(identifiers above 15 run into the status), parameter_protocol.c (ranges of writes), docs/book/08-safety-profiles.md
(codes 2 to 4); edometro/DAMIAO_Control_Arduino, DMMotor.h (codes 5 and 6).
"""

from enum import IntEnum
from math import isfinite
from struct import Struct
from typing import NamedTuple, Self

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.mit import SPECIAL_HEAD
from norton_drivers.codecs.ranges import Ranges

NODE_MAX = 0xF
REGISTERS_ID = 0x7FF
TIMEOUT_TICKS_PER_S = 20_000  # of register TIMEOUT: 50 µs each

DISABLED, ENABLED = 0, 1
OVER_CURRENT, UNDERVOLTAGE, TRANSISTORS_TOO_HOT, COMMUNICATION_LOST = 0xA, 0x9, 0xB, 0xD
_ERRORS = {
    2: "its output encoder is not calibrated",
    3: "the calibration of its output encoder is invalid",
    4: "output encoder fault",
    5: "encoder fault",
    6: "a parameter is wrong",
    8: "supply voltage too high: can the supply take back what is braked?",
    UNDERVOLTAGE: "supply voltage too low: is the supply on?",
    OVER_CURRENT: "too much current",
    TRANSISTORS_TOO_HOT: "transistors too hot",
    0xC: "motor too hot",
    COMMUNICATION_LOST: "communication lost: no frame came for its timeout",
    0xE: "overload",
}


class Special(IntEnum):
    """Frames of seven bytes FF and one of these."""

    CLEAR = 0xFB  # a fault
    ENABLE = 0xFC
    DISABLE = 0xFD
    ZERO = 0xFE  # here is zero, from now on

    def encode(self) -> bytes:
        return SPECIAL_HEAD + bytes((self,))


def special_of(data: bytes | bytearray) -> Special | None:
    """Which special frame this is; None for a command."""
    if len(data) != 8 or data[:7] != SPECIAL_HEAD:
        return None
    return next((special for special in Special if special == data[7]), None)


def describe_status(status: int) -> str:
    """An error in words; "" for none, and unknown numbers are said as such."""
    return "" if status in (DISABLED, ENABLED) else _ERRORS.get(status, f"unknown error {status}")


class Feedback(NamedTuple):
    """What a motor says of itself. ``status`` is DISABLED, ENABLED or an error."""

    node: int
    status: int
    position_code: int
    velocity_code: int
    torque_code: int
    transistor_c: int
    rotor_c: int

    @property
    def codes(self) -> tuple[int, int, int]:
        return self.position_code, self.velocity_code, self.torque_code

    def encode(self) -> bytes:
        """Codes beyond their bits wrap, and run into their neighbours, as in the firmware, which does not clamp."""
        _, _, position, velocity, torque, transistor, rotor = self
        return bytes(
            byte & 0xFF
            for byte in (
                self.node | self.status << 4,
                position >> 8,
                position,
                velocity >> 4,
                velocity << 4 | torque >> 8,
                torque,
                transistor,
                rotor,
            )
        )

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        """Raises CodecError for another length than 8."""
        if len(data) != 8:
            raise CodecError(f"feedback: {len(data)} bytes where 8 are sent")
        return cls(
            data[0] & 0xF,
            data[0] >> 4,
            data[1] << 8 | data[2],
            data[3] << 4 | data[4] >> 4,
            (data[4] & 0xF) << 8 | data[5],
            data[6],
            data[7],
        )


class Operation(IntEnum):
    """What is done with a register."""

    READ = 0x33
    WRITE = 0x55
    SAVE = 0xAA  # all of them, into the flash memory
    REFRESH = 0xCC  # no register: the motor sends its feedback


class Register(IntEnum):
    """Some of the motor's registers, by the names in its manual."""

    KT_VALUE = 1
    MST_ID = 7
    ESC_ID = 8
    TIMEOUT = 9
    CTRL_MODE = 10
    SW_VER = 14
    GR = 20
    PMAX = 21
    VMAX = 22
    TMAX = 23
    V_BW = 32
    CAN_BR = 35
    SUB_VER = 36


MIT_MODE = 1  # of CTRL_MODE
MODES = {MIT_MODE: "MIT", 2: "position-velocity", 3: "velocity", 4: "position-force"}
_INTEGERS = frozenset((*range(7, 11), *range(13, 17), 35, 36))
_LAYOUT = Struct("<HBB4s")
_FLOAT, _INTEGER = Struct("<f"), Struct("<I")


class RegisterFrame(NamedTuple):
    """A question to 0x7FF, or the answer to it. ``raw`` is the register's four bytes."""

    node: int
    operation: int
    register: int
    raw: bytes = bytes(4)

    def encode(self) -> bytes:
        return _LAYOUT.pack(*self)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        """Raises CodecError for another length than 8, and for another operation."""
        if len(data) != _LAYOUT.size:
            raise CodecError(f"register: {len(data)} bytes where 8 are sent")
        frame = cls(*_LAYOUT.unpack(data))
        if frame.operation not in tuple(Operation):
            raise CodecError(f"register: unknown operation 0x{frame.operation:X}")
        return frame

    @property
    def value(self) -> float:
        """The number in the register, an integer or a float by its kind."""
        layout = _INTEGER if self.register in _INTEGERS else _FLOAT
        return float(layout.unpack(self.raw)[0])


def raw_of(register: int, value: float) -> bytes:
    """The four bytes that hold ``value``. Raises CodecError for what does not fit."""
    if not isfinite(value) or abs(value) > 3.4e38:
        raise CodecError(f"register {register}: not a number that it can hold")
    if register not in _INTEGERS:
        return _FLOAT.pack(value)
    if not 0 <= round(value) < 1 << 32:
        raise CodecError(f"register {register}: {value:g} does not fit")
    return _INTEGER.pack(round(value))


def version_of(raw: bytes) -> str:
    """The firmware's version: four digits, or a number where it is none such."""
    if all(chr(byte).isdigit() for byte in raw):
        return raw.decode("ascii")
    return str(_INTEGER.unpack(raw)[0])


def feedback_of(
    node: int, status: int, motion: tuple[float, float, float], celsius: tuple[float, float], ranges: Ranges
) -> Feedback:
    """As the drive casts position, velocity and torque, and the temperatures of transistors and rotor."""
    return Feedback(node, status, *ranges.cut(*motion), int(celsius[0]), int(celsius[1]))
