"""ODrive CANSimple, firmware 0.6, and what 0.5 has in common with it: messages to bytes and back, for either end.

Standard identifiers are ``node << 5 | command``; payloads are little-endian. Sources: ODrive manual, "CAN Protocol"
and "ODrive.Error", "ODrive.Axis.AxisState", "ODrive.ProcedureResult" of the API reference (firmware 0.6), and the
DBC file 0.6.10 that ODrive publishes.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from math import isfinite
from struct import Struct
from typing import ClassVar, Self

from norton_drivers.codecs.common import CodecError

NODE_MAX = 0x3F
_COMMAND_MASK = 0x1F

_TWO_U32 = Struct("<II")
_TWO_F32 = Struct("<ff")
_ONE_U32 = Struct("<I")
_ONE_F32 = Struct("<f")
# The published DBC file gives these eight bytes; the drive itself looks at four.
_PADDED_U32 = Struct("<I4x")
_PADDED_F32 = Struct("<f4x")
TORQUE = _PADDED_F32  # the layout of SetInputTorque
_HEARTBEAT = Struct("<IBBBx")
_VERSION = Struct("<8B")


class MessageId(IntEnum):
    """The low five bits of an identifier."""

    VERSION = 0x00
    HEARTBEAT = 0x01
    ESTOP = 0x02
    ERROR = 0x03
    RX_SDO = 0x04
    TX_SDO = 0x05
    SET_AXIS_STATE = 0x07
    ENCODER_ESTIMATES = 0x09
    SET_CONTROLLER_MODE = 0x0B
    SET_INPUT_TORQUE = 0x0E
    SET_LIMITS = 0x0F
    IQ = 0x14
    TEMPERATURE = 0x15
    BUS_VOLTAGE_CURRENT = 0x17
    CLEAR_ERRORS = 0x18
    TORQUES = 0x1C


class AxisState(IntEnum):
    """The states that a heartbeat reports."""

    UNDEFINED = 0
    IDLE = 1
    STARTUP_SEQUENCE = 2
    FULL_CALIBRATION_SEQUENCE = 3
    MOTOR_CALIBRATION = 4
    ENCODER_INDEX_SEARCH = 6
    ENCODER_OFFSET_CALIBRATION = 7
    CLOSED_LOOP_CONTROL = 8
    LOCKIN_SPIN = 9
    ENCODER_DIR_FIND = 10
    HOMING = 11
    ENCODER_HALL_POLARITY_CALIBRATION = 12
    ENCODER_HALL_PHASE_CALIBRATION = 13
    ANTICOGGING_CALIBRATION = 14


class ControlMode(IntEnum):
    VOLTAGE = 0
    TORQUE = 1
    VELOCITY = 2
    POSITION = 3


class InputMode(IntEnum):
    INACTIVE = 0
    PASSTHROUGH = 1
    VELOCITY_RAMP = 2
    POSITION_FILTER = 3
    TRAPEZOIDAL_TRAJECTORY = 5
    TORQUE_RAMP = 6


ERROR_WATCHDOG = 1 << 24
ERROR_ESTOP = 1 << 25

RESULT_SUCCESS = 0
RESULT_BUSY = 1


def arbitration_id(node: int, command: int) -> int:
    """The 11-bit identifier. Raises CodecError for a node outside 0..63."""
    if not 0 <= node <= NODE_MAX:
        raise CodecError(f"ODrive node ids go from 0 to {NODE_MAX}, not {node}")
    return node << 5 | command & _COMMAND_MASK


def split_id(identifier: int) -> tuple[int, int]:
    """``(node, command)`` of an 11-bit identifier; the command need not be one that is known here."""
    return identifier >> 5, identifier & _COMMAND_MASK


def check_length(data: bytes | bytearray, length: int, message: str) -> None:
    """Raises CodecError for too few bytes."""
    # Not `!=`: CAN FD and some adapters pad to 8 bytes, and later firmware may append fields.
    if len(data) < length:
        raise CodecError(f"{message}: {len(data)} bytes where {length} are needed")


def _two_finite(data: bytes | bytearray, message: str) -> tuple[float, float]:
    if len(data) < 8:
        check_length(data, 8, message)  # which says so
    first, second = _TWO_F32.unpack_from(data)
    if not (isfinite(first) and isfinite(second)):
        raise CodecError(f"{message}: not a finite number")
    return first, second


def pack_float(layout: Struct, message: str, value: float) -> bytes:
    """Raises CodecError for a value that no 32-bit float holds."""
    if not isfinite(value):
        raise CodecError(f"{message}: not a finite number")
    try:
        return layout.pack(value)
    except OverflowError as error:
        raise CodecError(f"{message}: beyond the range of a 32-bit float") from error


def _pack_two(message: str, first: float, second: float) -> bytes:
    if not (isfinite(first) and isfinite(second)):
        raise CodecError(f"{message}: not a finite number")
    try:
        return _TWO_F32.pack(first, second)
    except OverflowError as error:
        raise CodecError(f"{message}: beyond the range of a 32-bit float") from error


# What crosses the wire every millisecond can be had without an object made of it: two numbers, or one.
# The payload of EncoderEstimates, from position [turns] and velocity [turns/s], and these in a payload.
estimates_value = partial(_pack_two, "encoder estimates")
estimates_of = partial(_two_finite, message="encoder estimates")
# The payload of SetInputTorque, from a torque [N m].
torque_value = partial(pack_float, _PADDED_F32, "torque")


def torque_of(data: bytes | bytearray) -> float:
    """The torque [N m] in the payload of :class:`SetInputTorque`."""
    check_length(data, 4, "torque")
    torque_nm: float = _ONE_F32.unpack_from(data)[0]
    if not isfinite(torque_nm):
        raise CodecError("torque: not a finite number")
    return torque_nm


@dataclass(frozen=True, slots=True)
class Version:
    """Answer to a remote frame: who the drive is (command 00)."""

    COMMAND: ClassVar[MessageId] = MessageId.VERSION
    protocol: int
    hardware: tuple[int, int, int]  # major, minor, variant
    firmware: tuple[int, int, int]  # major, minor, revision
    unreleased: int = 0

    def encode(self) -> bytes:
        return _VERSION.pack(self.protocol, *self.hardware, *self.firmware, self.unreleased)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        check_length(data, 8, "version")
        protocol, hw0, hw1, hw2, fw0, fw1, fw2, unreleased = _VERSION.unpack_from(data)
        return cls(protocol, (hw0, hw1, hw2), (fw0, fw1, fw2), unreleased)


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Sent by itself, every 100 ms by default (command 01)."""

    COMMAND: ClassVar[MessageId] = MessageId.HEARTBEAT
    error_bits: int
    axis_state: int
    procedure_result: int = 0
    trajectory_done: bool = False

    def encode(self) -> bytes:
        return _HEARTBEAT.pack(self.error_bits, self.axis_state, self.procedure_result, self.trajectory_done)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        check_length(data, 8, "heartbeat")
        error_bits, axis_state, procedure_result, flags = _HEARTBEAT.unpack_from(data)
        return cls(error_bits, axis_state, procedure_result, bool(flags & 1))


