"""moteus (mjbots): what its registers mean, what it is told in every tick, and what it answers.

A drive answers the reads of a frame before it obeys the writes, so that a reply is older than its command. A command
begins with the mode; what it does not say has a default. Angles are in turns. Sources: mjbots/moteus,
docs/protocol/registers.md, docs/guides/control-modes.md; fw/moteus_controller.cc (``Write``, ``Read``,
``ScaleSaturate``), fw/bldc_servo_structs.h (``BldcServoMode``), fw/bldc_servo_control.h (``PrepareCommand``).
"""

from collections.abc import Callable, Mapping
from enum import IntEnum
from math import isfinite, nan, tau
from struct import Struct
from typing import Final, NamedTuple, Self

from norton_drivers.codecs.can_frames import padded
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.multiplex import FILLER, Kind, Refusal, Resolution, Subframe, frame, read, subframes, write


class Register(IntEnum):
    """Those that are used here, or emulated."""

    MODE = 0x000
    POSITION = 0x001
    VELOCITY = 0x002
    TORQUE = 0x003
    Q_CURRENT = 0x004
    D_CURRENT = 0x005
    MOTOR_TEMPERATURE = 0x00A
    TRAJECTORY_COMPLETE = 0x00B
    HOME_STATE = 0x00C
    VOLTAGE = 0x00D
    TEMPERATURE = 0x00E
    FAULT = 0x00F
    COMMAND_POSITION = 0x020
    COMMAND_VELOCITY = 0x021
    FEEDFORWARD_TORQUE = 0x022
    KP_SCALE = 0x023
    KD_SCALE = 0x024
    MAXIMUM_TORQUE = 0x025
    STOP_POSITION = 0x026
    TIMEOUT = 0x027
    VELOCITY_LIMIT = 0x028
    ACCELERATION_LIMIT = 0x029
    ILIMIT_SCALE = 0x02B
    IGNORE_BOUNDS = 0x02D
    MODEL = 0x100
    FIRMWARE = 0x101
    REGISTER_MAP = 0x102
    SERIAL_NUMBER = 0x120
    SET_OUTPUT_NEAREST = 0x130
    SET_OUTPUT_EXACT = 0x131


class Mode(IntEnum):
    """Of register 0."""

    STOPPED = 0
    FAULT = 1
    ENABLING = 2
    CALIBRATING = 3
    CALIBRATION_COMPLETE = 4
    PWM = 5
    VOLTAGE = 6
    VOLTAGE_FOC = 7
    VOLTAGE_DQ = 8
    CURRENT = 9
    POSITION = 10
    TIMEOUT = 11
    ZERO_VELOCITY = 12
    STAY_WITHIN = 13
    MEASURE_INDUCTANCE = 14
    BRAKE = 15


# What one step of an integer stands for, by its bits: registers.md, "Mappings".
_ONE: Final = (1.0, 1.0, 1.0)
_ANGLE: Final = (0.01, 1e-4, 1e-5)
_VELOCITY: Final = (0.1, 2.5e-4, 1e-5)
_ACCELERATION: Final = (0.05, 1e-3, 1e-5)
_TORQUE: Final = (0.5, 0.01, 1e-3)
_CURRENT: Final = (1.0, 0.1, 1e-3)
_VOLTAGE: Final = (0.5, 0.1, 1e-3)
_TIME: Final = (0.01, 1e-3, 1e-6)
_SHARE: Final = (1 / 127, 1 / 32767, 1 / 2147483647)
_STEPS: Final[Mapping[int, tuple[float, float, float]]] = {
    Register.POSITION: _ANGLE,
    Register.VELOCITY: _VELOCITY,
    Register.TORQUE: _TORQUE,
    Register.Q_CURRENT: _CURRENT,
    Register.D_CURRENT: _CURRENT,
    Register.MOTOR_TEMPERATURE: _CURRENT,
    Register.VOLTAGE: _VOLTAGE,
    Register.TEMPERATURE: _CURRENT,
    Register.COMMAND_POSITION: _ANGLE,
    Register.COMMAND_VELOCITY: _VELOCITY,
    Register.FEEDFORWARD_TORQUE: _TORQUE,
    Register.KP_SCALE: _SHARE,
    Register.KD_SCALE: _SHARE,
    Register.MAXIMUM_TORQUE: _TORQUE,
    Register.STOP_POSITION: _ANGLE,
    Register.TIMEOUT: _TIME,
    Register.VELOCITY_LIMIT: _VELOCITY,
    Register.ACCELERATION_LIMIT: _ACCELERATION,
    Register.ILIMIT_SCALE: _SHARE,
    Register.SET_OUTPUT_NEAREST: _ANGLE,
    Register.SET_OUTPUT_EXACT: _ANGLE,
}
_LARGEST: Final = (0x7F, 0x7FFF, 0x7FFFFFFF)
_CODES: Final = "bhif"


