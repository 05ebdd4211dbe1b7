"""CANopen: identifiers, network management, heartbeats, emergencies and parameters (SDO) as bytes, for either end.

Numbers are little-endian. Identifiers are those of the predefined connection set. Source: CiA 301 (CANopen application
layer), as python-canopen 2.4 and CANopenNode have it. Parameters of more than four bytes are read in segments; they
are not written here.
"""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Self

from norton_drivers.codecs.common import CodecError

NODE_MAX = 127
NMT_ID = 0x000
SYNC_ID = 0x080
PDO_NOT_VALID = 1 << 31  # in a PDO's COB-ID
PDO_NO_REMOTE = 1 << 30
EVENT_DRIVEN = 255  # a PDO's transmission type; 1 to 240 count SYNCs

ABORT_TOGGLE = 0x05030000
ABORT_UNKNOWN_COMMAND = 0x05040001
ABORT_NOT_WRITABLE = 0x06010002
ABORT_NO_OBJECT = 0x06020000
ABORT_NOT_MAPPABLE = 0x06040041
ABORT_PDO_TOO_LONG = 0x06040042
ABORT_WRONG_LENGTH = 0x06070010
ABORT_NO_SUBINDEX = 0x06090011
ABORT_VALUE = 0x06090030
ABORT_DEVICE_STATE = 0x08000022

_SEGMENT_MAX = 7
_EXPEDITED_MAX = 4
_NMT = Struct("<BB")
_EMERGENCY = Struct("<HB5s")
_SDO = Struct("<BHB4s")
_SDO_U32 = Struct("<BHBI")


class NmtCommand(IntEnum):
    """What a master tells a node."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(IntEnum):
    """What a node's heartbeat says; the first one after it started is BOOT_UP."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


def emergency_id(node: int) -> int:
    return 0x080 + _checked(node)


def transmit_pdo_id(node: int, number: int = 1) -> int:
    """Of the PDO that a device sends; ``number`` is 1 to 4."""
    return 0x080 + 0x100 * number + _checked(node)


def receive_pdo_id(node: int, number: int = 1) -> int:
    """Of the PDO that a device receives; ``number`` is 1 to 4."""
    return 0x100 + 0x100 * number + _checked(node)


def sdo_answer_id(node: int) -> int:
    return 0x580 + _checked(node)


def sdo_request_id(node: int) -> int:
    return 0x600 + _checked(node)


def heartbeat_id(node: int) -> int:
    return 0x700 + _checked(node)


def consumer_heartbeat(node: int, timeout_ms: int) -> int:
    """The value of 1016h: whose heartbeats a device waits for, and how long. Raises CodecError."""
    if not 0 <= timeout_ms <= 0xFFFF:
        raise CodecError(f"consumer heartbeat time: {timeout_ms} ms is not within 0 to 65535 ms")
    return _checked(node) << 16 | timeout_ms


def mapping_word(index: int, subindex: int, bits: int) -> int:
    """One entry of a PDO's mapping: which object, and how many bits of it."""
    return index << 16 | subindex << 8 | bits


def heartbeat(state: NmtState) -> bytes:
    """A heartbeat's payload."""
    return bytes((state,))


def heartbeat_of(data: bytes | bytearray) -> NmtState:
    """The state in a heartbeat. Raises CodecError."""
    if len(data) != 1:
        raise CodecError(f"heartbeat: {len(data)} bytes instead of 1")
    try:
        return NmtState(data[0])
    except ValueError as error:
        raise CodecError(f"heartbeat: unknown state 0x{data[0]:02X}") from error


@dataclass(frozen=True, slots=True)
class NmtOrder:
    """A command to one node; node 0 is all of them."""

    command: NmtCommand
    node: int

    def encode(self) -> bytes:
        return _NMT.pack(self.command, self.node)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        if len(data) != _NMT.size:
            raise CodecError(f"network management: {len(data)} bytes instead of 2")
        try:
            return cls(NmtCommand(data[0]), data[1])
        except ValueError as error:
            raise CodecError(f"network management: unknown command 0x{data[0]:02X}") from error


@dataclass(frozen=True, slots=True)
class Emergency:
    """Sent once when an error appears; ``code`` 0 says that all are gone. ``detail`` is the maker's own."""

    code: int
    register: int = 0
    detail: bytes = bytes(5)

    def encode(self) -> bytes:
        return _EMERGENCY.pack(self.code, self.register, self.detail)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        if len(data) != _EMERGENCY.size:
            raise CodecError(f"emergency: {len(data)} bytes instead of 8")
        return cls(*_EMERGENCY.unpack(data))


