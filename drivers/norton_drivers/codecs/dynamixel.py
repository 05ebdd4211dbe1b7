"""Dynamixel Protocol 2.0: packets to bytes and back, for either end of the line.

A packet is FF FF FD 00, the id, the length of what follows (two bytes), the instruction, its parameters, and a CRC-16
over all before it. Where FF FF FD occurs among instruction and parameters, another FD is put behind it. Numbers have
their low byte first. An answer's instruction is 55h, and its first parameter the error byte.

The answer to a Fast Sync Read is one packet of all servos asked, under the id FEh, nothing stuffed: error, id, data and
a CRC-16 over all bytes so far from the first to the last servo, each of which sends its own part. Sources: ROBOTIS
e-Manual, "DYNAMIXEL Protocol 2.0", sections 2 to 5, and "CRC Calculation"; ROBOTIS-GIT/DynamixelSDK 4.1,
python/src/dynamixel_sdk/protocol2_packet_handler.py and group_sync_read.py.
"""

from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum
from struct import Struct, error
from typing import Final, NamedTuple

from norton_drivers.codecs import half_duplex
from norton_drivers.codecs.common import CodecError, crc16_8005
from norton_drivers.codecs.half_duplex import Answer

NODE_MAX: Final = 252
BROADCAST: Final = 0xFE
HEADER: Final = b"\xff\xff\xfd\x00"
HEAD_BYTES: Final = 7  # header, id, length
CRC_BYTES: Final = 2
LEAST_LENGTH: Final = 3  # the instruction and the CRC
LONGEST: Final = 1024  # as the maker's own library has it

_HEAD = Struct("<4sBH")
_RANGE = Struct("<HH")
_TO_STUFF, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"


class Instruction(IntEnum):
    """Section 2.5 of the manual; those that are used here."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A


class Error(IntEnum):
    """The low seven bits of an answer's error byte, section 3.2; :data:`ALERT` is the other."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT: Final = 0x80  # the servo's hardware error status says why


class Packet(NamedTuple):
    """One packet, its parameters as they were before stuffing; ``later_bytes`` came after it in the same chunk."""

    node: int
    instruction: int
    parameters: bytes = b""
    later_bytes: int = 0

    def encode(self) -> bytes:
        """The bytes of it. Raises CodecError for what no packet can carry."""
        body = bytes((self.instruction,)) + self.parameters if 0 <= self.instruction <= 0xFF else b""
        body = body.replace(_TO_STUFF, _STUFFED)
        try:
            frame = _HEAD.pack(HEADER, self.node, len(body) + CRC_BYTES) + body
        except error as reason:
            raise CodecError(f"Dynamixel packet: {reason}") from reason
        if not body or HEAD_BYTES + len(body) + CRC_BYTES > LONGEST:
            raise CodecError(f"Dynamixel packet: {len(self.parameters)} parameters, instruction {self.instruction}")
        return frame + crc16_8005(frame).to_bytes(2, "little")


def status(node: int, error_byte: int, data: bytes = b"") -> bytes:
    """A servo's answer. Raises CodecError."""
    return Packet(node, Instruction.STATUS, bytes((error_byte,)) + data).encode()


def write(node: int, address: int, data: bytes) -> bytes:
    """Write these registers of one servo, which answers as its status return level says."""
    return Packet(node, Instruction.WRITE, address.to_bytes(2, "little") + data).encode()


def reboot(node: int) -> bytes:
    """The only way out of an error that shut the servo down."""
    return Packet(node, Instruction.REBOOT).encode()