@dataclass(frozen=True, slots=True)
class GetError:
    """Active errors, and why the drive was disarmed last (command 03)."""

    COMMAND: ClassVar[MessageId] = MessageId.ERROR
    active_bits: int
    disarm_bits: int

    def encode(self) -> bytes:
        return _TWO_U32.pack(self.active_bits, self.disarm_bits)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        check_length(data, 8, "error")
        return cls(*_TWO_U32.unpack_from(data))


@dataclass(frozen=True, slots=True)
class SetAxisState:
    """Ask for a state (command 07)."""

    COMMAND: ClassVar[MessageId] = MessageId.SET_AXIS_STATE
    axis_state: int

    def encode(self) -> bytes:
        return _PADDED_U32.pack(self.axis_state)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        check_length(data, 4, "axis state")
        return cls(*_ONE_U32.unpack_from(data))


@dataclass(frozen=True, slots=True)
class EncoderEstimates:
    """Shaft position and velocity (command 09)."""

    COMMAND: ClassVar[MessageId] = MessageId.ENCODER_ESTIMATES
    position_rev: float
    velocity_rev_s: float

    def encode(self) -> bytes:
        return estimates_value(self.position_rev, self.velocity_rev_s)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        return cls(*estimates_of(data))


@dataclass(frozen=True, slots=True)
class SetControllerMode:
    """What the drive controls, and how its input is shaped (command 0B)."""

    COMMAND: ClassVar[MessageId] = MessageId.SET_CONTROLLER_MODE
    control_mode: int
    input_mode: int

    def encode(self) -> bytes:
        return _TWO_U32.pack(self.control_mode, self.input_mode)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        check_length(data, 8, "controller mode")
        return cls(*_TWO_U32.unpack_from(data))


