"""CiA 402 drives: statuswords, controlwords and the process data of torque control, for either end of the wire.

Source: CiA 402-2 (IEC 61800-7-201), "State control of the device", objects 6040h, 6041h, 6060h, 6502h; the masks are
those of python-canopen's profiles/p402.py too. The layouts are those that the driver maps, not a drive's defaults.
"""

import struct
from dataclasses import dataclass
from enum import Enum, IntEnum
from struct import Struct
from typing import NamedTuple

from norton_drivers.codecs.common import CodecError

PROFILE = 402  # in the low half of 1000h


class State(Enum):
    """Where the drive's state machine stands, in the standard's words."""

    NOT_READY = "Not ready to switch on"
    SWITCH_ON_DISABLED = "Switch on disabled"
    READY = "Ready to switch on"
    SWITCHED_ON = "Switched on"
    OPERATION_ENABLED = "Operation enabled"
    QUICK_STOP = "Quick stop active"
    FAULT_REACTION = "Fault reaction active"
    FAULT = "Fault"
    UNDEFINED = "an undefined state"


# Mask and value of the statusword; bit 5 (quick stop) counts in some states only.
_PATTERNS = (
    (0x4F, 0x00, State.NOT_READY),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.OPERATION_ENABLED),
    (0x6F, 0x07, State.QUICK_STOP),
    (0x4F, 0x0F, State.FAULT_REACTION),
    (0x4F, 0x08, State.FAULT),
)
_STATE_BITS = 0x6F
VOLTAGE_ENABLED = 1 << 4
REMOTE = 1 << 9


class Controlword(IntEnum):
    """What the drive is told; a fault is reset by the rising edge of bit 7."""

    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    ENABLE_OPERATION = 0x0F
    FAULT_RESET = 0x80


class Mode(IntEnum):
    """Modes of operation (6060h) that are commanded in torque."""

    PROFILE_TORQUE = 4
    CYCLIC_SYNCHRONOUS_TORQUE = 10

    @property
    def supported_bit(self) -> int:
        """Its bit in 6502h."""
        return 1 << (self - 1)


class Object(IntEnum):
    """Indices in a drive's object dictionary."""

    ABORT_CONNECTION_OPTION = 0x6007
    ERROR_CODE = 0x603F
    CONTROLWORD = 0x6040
    STATUSWORD = 0x6041
    QUICK_STOP_OPTION = 0x605A
    FAULT_REACTION_OPTION = 0x605E
    MODE = 0x6060
    MODE_SHOWN = 0x6061
    POSITION = 0x6064
    VELOCITY = 0x606C
    TARGET_TORQUE = 0x6071
    MAX_TORQUE = 0x6072
    RATED_CURRENT = 0x6075
    RATED_TORQUE = 0x6076
    TORQUE = 0x6077
    CURRENT = 0x6078
    TORQUE_SLOPE = 0x6087
    INTERPOLATION_PERIOD = 0x60C2
    SUPPORTED_MODES = 0x6502


@dataclass(frozen=True, slots=True)
class PdoEntry:
    """One object in a PDO, and its size."""

    index: int
    bits: int


COMMAND_PDO = (PdoEntry(Object.CONTROLWORD, 16), PdoEntry(Object.MODE, 8), PdoEntry(Object.TARGET_TORQUE, 16))
STATUS_PDO = (PdoEntry(Object.STATUSWORD, 16), PdoEntry(Object.MODE_SHOWN, 8), PdoEntry(Object.TORQUE, 16))
STATUS_AND_CURRENT_PDO = (*STATUS_PDO, PdoEntry(Object.CURRENT, 16))
MOTION_PDO = (PdoEntry(Object.POSITION, 32), PdoEntry(Object.VELOCITY, 32))

_COMMAND = Struct("<Hbh")
_STATUS = Struct("<Hbh")
_STATUS_AND_CURRENT = Struct("<Hbhh")
_MOTION = Struct("<ii")
TARGET_MAX = 0x7FFF


class TorqueCommand(NamedTuple):
    """What the host sends: controlword, mode and target torque, the latter in the drive's own unit."""

    controlword: int
    mode: int
    target: int


class Status(NamedTuple):
    """What the drive sends: statusword, the mode in force, torque and current (0 if not sent) in its own units."""

    statusword: int
    mode: int
    torque: int
    current: int = 0


class Motion(NamedTuple):
    """What the drive sends: position [counts] and velocity [its own unit]."""

    position: int
    velocity: int


def state_of(statusword: int) -> State:
    """The state that a statusword says."""
    return _STATES[statusword & _STATE_BITS]


def statusword_of(state: State) -> int:
    """The bits by which a drive says its state."""
    return next(value for _, value, other in _PATTERNS if other is state)


def command_value(controlword: int, mode: int, target: int) -> bytes:
    """The payload of :class:`TorqueCommand`. Raises CodecError for a target that 16 bits cannot say."""
    try:
        return _COMMAND.pack(controlword, mode, target)
    except struct.error as error:
        raise CodecError(f"target torque: {target} does not fit into 16 bits") from error


def command_of(data: bytes | bytearray) -> TorqueCommand:
    """Raises CodecError."""
    return TorqueCommand(*_unpacked(_COMMAND, data, "command"))


def status_value(status: Status, *, with_current: bool) -> bytes:
    """The payload of :class:`Status`."""
    return _STATUS_AND_CURRENT.pack(*status) if with_current else _STATUS.pack(*status[:3])


def status_of(data: bytes | bytearray, *, with_current: bool) -> Status:
    """Raises CodecError, also for a length that is not the one mapped: it is then another mapping."""
    return Status(*_unpacked(_STATUS_AND_CURRENT if with_current else _STATUS, data, "status"))


def motion_value(motion: Motion) -> bytes:
    """The payload of :class:`Motion`."""
    return _MOTION.pack(*motion)


def motion_of(data: bytes | bytearray) -> Motion:
    """Raises CodecError."""
    return Motion(*_unpacked(_MOTION, data, "motion"))


def _unpacked(layout: Struct, data: bytes | bytearray, name: str) -> tuple[int, ...]:
    if len(data) != layout.size:
        raise CodecError(f"{name}: {len(data)} bytes instead of {layout.size}; the PDO's mapping is another")
    return layout.unpack(data)


def _find_state(bits: int) -> State:
    return next((state for mask, value, state in _PATTERNS if bits & mask == value), State.UNDEFINED)


_STATES = tuple(_find_state(bits) for bits in range(_STATE_BITS + 1))
