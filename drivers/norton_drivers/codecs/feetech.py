"""The protocol of Feetech's STS, SMS and SCS servos: packets to bytes and back, for either end of the line.

A packet is FF FF, the id, the length of what follows, an instruction (of a question) or the error byte (of an answer),
parameters, and the complement of the sum of all bytes after FF FF. That is Dynamixel's Protocol 1.0 with a Sync Read.
STS and SMS servos have the low byte of a number first, SCS servos the high byte; a negative number is its magnitude
with a bit for the sign. Sources: Feetech, "Communication Protocol User Manual" (packet, instructions, checksum);
feetech-servo-sdk 1.0, scservo_sdk/protocol_packet_handler.py and scservo_def.py (error bits, byte order, signs).
"""

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Final, Literal, NamedTuple

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.half_duplex import Answer

NODE_MAX: Final = 252
BROADCAST: Final = 0xFE
HEADER: Final = b"\xff\xff"
OVERHEAD: Final = 6  # of a packet without parameters
PARAMETERS_MAX: Final = 250 - OVERHEAD

Order = Literal["little", "big"]


class Instruction(IntEnum):
    """Those that are used here."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


_ERRORS: Final = {
    0: "supply voltage out of its limits",
    1: "angle sensor failed",
    2: "overheating",
    3: "overcurrent",
    5: "overload",
}


def describe_error(code: int) -> tuple[str, ...]:
    """The bits of an answer's error byte in words."""
    return tuple(_ERRORS.get(bit, f"error bit {bit}") for bit in range(8) if code >> bit & 1)


def signed(number: int, sign_bit: int) -> int:
    """A number as it is from its magnitude with a bit for the sign."""
    magnitude = number & ((1 << sign_bit) - 1)
    return -magnitude if number >> sign_bit & 1 else magnitude


def with_sign(value: int, sign_bit: int) -> int:
    """The reverse. Raises CodecError for what the magnitude cannot hold."""
    if abs(value) >= 1 << sign_bit:
        raise CodecError(f"Feetech number: {value} has no room below bit {sign_bit}")
    return abs(value) | (value < 0) << sign_bit


class Packet(NamedTuple):
    """``code`` is an instruction or an error byte; ``later_bytes`` came after it in the same chunk."""

    node: int
    code: int
    parameters: bytes = b""
    later_bytes: int = 0

    def encode(self) -> bytes:
        """The bytes of it. Raises CodecError for what no packet can carry."""
        if not (0 <= self.node <= BROADCAST and 0 <= self.code <= 0xFF and len(self.parameters) <= PARAMETERS_MAX):
            raise CodecError(f"Feetech packet: id {self.node}, {self.code}, {len(self.parameters)} parameters")
        body = bytes((self.node, len(self.parameters) + 2, self.code)) + self.parameters
        return HEADER + body + bytes((checksum(body),))


def checksum(body: bytes | bytearray) -> int:
    """Of all between FF FF and itself."""
    return ~sum(body) & 0xFF


class Dialect:
    """The protocol as a master speaks it."""

    overhead: int = OVERHEAD

    def __init__(self, *, reads_together: bool = True) -> None:
        self.reads_together = reads_together
        self._answers = AnswerStream()

    def answers(self) -> "AnswerStream":
        """The one stream of this line."""
        return self._answers

    def ping(self, node: int) -> bytes:
        """A servo answers with its error byte alone."""
        return self._asked(Packet(node, Instruction.PING))

    def read(self, node: int, address: int, length: int) -> bytes:
        return self._asked(Packet(node, Instruction.READ, bytes((address, length))))

    def sync_read(self, address: int, length: int, nodes: Sequence[int]) -> bytes:
        if not self.reads_together:  # it is asked of one alone
            return self.read(nodes[0], address, length)
        return Packet(BROADCAST, Instruction.SYNC_READ, bytes((address, length, *nodes))).encode()

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> bytes:
        length = len(next(iter(values.values())))
        data = b"".join(bytes((node,)) + value for node, value in values.items())
        return Packet(BROADCAST, Instruction.SYNC_WRITE, bytes((address, length)) + data).encode()

    def _asked(self, packet: Packet) -> bytes:
        # The echo of an adapter whose two wires are one looks like an answer.
        self._answers.echo = packet
        return packet.encode()


class PacketStream:
    """Finds packets in a byte stream; what it finds does not depend on how the stream is cut.

    ``discarded_bytes`` counts those that belong to none, ``bad_checksums`` the packets whose checksum was wrong.
    """

    def __init__(self) -> None:
        self.discarded_bytes = 0
        self.bad_checksums = 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that ``data`` completes, oldest first. Never raises."""
        self._buffer += data
        packets: list[Packet] = []
        while (length := self._first_length()) <= len(self._buffer):
            body = self._buffer[2 : length - 1]
            if checksum(body) == self._buffer[length - 1]:
                del self._buffer[:length]
                packets.append(Packet(body[0], body[2], bytes(body[3:]), len(self._buffer)))
            else:
                self.bad_checksums += 1
                self._discard(1)
        return packets

    def drop(self) -> None:
        """Forget the packet that has begun."""
        self._discard(len(self._buffer))

    def _first_length(self) -> int:
        """The length of the packet that the buffer begins with, after what cannot begin one is discarded; more than it
        holds, where that is not known yet."""
        while self._buffer:
            start = self._buffer.find(HEADER)
            kept = 1 if self._buffer[-1] == HEADER[0] else 0
            self._discard(start if start >= 0 else len(self._buffer) - kept)
            if start < 0 or len(self._buffer) < 4:
                break
            if self._buffer[2] <= BROADCAST and 2 <= self._buffer[3] <= PARAMETERS_MAX + 2:
                return self._buffer[3] + 4
            self._discard(1)
        return len(self._buffer) + 1

    def _discard(self, count: int) -> None:
        self.discarded_bytes += count
        del self._buffer[:count]


class AnswerStream:
    """The answers of servos in a byte stream. ``echo`` is the question that may come back as it was sent."""

    def __init__(self) -> None:
        self.packets = PacketStream()
        self.echo: Packet | None = None

    def feed(self, data: bytes) -> list[Answer]:
        """The answers that ``data`` completes, oldest first. Never raises."""
        return [
            Answer(packet.node, packet.code, packet.parameters, packet.later_bytes)
            for packet in self.packets.feed(data)
            if packet.node <= NODE_MAX and (self.echo is None or packet[:3] != self.echo[:3])
        ]

    def drop(self) -> None:
        """Forget what has begun."""
        self.packets.drop()
