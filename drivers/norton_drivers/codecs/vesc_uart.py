"""VESC on UART and USB: packets on a byte stream, and what is said in them, for either end of the line.

A packet is a start byte (2: a length of one byte follows; 3: of two), the length, the payload, a checksum
(CRC-16/XMODEM, high byte first) and the byte 3. A payload begins with what it is (:class:`Say`); numbers are
big-endian. Sources: vedderb/bldc, comm/packet.c (``packet_send_packet``, ``try_decode_packet``), datatypes.h
(``COMM_PACKET_ID``), comm/commands.c (``commands_process_packet``: scales of commands; ``COMM_GET_VALUES``,
``COMM_GET_VALUES_SELECTIVE``: the mask's bits, their order, layouts and scales; ``COMM_ALIVE`` and the SET commands
feed the timeout, questions do not; ``COMM_FORWARD_CAN``), util/buffer.c (numbers are cut off towards zero).
"""

from binascii import crc_hqx
from collections.abc import Mapping
from enum import IntEnum
from struct import Struct
from typing import Final, NamedTuple

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc import LONGEST, NODE_MAX

_SHORT_START, _LONG_START, _STOP = 2, 3, 3
_LONGEST_SHORT = 255
_TAIL = 3  # checksum and stop byte
_MASK = Struct(">BI")
_I32 = (1 << 31) - 1

POSITION_STEP_DEG = 360 / (1 << 24)  # the firmware has it as a float32 of up to 360
CURRENT_STEP_A = 0.01


class Say(IntEnum):
    """A payload's first byte."""

    FW_VERSION = 0
    GET_VALUES = 4
    SET_DUTY = 5
    SET_CURRENT = 6
    ALIVE = 30
    FORWARD_CAN = 34
    GET_VALUES_SELECTIVE = 50


def packet(payload: bytes) -> bytes:
    """The bytes that carry a payload. Raises CodecError for one that is empty or too long."""
    if not 0 < len(payload) <= LONGEST:
        raise CodecError(f"packet: {len(payload)} bytes where 1 to {LONGEST} can be sent")
    if len(payload) <= _LONGEST_SHORT:
        head = bytes((_SHORT_START, len(payload)))
    else:
        head = bytes((_LONG_START, *len(payload).to_bytes(2, "big")))
    return head + payload + crc_hqx(payload, 0).to_bytes(2, "big") + bytes((_STOP,))


class Received(NamedTuple):
    """A payload, and how many bytes of the same chunk came after its packet."""

    payload: bytes
    later_bytes: int


class PacketStream:
    """Finds packets in a byte stream, however it is cut; ``malformed`` counts starts that led to none."""

    def __init__(self) -> None:
        self.malformed = 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Received]:
        """The packets completed by ``data``, oldest first. Never raises."""
        self._buffer += data
        found: list[Received] = []
        at = 0
        while at < len(self._buffer):
            end = self._end_of_packet(at)
            if end is None:
                break
            if end:
                payload = bytes(self._buffer[at + self._buffer[at] : end - _TAIL])
                found.append(Received(payload, len(self._buffer) - end))
                at = end
            else:
                self.malformed += self._buffer[at] in (_SHORT_START, _LONG_START)
                at += 1
        del self._buffer[:at]
        return found

    def _end_of_packet(self, at: int) -> int | None:
        """Where the packet that begins at ``at`` ends; 0 where none begins there, None where more bytes must tell."""
        buffer = self._buffer
        start = buffer[at]  # also the number of bytes before the payload
        if start not in (_SHORT_START, _LONG_START):
            return 0
        if len(buffer) < at + start:
            return None
        length = int.from_bytes(buffer[at + 1 : at + start], "big")
        # A packet that could do with one byte of length has one.
        if not (0 if start == _SHORT_START else _LONGEST_SHORT - 1) < length <= LONGEST:
            return 0
        end = at + start + length + _TAIL
        if len(buffer) < end:
            return None
        payload = bytes(buffer[at + start : end - _TAIL])
        sound = buffer[end - 1] == _STOP and crc_hqx(payload, 0) == int.from_bytes(buffer[end - 3 : end - 1], "big")
        return end if sound else 0


class Value(IntEnum):
    """What can be asked for: the bit in the mask. Answers have them in this order."""

    TRANSISTOR_C = 0
    MOTOR_C = 1
    MOTOR_A = 2
    SUPPLY_A = 3
    D_A = 4
    Q_A = 5
    DUTY = 6
    ERPM = 7
    SUPPLY_V = 8
    DRAWN_AH = 9
    CHARGED_AH = 10
    DRAWN_WH = 11
    CHARGED_WH = 12
    TACHOMETER = 13
    TACHOMETER_ABSOLUTE = 14
    FAULT = 15
    POSITION_DEG = 16
    NODE = 17
    TRANSISTORS_C = 18  # three of them: not asked for here
    D_V = 19
    Q_V = 20
    STATUS = 21


