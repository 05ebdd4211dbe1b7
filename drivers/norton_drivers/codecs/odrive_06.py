"""What an ODrive with firmware 0.6 has beyond its messages: parameters by endpoint number, and its errors in words.

Sources: ODrive manual, "CAN Protocol", RxSdo and TxSdo; ODrive API reference (firmware 0.6), "ODrive.Error",
"ODrive.ProcedureResult", "ODrive.Axis.AxisState".
"""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import ClassVar, Self

from norton_drivers.codecs.odrive import ERROR_ESTOP, ERROR_WATCHDOG, AxisState, MessageId, check_length, pack_float

_SDO = Struct("<BHx4s")
_U32 = Struct("<I")
_F32 = Struct("<f")


class SdoOpcode(IntEnum):
    READ = 0
    WRITE = 1


# Endpoint numbers differ between boards and firmware revisions: these are those of one published list of firmware
# 0.6. A board's own stand in the flat_endpoints.json that ODrive publishes for it.
ENDPOINT_WATCHDOG_TIMEOUT = 200  # axis0.config.watchdog_timeout, f32 [s]
ENDPOINT_ENABLE_WATCHDOG = 201  # axis0.config.enable_watchdog, bool


def f32_value(number: float) -> bytes:
    """The four value bytes of a float parameter."""
    return pack_float(_F32, "parameter", number)


def f32_of(value: bytes) -> float:
    """The float in four value bytes."""
    return float(_F32.unpack(value)[0])


def u32_value(number: int) -> bytes:
    """The four value bytes of an unsigned (or boolean) parameter."""
    return _U32.pack(number)


def u32_of(value: bytes) -> int:
    """The unsigned number in four value bytes."""
    return int(_U32.unpack(value)[0])


@dataclass(frozen=True, slots=True)
class RxSdo:
    """Read or write any parameter, host to drive (command 04). Endpoint numbers belong to one firmware version."""

    COMMAND: ClassVar[MessageId] = MessageId.RX_SDO
    opcode: int
    endpoint: int
    value: bytes = bytes(4)

    def encode(self) -> bytes:
        return _SDO.pack(self.opcode, self.endpoint, self.value)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        # A read, and the write of a small type, may come without the last value bytes.
        check_length(data, 4, "parameter request")
        return cls(*_SDO.unpack(bytes(data[:8]).ljust(8, b"\0")))


@dataclass(frozen=True, slots=True)
class TxSdo:
    """A parameter's value, drive to host (command 05)."""

    COMMAND: ClassVar[MessageId] = MessageId.TX_SDO
    endpoint: int
    value: bytes

    def encode(self) -> bytes:
        return _SDO.pack(0, self.endpoint, self.value)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        check_length(data, 5, "parameter answer")
        _, endpoint, value = _SDO.unpack(bytes(data[:8]).ljust(8, b"\0"))
        return cls(endpoint, value)


_ERROR_WORDS: tuple[tuple[int, str], ...] = (
    (1 << 0, "the drive is initialising"),
    (1 << 1, "system-level fault in the firmware"),
    (1 << 2, "timing error: the drive's processor is overloaded"),
    (1 << 3, "no valid position or velocity estimate: check the encoder"),
    (1 << 4, "configuration invalid or incomplete"),
    (1 << 5, "gate driver fault"),
    (1 << 6, "no input value was given before the loop was closed"),
    (1 << 8, "bus voltage too high"),
    (1 << 9, "bus voltage too low: is the supply on?"),
    (1 << 10, "bus current too high"),
    (1 << 11, "regenerated bus current too high: check the brake resistor"),
    (1 << 12, "motor current limit violated"),
    (1 << 13, "motor too hot"),
    (1 << 14, "inverter too hot"),
    (1 << 15, "the drive's velocity limit was violated"),
    (1 << 16, "the drive's position limit was violated"),
    (ERROR_WATCHDOG, "watchdog expired: no command arrived in time"),
    (ERROR_ESTOP, "emergency stop requested"),
    (1 << 26, "spin-out: electrical and mechanical power disagree"),
    (1 << 27, "brake resistor disarmed"),
    (1 << 28, "thermistor disconnected"),
    (1 << 30, "calibration failed"),
)
_ERROR_BITS_KNOWN = sum(bit for bit, _ in _ERROR_WORDS)

_PROCEDURE_RESULTS = (
    "success",
    "busy",
    "cancelled",
    "disarmed",
    "no response",
    "pole pairs and encoder counts disagree",
    "phase resistance out of range",
    "phase inductance out of range",
    "phases unbalanced",
    "motor type invalid",
    "illegal Hall state",
    "timed out",
    "homing without an end stop",
    "not possible in this state",
    "not calibrated",
    "does not converge",
)


def describe_errors(bits: int) -> tuple[str, ...]:
    """Active errors or a disarm reason in words, lowest bit first; empty where there are none."""
    if not bits:
        return ()  # as every healthy heartbeat says: going through all of them takes a third of a tick's work
    words = tuple(text for bit, text in _ERROR_WORDS if bits & bit)
    unknown = bits & ~_ERROR_BITS_KNOWN
    return (*words, f"unknown error bits 0x{unknown:08X}") if unknown else words


def describe_procedure_result(result: int) -> str:
    """How the last procedure (for instance closing the loop) ended."""
    return _PROCEDURE_RESULTS[result] if result < len(_PROCEDURE_RESULTS) else f"unknown result {result}"


def describe_axis_state(state: int) -> str:
    """An axis state in words; unknown numbers are said as such."""
    try:
        return AxisState(state).name.lower().replace("_", " ")
    except ValueError:
        return f"unknown state {state}"
