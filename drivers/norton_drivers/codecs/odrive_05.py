"""ODrive CANSimple, firmware 0.5: messages that differ from :mod:`norton_drivers.codecs.odrive`, firmware 0.6.

Commands 03 to 05, 15, 1C and 1D mean something else, there is no version to ask for and no parameter that could be
reached, and a heartbeat says which part of the axis has failed (since 0.5.6; before, those bytes are zero). Getters
answer remote frames. Sources: ODrive's ``Firmware/communication/can/can_simple.cpp`` and CHANGELOG.md of firmware
0.5.6, and the DBC file 0.5.6 generated from it.
"""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import ClassVar, Self

from norton_drivers.codecs.errors import CodecError

_HEARTBEAT = Struct("<IBBBB")
_U64 = Struct("<Q")
_TWO_I32 = Struct("<ii")
_FLAG, _TRAJECTORY_DONE = 0x01, 0x80


class Command05(IntEnum):
    """The low five bits of an identifier, where they are not as in firmware 0.6 or unknown there."""

    MOTOR_ERROR = 0x03
    ENCODER_ERROR = 0x04
    SENSORLESS_ERROR = 0x05
    ENCODER_COUNT = 0x0A
    CLEAR_ERRORS = 0x18
    CONTROLLER_ERROR = 0x1D


ERROR_INVALID_STATE = 1 << 0
ERROR_MOTOR_FAILED = 1 << 6
ERROR_WATCHDOG = 1 << 11
ERROR_ESTOP = 1 << 14


@dataclass(frozen=True, slots=True)
class Heartbeat05:
    """Sent by itself, every 100 ms by default (command 01)."""

    COMMAND: ClassVar[int] = 0x01
    error_bits: int
    axis_state: int
    motor_failed: bool = False
    encoder_failed: bool = False
    controller_failed: bool = False
    trajectory_done: bool = False

    def encode(self) -> bytes:
        controller = self.controller_failed * _FLAG | self.trajectory_done * _TRAJECTORY_DONE
        return _HEARTBEAT.pack(self.error_bits, self.axis_state, self.motor_failed, self.encoder_failed, controller)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        _check_length(data, 8, "heartbeat")
        error_bits, axis_state, motor, encoder, controller = _HEARTBEAT.unpack_from(data)
        return cls(
            error_bits,
            axis_state,
            bool(motor & _FLAG),
            bool(encoder & _FLAG),
            bool(controller & _FLAG),
            bool(controller & _TRAJECTORY_DONE),
        )


def errors_value(bits: int) -> bytes:
    """The payload of the error messages (commands 03, 04, 05, 1D), of which the motor's alone is wider than 32 bits."""
    return _U64.pack(bits)


def errors_of(data: bytes | bytearray) -> int:
    """Error bits in such a payload."""
    _check_length(data, 4, "error")
    return int(_U64.unpack(bytes(data[:8]).ljust(8, b"\0"))[0])


@dataclass(frozen=True, slots=True)
class EncoderCount:
    """The encoder's count, which goes on over the turns, and its place within the turn (command 0A)."""

    COMMAND: ClassVar[int] = Command05.ENCODER_COUNT
    shadow_count: int  # wraps at 2^31
    count_in_turn: int

    def encode(self) -> bytes:
        return _TWO_I32.pack(self.shadow_count, self.count_in_turn)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        _check_length(data, 8, "encoder count")
        return cls(*_TWO_I32.unpack_from(data))


@dataclass(frozen=True, slots=True)
class ClearErrors05:
    """Forget past errors, of both axes of the board (command 18); it carries nothing."""

    COMMAND: ClassVar[int] = Command05.CLEAR_ERRORS

    def encode(self) -> bytes:
        return b""


def _check_length(data: bytes | bytearray, length: int, message: str) -> None:
    # Not `!=`: some adapters pad to 8 bytes.
    if len(data) < length:
        raise CodecError(f"{message}: {len(data)} bytes where {length} are needed")