@dataclass(frozen=True, slots=True)
class SetInputTorque:
    """The torque wanted (command 0E)."""

    COMMAND: ClassVar[MessageId] = MessageId.SET_INPUT_TORQUE
    torque_nm: float

    def encode(self) -> bytes:
        return torque_value(self.torque_nm)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        return cls(torque_of(data))


@dataclass(frozen=True, slots=True)
class SetLimits:
    """The drive's own velocity and current limits (command 0F)."""

    COMMAND: ClassVar[MessageId] = MessageId.SET_LIMITS
    velocity_rev_s: float
    current_a: float

    def encode(self) -> bytes:
        return _pack_two("limits", self.velocity_rev_s, self.current_a)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        return cls(*_two_finite(data, "limits"))


@dataclass(frozen=True, slots=True)
class Iq:
    """Torque-producing current: wanted and measured (command 14)."""

    COMMAND: ClassVar[MessageId] = MessageId.IQ
    setpoint_a: float
    measured_a: float

    def encode(self) -> bytes:
        return _pack_two("current", self.setpoint_a, self.measured_a)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        return cls(*_two_finite(data, "current"))


@dataclass(frozen=True, slots=True)
class Temperature:
    """Temperatures; NaN where there is no sensor (command 15)."""

    COMMAND: ClassVar[MessageId] = MessageId.TEMPERATURE
    transistor_c: float
    motor_c: float

    def encode(self) -> bytes:
        return _TWO_F32.pack(self.transistor_c, self.motor_c)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        check_length(data, 8, "temperature")
        return cls(*_TWO_F32.unpack_from(data))


@dataclass(frozen=True, slots=True)
class BusVoltageCurrent:
    """The supply (command 17)."""

    COMMAND: ClassVar[MessageId] = MessageId.BUS_VOLTAGE_CURRENT
    voltage_v: float
    current_a: float

    def encode(self) -> bytes:
        return _pack_two("bus voltage", self.voltage_v, self.current_a)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        return cls(*_two_finite(data, "bus voltage"))


@dataclass(frozen=True, slots=True)
class ClearErrors:
    """Forget past errors (command 18); ``identify`` makes the drive blink."""

    COMMAND: ClassVar[MessageId] = MessageId.CLEAR_ERRORS
    identify: bool = False

    def encode(self) -> bytes:
        return b"\x01" if self.identify else b"\x00"

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        return cls(bool(data) and data[0] != 0)


@dataclass(frozen=True, slots=True)
class Torques:
    """The torque wanted and the drive's estimate of the torque made (command 1C)."""

    COMMAND: ClassVar[MessageId] = MessageId.TORQUES
    target_nm: float
    estimate_nm: float

    def encode(self) -> bytes:
        return _pack_two("torques", self.target_nm, self.estimate_nm)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        return cls(*_two_finite(data, "torques"))
