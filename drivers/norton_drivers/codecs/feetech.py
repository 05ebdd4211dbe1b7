"""The protocol of Feetech's STS, SMS and SCS servos: packets to bytes and back, for either end of the line.

A packet is FF FF, the id, the length of what follows, an instruction (of a question) or the error byte (of an answer),
parameters, and the complement of the sum of all bytes after FF FF. That is Dynamixel's Protocol 1.0 with a Sync Read.
STS and SMS servos have the low byte of a number first, SCS servos the high byte; a negative number is its magnitude
with a bit for the sign. Sources: Feetech, "Communication Protocol User Manual" (packet, instructions, checksum);
feetech-servo-sdk 1.0, scservo_sdk/protocol_packet_handler.py and scservo_def.py (error bits, byte order, signs).
"""

from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum
from typing import Final, Literal, NamedTuple

from norton_drivers.codecs import half_duplex
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


def checksum(body: bytes) -> int:
    """Of all between FF FF and itself."""
    return ~sum(body) & 0xFF


class Dialect:
    """The protocol as a master speaks it."""

    overhead: int = OVERHEAD

    def __init__(self, *, reads_together: bool = True) -> None:
        self.reads_together = reads_together
        self._answers = AnswerStream()

    def answers(self) -> "AnswerStream":
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


class PacketStream(half_duplex.PacketStream[Packet]):
    """Finds packets in a byte stream."""

    header = HEADER
    head_bytes = 4

    def _length(self, head: bytearray) -> int | None:
        return head[3] + 4 if head[2] <= BROADCAST and 2 <= head[3] <= PARAMETERS_MAX + 2 else None

    def _unpacked(self, frame: bytes, later_bytes: int) -> Packet | None:
        body = frame[2:-1]
        return Packet(body[0], body[2], body[3:], later_bytes) if checksum(body) == frame[-1] else None


class AnswerStream(half_duplex.AnswerStream[Packet]):
    """The answers of servos in a byte stream. ``echo`` is the question that may come back as it was sent."""

    def __init__(self) -> None:
        super().__init__(PacketStream())
        self.echo: Packet | None = None

    def _answers_in(self, packet: Packet) -> Iterator[Answer]:
        if packet.node <= NODE_MAX and (self.echo is None or packet[:3] != self.echo[:3]):
            yield Answer(*packet)