class Dialect:
    """Protocol 2.0 as a master speaks it. ``fast``: servos are asked together by a Fast Sync Read."""

    overhead: int = HEAD_BYTES + 1 + 1 + CRC_BYTES
    reads_together: bool = True

    def __init__(self) -> None:
        self.fast = False
        self._answers = AnswerStream()

    def answers(self) -> "AnswerStream":
        return self._answers

    def ping(self, node: int) -> bytes:
        """A servo answers with its model number (2 bytes) and its firmware's version."""
        return Packet(node, Instruction.PING).encode()

    def read(self, node: int, address: int, length: int) -> bytes:
        return Packet(node, Instruction.READ, _RANGE.pack(address, length)).encode()

    def sync_read(self, address: int, length: int, nodes: Sequence[int]) -> bytes:
        self._answers.fast_length = length
        instruction = Instruction.FAST_SYNC_READ if self.fast else Instruction.SYNC_READ
        return Packet(BROADCAST, instruction, _RANGE.pack(address, length) + bytes(nodes)).encode()

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> bytes:
        length = len(next(iter(values.values())))
        data = b"".join(bytes((node,)) + value for node, value in values.items())
        return Packet(BROADCAST, Instruction.SYNC_WRITE, _RANGE.pack(address, length) + data).encode()


class PacketStream(half_duplex.PacketStream[Packet]):
    """Finds packets in a byte stream. No packet is longer than ``longest``."""

    header = HEADER
    head_bytes = HEAD_BYTES

    def __init__(self, longest: int = LONGEST) -> None:
        super().__init__()
        self._longest = longest

    def _length(self, head: bytearray) -> int | None:
        length = HEAD_BYTES + int.from_bytes(head[5:7], "little")
        return length if HEAD_BYTES + LEAST_LENGTH <= length <= self._longest else None

    def _unpacked(self, frame: bytes, later_bytes: int) -> Packet | None:
        if crc16_8005(frame[:-CRC_BYTES]) != int.from_bytes(frame[-CRC_BYTES:], "little"):
            return None
        node, body = frame[4], frame[HEAD_BYTES:-CRC_BYTES]
        if not (node == BROADCAST and body[0] == Instruction.STATUS):  # nothing is stuffed there
            body = body.replace(_STUFFED, _TO_STUFF)
        return Packet(node, body[0], body[1:], later_bytes)


class AnswerStream(half_duplex.AnswerStream[Packet]):
    """The answers of servos in a byte stream. ``fast_length`` is how long the data of each servo is in the answer to a
    Fast Sync Read."""

    LONGEST_ANSWER: Final = 256

    def __init__(self) -> None:
        super().__init__(PacketStream(self.LONGEST_ANSWER))
        self.fast_length = 0

    def _answers_in(self, packet: Packet) -> Iterator[Answer]:
        if packet.instruction != Instruction.STATUS or not packet.parameters:
            return
        if packet.node == BROADCAST:
            yield from fast_blocks(packet, self.fast_length)
        elif packet.node <= NODE_MAX:
            yield Answer(packet.node, packet.parameters[0], packet.parameters[1:], packet.later_bytes)


def fast_blocks(packet: Packet, length: int) -> Iterator[Answer]:
    """The answers to a Fast Sync Read of ``length`` bytes; none where the packet is no such answer."""
    size = 2 + length + CRC_BYTES
    # The last CRC is the packet's own.
    parameters = packet.parameters + bytes(CRC_BYTES)
    if len(parameters) % size:
        return
    for start in range(0, len(parameters), size):
        block = parameters[start : start + size]
        later = packet.later_bytes + len(parameters) - start - size
        if block[1] <= NODE_MAX:
            yield Answer(block[1], block[0], block[2 : 2 + length], later)


def fast_block(answer: Answer, before: bytes, count: int) -> bytes:
    """One servo's part of the answer of ``count`` servos to a Fast Sync Read; ``before`` is what the others sent."""
    block = bytes((answer.error, answer.node)) + answer.data
    if not before:
        length = 1 + count * (len(block) + CRC_BYTES)
        block = _HEAD.pack(HEADER, BROADCAST, length) + bytes((Instruction.STATUS,)) + block
    return block + crc16_8005(before + block).to_bytes(2, "little")


def fast_bytes(length: int, count: int) -> int:
    """How many bytes ``count`` servos answer to a Fast Sync Read of ``length`` bytes each."""
    return HEAD_BYTES + 1 + count * (2 + length + CRC_BYTES)