@dataclass(frozen=True, slots=True)
class SdoRead:
    """Asks for a parameter."""

    index: int
    subindex: int

    def encode(self) -> bytes:
        return _SDO.pack(0x40, self.index, self.subindex, bytes(4))


@dataclass(frozen=True, slots=True)
class SdoReadSegment:
    """Asks for the next piece of a long parameter."""

    toggle: bool

    def encode(self) -> bytes:
        return bytes((0x60 | self.toggle << 4,)).ljust(8, b"\0")


@dataclass(frozen=True, slots=True)
class SdoWrite:
    """Sets a parameter of one to four bytes."""

    index: int
    subindex: int
    value: bytes

    def encode(self) -> bytes:
        return _expedited(0x23, self.index, self.subindex, self.value)


@dataclass(frozen=True, slots=True)
class SdoValue:
    """Answers with a parameter of one to four bytes."""

    index: int
    subindex: int
    value: bytes

    def encode(self) -> bytes:
        return _expedited(0x43, self.index, self.subindex, self.value)


@dataclass(frozen=True, slots=True)
class SdoLongValue:
    """Answers that the parameter has ``size`` bytes, to be asked for in segments."""

    index: int
    subindex: int
    size: int

    def encode(self) -> bytes:
        return _SDO_U32.pack(0x41, self.index, self.subindex, self.size)


@dataclass(frozen=True, slots=True)
class SdoSegment:
    """Up to seven bytes of a long parameter."""

    toggle: bool
    data: bytes
    last: bool

    def encode(self) -> bytes:
        if not 0 <= len(self.data) <= _SEGMENT_MAX:
            raise CodecError(f"parameter: a segment has at most {_SEGMENT_MAX} bytes, not {len(self.data)}")
        command = self.toggle << 4 | (_SEGMENT_MAX - len(self.data)) << 1 | self.last
        return bytes((command,)) + self.data.ljust(_SEGMENT_MAX, b"\0")


@dataclass(frozen=True, slots=True)
class SdoWritten:
    """Answers that a parameter was taken."""

    index: int
    subindex: int

    def encode(self) -> bytes:
        return _SDO.pack(0x60, self.index, self.subindex, bytes(4))


@dataclass(frozen=True, slots=True)
class SdoAbort:
    """Either end gives up, and says why."""

    index: int
    subindex: int
    code: int

    def encode(self) -> bytes:
        return _SDO_U32.pack(0x80, self.index, self.subindex, self.code)


SdoRequest = SdoRead | SdoReadSegment | SdoWrite | SdoAbort
SdoAnswer = SdoValue | SdoLongValue | SdoSegment | SdoWritten | SdoAbort


def sdo_request_of(data: bytes | bytearray) -> SdoRequest:
    """What a client asks. Raises CodecError, also for what is not spoken here."""
    command, index, subindex, tail = _sdo_fields(data)
    match command >> 5:
        case 1 if command & 0x02:
            return SdoWrite(index, subindex, tail[: _expedited_size(command)])
        case 2:
            return SdoRead(index, subindex)
        case 3:
            return SdoReadSegment(bool(command & 0x10))
        case 4:
            return SdoAbort(index, subindex, int.from_bytes(tail, "little"))
    raise CodecError(f"parameter request: unknown command 0x{command:02X}")


def sdo_answer_of(data: bytes | bytearray) -> SdoAnswer:
    """What a server answers. Raises CodecError, also for what is not spoken here."""
    command, index, subindex, tail = _sdo_fields(data)
    match command >> 5:
        case 0:
            size = _SEGMENT_MAX - (command >> 1 & 0x07)
            return SdoSegment(bool(command & 0x10), bytes(data[1 : 1 + size]), bool(command & 0x01))
        case 2 if command & 0x02:
            return SdoValue(index, subindex, tail[: _expedited_size(command)])
        case 2:
            return SdoLongValue(index, subindex, int.from_bytes(tail, "little"))
        case 3:
            return SdoWritten(index, subindex)
        case 4:
            return SdoAbort(index, subindex, int.from_bytes(tail, "little"))
    raise CodecError(f"parameter answer: unknown command 0x{command:02X}")


def _checked(node: int) -> int:
    if not 1 <= node <= NODE_MAX:
        raise CodecError(f"CANopen node ids go from 1 to {NODE_MAX}, not {node}")
    return node


def _sdo_fields(data: bytes | bytearray) -> tuple[int, int, int, bytes]:
    if len(data) != _SDO.size:
        raise CodecError(f"parameter: {len(data)} bytes instead of 8")
    command, index, subindex, tail = _SDO.unpack(data)
    return command, index, subindex, tail


