"""ODrive CANSimple, firmware 0.5: messages that differ from :mod:`norton_drivers.codecs.odrive`, firmware 0.6.

Commands 03 to 05, 15, 1C and 1D mean something else, there is no version to ask for and no parameter that could be
reached, and a heartbeat says which part of the axis has failed (since 0.5.6; before, those bytes are zero). Getters
answer remote frames. Sources: ODrive's ``Firmware/communication/can/can_simple.cpp`` and CHANGELOG.md of firmware
0.5.6, and the DBC file 0.5.6 generated from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import ClassVar, Final, Self

from norton_drivers.codecs.odrive import check_length

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
        check_length(data, 8, "heartbeat")
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
    check_length(data, 4, "error")
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
        check_length(data, 8, "encoder count")
        return cls(*_TWO_I32.unpack_from(data))


@dataclass(frozen=True, slots=True)
class ClearErrors05:
    """Forget past errors, of both axes of the board (command 18); it carries nothing."""

    COMMAND: ClassVar[int] = Command05.CLEAR_ERRORS

    def encode(self) -> bytes:
        return b""


AXIS_WORDS: Final = {
    0: "the state asked for is not possible: is the axis calibrated?",
    6: "the motor failed",
    7: "the sensorless estimator failed",
    8: "the encoder failed",
    9: "the controller failed",
    11: "watchdog expired: no command arrived in time",
    12: "the lower end stop is pressed",
    13: "the upper end stop is pressed",
    14: "emergency stop requested",
    17: "homing without an end stop",
    18: "a temperature is too high",
    19: "position unknown",
}
MOTOR_WORDS: Final = {
    0: "phase resistance out of range",
    1: "phase inductance out of range",
    3: "gate driver fault",
    4: "control deadline missed",
    7: "modulation magnitude: is the bus voltage too low for this current?",
    10: "current sense saturated",
    12: "motor current limit violated",
    16: "modulation is not a number",
    17: "motor too hot",
    18: "inverter too hot",
    19: "timer update missed",
    20: "current measurement unavailable",
    21: "the controller failed",
    22: "bus current out of range",
    23: "brake resistor disarmed",
    24: "system-level fault: bus voltage or brake resistor",
    25: "timing error: the drive's processor is overloaded",
    26: "phase estimate unknown: check the encoder",
    27: "phase velocity unknown: check the encoder",
    28: "torque unknown",
    29: "current command unknown",
    30: "current measurement unknown",
    31: "bus voltage unknown",
    32: "voltage command unknown",
    33: "gains unknown",
    34: "controller initialising",
    35: "phases unbalanced",
}
ENCODER_WORDS: Final = {
    0: "encoder gain unstable",
    1: "pole pairs and encoder counts disagree",
    2: "no response from the encoder",
    3: "encoder mode not supported",
    4: "illegal Hall state",
    5: "encoder index not found yet",
    6: "absolute encoder: timeout",
    7: "absolute encoder: communication failed",
    8: "absolute encoder: not ready",
    9: "Hall sensors not calibrated yet",
}
CONTROLLER_WORDS: Final = {
    0: "the drive's velocity limit was violated",
    1: "input mode invalid",
    2: "controller gain unstable",
    3: "mirrored axis invalid",
    4: "load encoder invalid",
    5: "no valid position or velocity estimate: check the encoder",
    6: "circular range invalid",
    7: "spin-out: electrical and mechanical power disagree",
}
SENSORLESS_WORDS: Final = {
    0: "sensorless estimator: gain unstable",
    1: "sensorless estimator: current measurement unknown",
}


def describe_errors_05(bits: int, words: Mapping[int, str], part: str) -> tuple[str, ...]:
    """Error bits of ``part`` in words, lowest bit first; empty where there are none."""
    known = tuple(text for bit, text in words.items() if bits >> bit & 1)
    unknown = bits & ~sum(1 << bit for bit in words)
    return (*known, f"unknown {part} error bits 0x{unknown:X}") if unknown else known