def value_of(register: int, resolution: Resolution, raw: float) -> float:
    """A value in turns, seconds, newton metres, amperes, volts, °C, or as it is; the least integer is no number."""
    steps = _STEPS.get(register)
    if resolution is Resolution.FLOAT or steps is None:
        return raw
    return nan if raw == -_LARGEST[resolution] - 1 else raw * steps[resolution]


def raw_of(register: int, resolution: Resolution, value: float) -> float:
    """What stands for a value; as the firmware has it, cut off towards zero and held within the integer's range."""
    if resolution is Resolution.FLOAT:
        return value
    largest = _LARGEST[resolution]
    if not isfinite(value):
        return -largest - 1
    return int(min(max(value / _STEPS.get(register, _ONE)[resolution], -largest), largest))


_QUESTION: Final = b"".join(
    part.encode()
    for part in (
        read(Register.MODE, Resolution.INT8),
        read(Register.POSITION, Resolution.FLOAT, 4),
        read(Register.VOLTAGE, Resolution.INT16, 3),
    )
)
ASK: Final = padded(_QUESTION, FILLER)
STOP: Final = padded(write(Register.MODE, Resolution.INT8, Mode.STOPPED).encode() + _QUESTION, FILLER)
ASK_IDENTITY: Final = frame((read(Register.MODEL, Resolution.INT32, 3),))
ASK_MODE: Final = frame((read(Register.MODE, Resolution.INT8),))
TIMEOUT_MAX_S: Final = 32.0
_TIMEOUT_STEPS_S: Final = 1000
_FLOAT: Final = Struct("<f")
_FLOAT_MAX: Final = 3.4e38
_COUNT_NONE: Final = -0x80  # no number


class Command(NamedTuple):
    """A command of one value: what comes before it in the frame, and after it."""

    before: bytes
    after: bytes

    def frame(self, value: float) -> tuple[bytes, float]:
        """The frame, and the value as it is sent. Raises CodecError for what is no number."""
        if not abs(value) <= _FLOAT_MAX:
            raise CodecError("command: not a finite number")
        packed = _FLOAT.pack(value)
        return self.before + packed + self.after, _FLOAT.unpack(packed)[0]


def torque_command(timeout_s: float) -> Command:
    """A feed-forward torque [N m], with all gains zero and no position, as control-modes.md has it; and the question.

    ``timeout_s`` is the time without a command after which the drive gives up, in steps of 1 ms; 0: as it is set there.
    """
    return _command(
        (
            write(Register.MODE, Resolution.INT8, Mode.POSITION),
            write(Register.COMMAND_POSITION, Resolution.INT8, _COUNT_NONE),
        ),
        Register.FEEDFORWARD_TORQUE,
        (write(Register.KP_SCALE, Resolution.INT8, 0, 0), *_ending(timeout_s)),
    )