def _expedited(command: int, index: int, subindex: int, value: bytes) -> bytes:
    if not 1 <= len(value) <= _EXPEDITED_MAX:
        raise CodecError(f"parameter: 1 to {_EXPEDITED_MAX} bytes fit into one frame, not {len(value)}")
    unused = _EXPEDITED_MAX - len(value)
    return _SDO.pack(command | unused << 2, index, subindex, value.ljust(_EXPEDITED_MAX, b"\0"))


def _expedited_size(command: int) -> int:
    return _EXPEDITED_MAX - (command >> 2 & 0x03) if command & 0x01 else _EXPEDITED_MAX


_ERRORS = {
    0x2110: "short circuit or earth leakage at the supply",
    0x2130: "short circuit at the supply",
    0x2213: "over-current in a ramp",
    0x2214: "over-current",
    0x2220: "continuous over-current inside the drive",
    0x2230: "short circuit or earth leakage inside the drive",
    0x2240: "earth leakage inside the drive",
    0x2250: "short circuit inside the drive",
    0x2310: "continuous over-current in the motor",
    0x2320: "short circuit or earth leakage at the motor",
    0x2330: "earth leakage at the motor",
    0x2340: "short circuit at the motor",
    0x2350: "load too high for too long (I2t)",
    0x3110: "mains voltage too high",
    0x3120: "mains voltage too low",
    0x3130: "a mains phase is missing",
    0x3210: "bus voltage too high: check the brake resistor",
    0x3220: "bus voltage too low: is the supply on?",
    0x3310: "output voltage too high",
    0x3320: "armature circuit faulty",
    0x4110: "surroundings too hot",
    0x4120: "surroundings too cold",
    0x4210: "device too hot",
    0x4220: "device too cold",
    0x4310: "drive too hot",
    0x4320: "drive too cold",
    0x5210: "measurement circuit faulty",
    0x5430: "input stage faulty: is safe torque off active?",
    0x5530: "parameter memory faulty",
    0x6010: "the drive's processor restarted (its own watchdog)",
    0x6100: "internal software error",
    0x6310: "parameters lost",
    0x6320: "a parameter is wrong",
    0x7110: "brake chopper faulty",
    0x7121: "motor blocked",
    0x7122: "motor or its commutation faulty",
    0x7300: "sensor faulty",
    0x7305: "encoder faulty",
    0x7310: "speed too high or its sensor faulty",
    0x7320: "position sensor faulty",
    0x7380: "position sensor faulty",
    0x8110: "CAN frames lost: the device is overrun",
    0x8120: "CAN controller error passive: check termination and bitrate",
    0x8130: "host's heartbeat lost",
    0x8140: "recovered from bus-off: check termination and bitrate",
    0x8150: "another device has the same identifier",
    0x8210: "PDO too short for its mapping",
    0x8220: "PDO longer than its mapping",
    0x8240: "SYNC of an unexpected length",
    0x8250: "commands came too late (RPDO timeout)",
    0x8311: "torque limit exceeded",
    0x8400: "speed error too large",
    0x8500: "position error too large",
    0x8611: "following error",
    0x9000: "external error",
}
# By ever coarser masks, for codes that have no words of their own.
_CLASSES = (
    (0xFF00, 0x8100, "communication error"),
    (0xF000, 0x1000, "generic error"),
    (0xF000, 0x2000, "current error"),
    (0xF000, 0x3000, "voltage error"),
    (0xF000, 0x4000, "temperature error"),
    (0xF000, 0x5000, "hardware error"),
    (0xF000, 0x6000, "software error"),
    (0xF000, 0x7000, "error of an additional module"),
    (0xF000, 0x8000, "monitoring error"),
    (0xF000, 0x9000, "external error"),
    (0xFF00, 0xFF00, "maker's own error"),
    (0xF000, 0xF000, "additional function's error"),
)
_NMT_STATES = {
    NmtState.BOOT_UP: "just started",
    NmtState.STOPPED: "stopped",
    NmtState.OPERATIONAL: "operational",
    NmtState.PRE_OPERATIONAL: "pre-operational",
}


def describe_error(code: int) -> str:
    """An emergency's code (which is also 603Fh) in words, with the number to look up in the device's manual."""
    words = _ERRORS.get(code) or next((text for mask, value, text in _CLASSES if code & mask == value), "unknown error")
    return f"{words} (0x{code:04X})"


def describe_nmt_state(state: NmtState) -> str:
    """What a node's network management state is called."""
    return _NMT_STATES[state]