# Bytes and scale of each that is one number.
_LAYOUT: Final[Mapping[Value, tuple[int, float]]] = {
    Value.TRANSISTOR_C: (2, 1e1),
    Value.MOTOR_C: (2, 1e1),
    Value.MOTOR_A: (4, 1e2),
    Value.SUPPLY_A: (4, 1e2),
    Value.D_A: (4, 1e2),
    Value.Q_A: (4, 1e2),
    Value.DUTY: (2, 1e3),
    Value.ERPM: (4, 1e0),
    Value.SUPPLY_V: (2, 1e1),
    Value.DRAWN_AH: (4, 1e4),
    Value.CHARGED_AH: (4, 1e4),
    Value.DRAWN_WH: (4, 1e4),
    Value.CHARGED_WH: (4, 1e4),
    Value.TACHOMETER: (4, 1.0),
    Value.TACHOMETER_ABSOLUTE: (4, 1.0),
    Value.FAULT: (1, 1.0),
    Value.POSITION_DEG: (4, 1e6),
    Value.NODE: (1, 1.0),
    Value.TRANSISTORS_C: (6, 1e1),
    Value.D_V: (4, 1e3),
    Value.Q_V: (4, 1e3),
    Value.STATUS: (1, 1.0),
}
_ONE_NUMBER = (1, 2, 4)
TIMED_OUT = 0x01  # of STATUS: the timeout has acted


def mask_of(*values: Value) -> int:
    """The mask that asks for these."""
    return sum(1 << value for value in values)


def ask_values(mask: int) -> bytes:
    """The payload that asks for what the mask selects."""
    return _MASK.pack(Say.GET_VALUES_SELECTIVE, mask)


def mask_in(payload: bytes) -> int:
    """Of a question or an answer; -1 for another payload."""
    if len(payload) < _MASK.size or payload[0] != Say.GET_VALUES_SELECTIVE:
        return -1
    return int(_MASK.unpack_from(payload)[1])


def answer_length(mask: int) -> int:
    """Bytes of the whole packet that answers it, with a length of one byte."""
    return _SHORT_START + _MASK.size + sum(_LAYOUT[value][0] for value in Value if mask >> value & 1) + _TAIL


def values_value(values: Mapping[Value, float], mask: int) -> bytes:
    """The answer to :func:`ask_values`, from all ``values`` that it asks for; others' bytes are zero."""
    return ask_values(mask) + _values(values, mask)


def all_values_value(values: Mapping[Value, float]) -> bytes:
    """The answer to GET_VALUES."""
    return bytes((Say.GET_VALUES,)) + _values(values, ~0)


def values_of(payload: bytes) -> dict[Value, float]:
    """What an answer to :func:`ask_values` tells.

    Firmware that does not know a bit leaves its value out: those at the end may be missing. Raises CodecError.
    """
    mask = mask_in(payload)
    if mask < 0:
        raise CodecError("values: another packet")
    result: dict[Value, float] = {}
    at = _MASK.size
    for value in Value:
        if not mask >> value & 1:
            continue
        size, scale = _LAYOUT[value]
        if at == len(payload) and value is Value.STATUS:
            break
        if at + size > len(payload):
            raise CodecError(f"values: {len(payload)} bytes are too few for the mask 0x{mask:08X}")
        if size in _ONE_NUMBER:
            result[value] = int.from_bytes(payload[at : at + size], "big", signed=size > 1) / scale
        at += size
    if at != len(payload):
        raise CodecError(f"values: {len(payload)} bytes are too many for the mask 0x{mask:08X}")
    return result


def _values(values: Mapping[Value, float], mask: int) -> bytes:
    pieces = []
    for value, (size, scale) in _LAYOUT.items():
        if mask >> value & 1:
            most = min((1 << 8 * size - (size > 1)) - 1, _I32)
            number = int(min(max(values.get(value, 0.0) * scale, -most - 1 if size > 1 else 0), most))
            pieces.append(number.to_bytes(size, "big", signed=size > 1))
    return b"".join(pieces)


def forwarded(payload: bytes, node: int | None) -> bytes:
    """A payload for the controller ``node`` on the drive's CAN bus; for the drive itself where that is None."""
    if node is None:
        return payload
    if not 0 <= node <= NODE_MAX:
        raise CodecError(f"controller id {node} is not in 0 to {NODE_MAX}")
    return bytes((Say.FORWARD_CAN, node)) + payload


def unforwarded(payload: bytes) -> tuple[int | None, bytes]:
    """For whom a payload is (None: for the drive itself), and what it says to him."""
    if len(payload) > 2 and payload[0] == Say.FORWARD_CAN:
        return payload[1], payload[2:]
    return None, payload
