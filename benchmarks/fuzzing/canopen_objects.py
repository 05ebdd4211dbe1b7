"""CANopen's services and CiA 402's process data, against what CiA 301 and 402 say, bit by bit."""

from collections.abc import Callable
from random import Random
from typing import Any

import can
from canopen.profiles.p402 import State402

from norton_drivers.codecs import canopen, cia402
from norton_drivers.codecs.canopen import (
    Emergency,
    NmtOrder,
    SdoAbort,
    SdoLongValue,
    SdoRead,
    SdoSegment,
    SdoValue,
    SdoWritten,
)
from norton_drivers.codecs.canopen_torque import TorqueField
from norton_drivers.codecs.common import CodecError

from .frames import FrameCodec, Values

NODE = 9
_FORM = "length, known values; none in the data"
_FUNCTION, _NODE_BITS = 0x780, 0x7F
_STATES = {0: 0, 4: 4, 5: 5, 0x7F: 0x7F}
_COMMANDS = (0x01, 0x02, 0x80, 0x81, 0x82)
_TORQUE = TorqueField("i32", 0, 4)


class Decoders:
    """The codec's functions, by the function code in the identifier."""

    def __init__(self, functions: dict[int, Callable[[bytes], tuple[Any, ...]]]) -> None:
        self._functions = functions

    def hear(self, frame: can.Message) -> Values:
        decode = self._functions.get(frame.arbitration_id & _FUNCTION)
        if decode is None or not _is_from_node(frame):
            return []
        try:
            return [decode(bytes(frame.data))]
        except CodecError:
            return []

    def close(self) -> None:
        """Nothing to release."""


class ByHand(Decoders):
    """The same, where None stands for what is no message."""

    def __call__(self, frame: can.Message) -> Values:
        decode = self._functions.get(frame.arbitration_id & _FUNCTION)
        values = decode(bytes(frame.data)) if decode is not None and _is_from_node(frame) else None
        return [] if values is None else [values]


def _is_from_node(frame: can.Message) -> bool:
    mine = frame.arbitration_id & _NODE_BITS == (0 if frame.arbitration_id < 0x80 else NODE)
    return mine and not frame.is_extended_id and not frame.is_remote_frame


# ---- Services --------------------------------------------------------------------------------------------------------


def _order(data: bytes) -> tuple[Any, ...]:
    order = NmtOrder.decode(data)
    return int(order.command), order.node


def _emergency(data: bytes) -> tuple[Any, ...]:
    emergency = Emergency.decode(data)
    return emergency.code, emergency.register, *emergency.detail


def _answer(data: bytes) -> tuple[Any, ...]:
    match canopen.sdo_answer_of(data):
        case SdoSegment(toggle, piece, last):
            return 0, toggle, last, *piece
        case SdoLongValue(index, subindex, size):
            return 1, index, subindex, size
        case SdoValue(index, subindex, value):
            return 2, index, subindex, *value
        case SdoWritten(index, subindex):
            return 3, index, subindex
        case SdoAbort(index, subindex, code):
            return 4, index, subindex, code


def _request(data: bytes) -> tuple[Any, ...]:
    match canopen.sdo_request_of(data):
        case canopen.SdoWrite(index, subindex, value):
            return 1, index, subindex, *value
        case SdoRead(index, subindex):
            return 2, index, subindex
        case canopen.SdoReadSegment(toggle):
            return 3, toggle
        case SdoAbort(index, subindex, code):
            return 4, index, subindex, code


def _answer_by_hand(data: bytes) -> tuple[Any, ...] | None:
    """CiA 301, 7.2.4.3: command specifier in bits 7 to 5; n, e and s below."""
    if len(data) != 8:
        return None
    first, address = data[0], _address(data)
    match first >> 5:
        case 0:
            return 0, bool(first & 16), bool(first & 1), *data[1 : 8 - (first >> 1 & 7)]
        case 2 if first & 2:
            return 2, *address, *data[4 : _expedited_end(first)]
        case 3:
            return 3, *address
        case 2 | 4 as specifier:
            return 1 if specifier == 2 else 4, *address, int.from_bytes(data[4:], "little")
    return None