def position_command(timeout_s: float) -> Command:
    """A goal [turns] that is obeyed at once, without the drive's own trajectory (a negative limit is none), with the
    drive's gains but no integral; and the question."""
    unlimited = (raw_of(register, Resolution.INT8, -1.0) for register in _LIMITS)
    return _command(
        (write(Register.MODE, Resolution.INT8, Mode.POSITION),),
        Register.COMMAND_POSITION,
        (*_ending(timeout_s), write(_LIMITS[0], Resolution.INT8, *unlimited)),
    )


def velocity_command(timeout_s: float) -> Command:
    """A velocity [turns/s] that is obeyed at once, without a place to hold: no position, no kp and no integral, but the
    drive's kd; and the question."""
    unlimited = (raw_of(register, Resolution.INT8, -1.0) for register in _LIMITS)
    return _command(
        (
            write(Register.MODE, Resolution.INT8, Mode.POSITION),
            write(Register.COMMAND_POSITION, Resolution.INT8, _COUNT_NONE),
        ),
        Register.COMMAND_VELOCITY,
        (
            write(Register.KP_SCALE, Resolution.INT8, 0),
            *_ending(timeout_s),
            write(_LIMITS[0], Resolution.INT8, *unlimited),
        ),
    )


# How each mode is commanded, and what one of the controller's units is.
FORMS: Final[Mapping[str, tuple[Callable[[float], Command], float]]] = {
    "torque": (torque_command, 1.0),
    "position": (position_command, tau),
    "velocity": (velocity_command, tau),
}
_LIMITS: Final = (Register.VELOCITY_LIMIT, Register.ACCELERATION_LIMIT)


def _ending(timeout_s: float) -> tuple[Subframe, Subframe]:
    steps = round(timeout_s * _TIMEOUT_STEPS_S)
    return write(Register.TIMEOUT, Resolution.INT16, steps), write(Register.ILIMIT_SCALE, Resolution.INT8, 0)


def _command(first: tuple[Subframe, ...], register: Register, last: tuple[Subframe, ...]) -> Command:
    before = b"".join(part.encode() for part in (*first, write(register, Resolution.FLOAT, 0.0)))[: -_FLOAT.size]
    after = b"".join(part.encode() for part in last) + _QUESTION
    length = len(before) + _FLOAT.size
    return Command(before, padded(bytes(length) + after, FILLER)[length:])


class State(NamedTuple):
    """The answer to the question. ``refused``: registers of the command that the drive does not have."""

    mode: int
    position_turns: float
    velocity_turns_s: float
    torque_nm: float
    q_current_a: float
    voltage_v: float
    temperature_c: float
    fault: int
    refused: tuple[int, ...] = ()

    def encode(self) -> bytes:
        """As a drive sends it."""
        scaled = ((Register.VOLTAGE, self.voltage_v), (Register.TEMPERATURE, self.temperature_c))
        raw = (*(raw_of(register, Resolution.INT16, value) for register, value in scaled), self.fault)
        return frame(
            (
                *(Refusal(True, register, 1) for register in self.refused),
                Subframe(Kind.REPLY, Register.MODE, Resolution.INT8, 1, (self.mode,)),
                Subframe(Kind.REPLY, Register.POSITION, Resolution.FLOAT, 4, self[1:5]),
                Subframe(Kind.REPLY, Register.VOLTAGE, Resolution.INT16, 3, raw),
            )
        )

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self | None:
        """None for a reply to another question. Raises CodecError for what is none, or has no finite motion."""
        if len(data) == _PLAIN_LENGTH and all(data[at : at + len(head)] == head for at, head in _PLAIN_HEADS):
            mode, *motion, voltage, temperature, fault = _PLAIN.unpack_from(data)
            refused: tuple[int, ...] = ()
        else:
            found, refused = replied(data)
            if not _STATE_REGISTERS.issubset(found):
                return None
            mode, *motion, voltage, temperature, fault = (found[register] for register in sorted(_STATE_REGISTERS))
        if not all(isfinite(value) for value in motion):
            raise CodecError("reply: position, velocity, torque or current is no number")
        volts = value_of(Register.VOLTAGE, Resolution.INT16, voltage)
        warmth = value_of(Register.TEMPERATURE, Resolution.INT16, temperature)
        position, velocity, torque, current = motion
        return cls(int(mode), position, velocity, torque, current, volts, warmth, int(fault), refused)


