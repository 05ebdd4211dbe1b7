"""VESC packets: what does not fit into one CAN frame, cut into frames and put together again.

A packet of up to six bytes goes in one frame, PROCESS_SHORT_BUFFER; longer ones go piece by piece, each with its
offset, and are closed by PROCESS_RX_BUFFER with length and checksum (CRC-16/XMODEM). Source: vedderb/bldc,
comm/comm_can.c (``comm_can_send_buffer``, ``decode_msg``), comm/commands.c (``COMM_FW_VERSION``,
``COMM_GET_VALUES_SELECTIVE``).
"""

from binascii import crc_hqx
from collections.abc import Iterator
from enum import IntEnum
from struct import Struct
from typing import NamedTuple

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc import Packet, arbitration_id

LONGEST = 512  # PACKET_MAX_PL_LEN
_SHORT = 6
_LAST_SHORT_OFFSET = 255
_CLOSING = Struct(">BBHH")
_SELECTED = Struct(">BI")


class Handling(IntEnum):
    """What the receiver is to do with a packet."""

    ANSWER = 0
    TAKE = 1  # it is an answer


class PacketKind(IntEnum):
    """A packet's first byte."""

    FW_VERSION = 0
    GET_VALUES_SELECTIVE = 50


FAULT_CODE = 1 << 15  # the bit that selects it in GET_VALUES_SELECTIVE


class Frame(NamedTuple):
    """One frame of a packet."""

    arbitration_id: int
    data: bytes


class Received(NamedTuple):
    """A packet put together: who sent it, what is to be done with it, and its bytes."""

    sender: int
    handling: int
    payload: bytes


def frames_of(payload: bytes, *, sender: int, receiver: int, handling: int) -> Iterator[Frame]:
    """The frames that carry a packet. Raises CodecError for one that is empty or too long."""
    if not 0 < len(payload) <= LONGEST:
        raise CodecError(f"packet: {len(payload)} bytes where 1 to {LONGEST} can be sent")
    if len(payload) <= _SHORT:
        identifier = arbitration_id(Packet.PROCESS_SHORT_BUFFER, receiver)
        yield Frame(identifier, bytes((sender, handling)) + payload)
        return
    yield from _pieces(payload, receiver)
    closing = _CLOSING.pack(sender, handling, len(payload), crc_hqx(payload, 0))
    yield Frame(arbitration_id(Packet.PROCESS_RX_BUFFER, receiver), closing)


def _pieces(payload: bytes, receiver: int) -> Iterator[Frame]:
    at = 0
    while at < len(payload) and at <= _LAST_SHORT_OFFSET:
        data = bytes((at,)) + payload[at : at + 7]
        yield Frame(arbitration_id(Packet.FILL_RX_BUFFER, receiver), data)
        at += 7
    while at < len(payload):
        data = at.to_bytes(2, "big") + payload[at : at + 6]
        yield Frame(arbitration_id(Packet.FILL_RX_BUFFER_LONG, receiver), data)
        at += 6


class Assembler:
    """Puts the frames addressed to one receiver together. ``malformed`` counts what could not be."""

    def __init__(self) -> None:
        self.malformed = 0
        self._pieces: dict[int, bytes] = {}

    def feed(self, packet: int, data: bytes | bytearray) -> Received | None:
        """The packet that this frame completes, if it does; other frames than a packet's are passed over."""
        match packet:
            case Packet.FILL_RX_BUFFER if len(data) >= 2:
                self._keep(data[0], data[1:])
            case Packet.FILL_RX_BUFFER_LONG if len(data) >= 3:
                self._keep(int.from_bytes(data[:2], "big"), data[2:])
            case Packet.PROCESS_RX_BUFFER if len(data) >= _CLOSING.size:
                return self._close(*_CLOSING.unpack_from(data))
            case Packet.PROCESS_SHORT_BUFFER if len(data) > 2:
                return Received(data[0], data[1], bytes(data[2:]))
            case (
                Packet.FILL_RX_BUFFER
                | Packet.FILL_RX_BUFFER_LONG
                | Packet.PROCESS_RX_BUFFER
                | Packet.PROCESS_SHORT_BUFFER
            ):
                self.malformed += 1
        return None

    def _keep(self, offset: int, piece: bytes | bytearray) -> None:
        if offset == 0:
            self._pieces.clear()
        if offset + len(piece) <= LONGEST:
            self._pieces[offset] = bytes(piece)

    def _close(self, sender: int, handling: int, length: int, checksum: int) -> Received | None:
        payload = b""
        while (piece := self._pieces.pop(len(payload), b"")) and len(payload) < length:
            payload += piece
        self._pieces.clear()
        if len(payload) != length or not length or crc_hqx(payload, 0) != checksum:
            self.malformed += 1
            return None
        return Received(sender, handling, payload)


def ask_fault() -> bytes:
    """The packet that asks for the fault code alone: it and its answer take one frame each."""
    return _SELECTED.pack(PacketKind.GET_VALUES_SELECTIVE, FAULT_CODE)


def fault_value(code: int) -> bytes:
    """The answer to :func:`ask_fault`."""
    return ask_fault() + bytes((code,))


def fault_of(payload: bytes) -> int:
    """The fault code in an answer. Raises CodecError for another answer."""
    if payload[:-1] != ask_fault():
        raise CodecError("fault code: another packet")
    return payload[-1]


def ask_version() -> bytes:
    """The packet that asks for firmware and hardware."""
    return bytes((PacketKind.FW_VERSION,))


def version_value(major: int, minor: int, hardware: str, uuid: bytes = bytes(12)) -> bytes:
    """The answer to :func:`ask_version`, as firmware 5 and later give it."""
    return bytes((PacketKind.FW_VERSION, major, minor)) + hardware.encode() + b"\0" + uuid + bytes(4)


def version_of(payload: bytes) -> tuple[int, int, str]:
    """Firmware (major, minor) and the hardware's name. Raises CodecError for another answer."""
    if len(payload) < 3 or payload[0] != PacketKind.FW_VERSION:
        raise CodecError("version: another packet")
    return payload[1], payload[2], payload[3:].partition(b"\0")[0].decode("ascii", "replace")