def _request_by_hand(data: bytes) -> tuple[Any, ...] | None:
    if len(data) != 8:
        return None
    first, address = data[0], _address(data)
    match first >> 5:
        case 1 if first & 2:
            return 1, *address, *data[4 : _expedited_end(first)]
        case 2:
            return 2, *address
        case 3:
            return 3, bool(first & 16)
        case 4:
            return 4, *address, int.from_bytes(data[4:], "little")
    return None


def _address(data: bytes) -> tuple[int, int]:
    return data[1] | data[2] << 8, data[3]


def _expedited_end(first: int) -> int:
    return 8 - (first >> 2 & 3) if first & 1 else 8


def services() -> FrameCodec:
    def torque(data: bytes) -> tuple[Any, ...]:
        return (_TORQUE.decode(data),)

    def state(data: bytes) -> tuple[Any, ...]:
        return (int(canopen.heartbeat_of(data)),)

    tested = {0x000: _order, 0x080: _emergency, 0x180: torque, 0x580: _answer, 0x600: _request, 0x700: state}
    by_hand: dict[int, Callable[[bytes], Any]] = {
        0x000: lambda data: tuple(data) if len(data) == 2 and data[0] in _COMMANDS else None,
        0x080: lambda data: (data[0] | data[1] << 8, *data[2:]) if len(data) == 8 else None,
        0x180: lambda data: (int.from_bytes(data, "little", signed=True),) if len(data) == 4 else None,
        0x580: _answer_by_hand,
        0x600: _request_by_hand,
        0x700: lambda data: (data[0],) if len(data) == 1 and data[0] in _STATES else None,
    }
    return _codec("CANopen NMT, SDO, EMCY, PDO", tested, by_hand, {0x000: 2, 0x180: 4, 0x700: 1})


# ---- CiA 402 ---------------------------------------------------------------------------------------------------------


def _status(data: bytes) -> tuple[Any, ...]:
    status = cia402.status_of(data, with_current=True)
    return *status, _number_of(cia402.state_of(status.statusword).value)


def _status_by_hand(data: bytes) -> tuple[Any, ...] | None:
    """The state by python-canopen's masks."""
    if len(data) != 7:
        return None
    statusword = data[0] | data[1] << 8
    names = [name for name, (mask, value) in State402.SW_MASK.items() if statusword & mask == value]
    numbers = (_signed(data[at : at + size]) for at, size in ((2, 1), (3, 2), (5, 2)))
    return statusword, *numbers, _number_of(names[0] if names else "an undefined state")


def _number_of(state: str) -> int:
    names = (*State402.SW_MASK, "AN UNDEFINED STATE")
    return next(number for number, name in enumerate(names) if name == state.upper())


def _signed(data: bytes) -> int:
    return int.from_bytes(data, "little", signed=True)


def process_data() -> FrameCodec:
    tested: dict[int, Callable[[bytes], tuple[Any, ...]]] = {
        0x180: _status,
        0x280: lambda data: tuple(cia402.motion_of(data)),
        0x200: lambda data: tuple(cia402.command_of(data)),
    }
    by_hand: dict[int, Callable[[bytes], Any]] = {
        0x180: _status_by_hand,
        0x280: lambda data: (_signed(data[:4]), _signed(data[4:])) if len(data) == 8 else None,
        0x200: lambda data: (data[0] | data[1] << 8, _signed(data[2:3]), _signed(data[3:])) if len(data) == 5 else None,
    }
    return _codec("CiA 402 process data", tested, by_hand, {0x180: 7, 0x280: 8, 0x200: 5})


def _codec(
    name: str,
    tested: dict[int, Callable[[bytes], tuple[Any, ...]]],
    by_hand: dict[int, Callable[[bytes], Any]],
    lengths: dict[int, int],
) -> FrameCodec:
    identifiers = tuple(function | (NODE if function else 0) for function in tested)

    def good(random: Random) -> can.Message:
        identifier = random.choice(identifiers)
        data = random.randbytes(lengths.get(identifier & _FUNCTION, 8))
        return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)

    return FrameCodec(name, _FORM, identifiers, good, Decoders(tested), ByHand(by_hand))