# A reply without refusals: mode; position, velocity, torque, current; voltage, temperature, fault; two fillers.
_PLAIN: Final = Struct("<2xb3x4f2x3h")
_PLAIN_LENGTH: Final = 32
_PLAIN_HEADS: Final = ((0, b"\x21\x00"), (3, b"\x2c\x04\x01"), (22, b"\x27\x0d"), (30, b"\x50\x50"))
_STATE_REGISTERS: Final = frozenset((*range(0x000, 0x005), *range(0x00D, 0x010)))


def replied(data: bytes | bytearray) -> tuple[dict[int, float], tuple[int, ...]]:
    """The registers of a reply as they stand there, and those that were refused. Raises CodecError."""
    found: dict[int, float] = {}
    refused: list[int] = []
    for part in subframes(data):
        if isinstance(part, Refusal):
            refused.append(part.register)
        elif part.kind is Kind.REPLY:
            found.update(zip(range(part.register, part.register + part.size), part.raw, strict=True))
    return found, tuple(refused)


class Identity(NamedTuple):
    """Who a drive is."""

    model: int
    firmware: int
    register_map: int

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self | None:
        """None for another reply. Raises CodecError for what is none."""
        found, _ = replied(data)
        if Register.REGISTER_MAP not in found:
            return None
        numbers = (Register.MODEL, Register.FIRMWARE, Register.REGISTER_MAP)
        return cls(*(int(found.get(register, 0)) for register in numbers))

    @property
    def firmware_words(self) -> str:
        """registers.md, 0x101: a byte each for major, minor and micro."""
        return ".".join(str(self.firmware >> shift & 0xFF) for shift in (16, 8, 0))


# registers.md, 0x00f; above 95 a limit that is at work, below it a fault.
LIMITS_FROM: Final = 96
_FAULTS: Final = {
    32: "calibration of the current sensors failed",
    33: "motor driver fault: most often the supply broke down",
    34: "supply voltage too high",
    35: "encoder fault",
    36: "motor not configured: run `moteus_tool --calibrate`",
    37: "PWM cycle overrun",
    38: "too hot",
    39: "outside servopos.position_min and position_max: set both to nan in the drive",
    40: "supply voltage too low",
    41: "its configuration was changed",
    42: "no valid commutation encoder",
    43: "no valid output encoder",
    44: "the gate driver could not be enabled",
    45: "stop position with limits",
    46: "timing violation",
    47: "servo.bemf_feedforward without an acceleration limit",
    48: "servopos.position_min or position_max out of range",
    96: "its torque is limited by servo.max_velocity",
    97: "its torque is limited by servo.max_power_W",
    98: "its torque is limited by the supply voltage",
    99: "its torque is limited by servo.max_current_A",
    100: "its torque is limited by its temperature",
    101: "its torque is limited by the motor's temperature",
    102: "its torque is limited by the commanded maximum",
    103: "its torque is limited by servopos.position_min or position_max: set both to nan in the drive",
}
# What alters the torque with time, speed or place, and no network has: all but the greatest torque and the supply's.
DERATED: Final = frozenset((96, 97, 100, 101, 103))


def describe_fault(fault: int) -> str:
    """In words; unknown numbers are said as such."""
    return _FAULTS.get(fault, f"fault {fault}")


def describe_mode(mode: int) -> str:
    """In words; unknown numbers are said as such."""
    return Mode(mode).name.lower().replace("_", " ") if mode in set(Mode) else f"mode {mode}"
