"""mjlib's multiplex protocol: registers that are written, read and answered in one datagram, here a CAN FD frame.

An identifier is a prefix of 13 bits, the sender's byte, whose highest bit asks for a reply, and the receiver's byte. A
frame is a row of subframes: writes, reads and replies of registers that follow each other, as integers of 8, 16 or 32
bits or as floats; errors; fillers. Least significant byte first. Sources: mjbots/moteus, docs/protocol/can.md,
fw/fdcan_micro_server.h (identifier, fillers); mjbots/mjlib, mjlib/multiplex/micro_server.cc (subframes, errors).
"""

from collections.abc import Iterator, Sequence
from enum import IntEnum
from struct import Struct, error
from typing import Final, NamedTuple, Self

from norton_drivers.codecs.can_frames import STANDARD_MAX, padded
from norton_drivers.codecs.common import CodecError

NODE_MAX: Final = 0x7E
BROADCAST: Final = 0x7F
PREFIX_MAX: Final = 0x1FFF
FILLER: Final = 0x50
_WANTS_REPLY: Final = 0x80
_CODES: Final = "bhif"


class Resolution(IntEnum):
    """How a register's value is written."""

    INT8 = 0
    INT16 = 1
    INT32 = 2
    FLOAT = 3


class Address(NamedTuple):
    """Who sends a frame to whom. ``asks``: a reply is wanted."""

    source: int
    destination: int
    asks: bool = False
    prefix: int = 0

    @property
    def identifier(self) -> int:
        return self.prefix << 16 | (_WANTS_REPLY * self.asks | self.source) << 8 | self.destination

    @property
    def extended(self) -> bool:
        """Whether the identifier needs 29 bits."""
        return self.identifier > STANDARD_MAX

    @classmethod
    def of(cls, identifier: int) -> Self:
        source = identifier >> 8 & 0xFF
        return cls(source & ~_WANTS_REPLY, identifier & 0xFF, bool(source & _WANTS_REPLY), identifier >> 16)


class Kind(IntEnum):
    """What is done with registers."""

    WRITE = 0x00
    READ = 0x10
    REPLY = 0x20


class Subframe(NamedTuple):
    """``size`` registers from ``register`` on; ``raw`` are their values as they stand there, none in a read."""

    kind: Kind
    register: int
    resolution: Resolution
    size: int
    raw: tuple[float, ...] = ()

    def encode(self) -> bytes:
        """Raises CodecError for what its resolution cannot say."""
        first = self.kind | self.resolution << 2
        head = bytes((first | self.size,)) if self.size <= 3 else bytes((first,)) + _varuint(self.size)
        try:
            values = Struct(f"<{len(self.raw)}{_CODES[self.resolution]}").pack(*self.raw)
        except (error, OverflowError) as wrong:
            raise CodecError(f"register 0x{self.register:03X}: {wrong}") from wrong
        return head + _varuint(self.register) + values


class Refusal(NamedTuple):
    """A register that could not be written, or read. ``reason``: 1 unknown, 2 not for that."""

    written: bool
    register: int
    reason: int

    def encode(self) -> bytes:
        return bytes((_WRITE_ERROR if self.written else _READ_ERROR,)) + _varuint(self.register) + _varuint(self.reason)


_WRITE_ERROR, _READ_ERROR = 0x30, 0x31


def subframes(data: bytes | bytearray) -> Iterator[Subframe | Refusal]:
    """One after the other. Raises CodecError at the first that is cut short or unknown."""
    at, end = 0, len(data)
    while at < end:
        first = data[at]
        at += 1
        if first == FILLER:
            continue
        if first in (_WRITE_ERROR, _READ_ERROR):
            register, at = _read_varuint(data, at)
            reason, at = _read_varuint(data, at)
            yield Refusal(first == _WRITE_ERROR, register, reason)
            continue
        if first >= Kind.REPLY + 0x10:
            raise CodecError(f"unknown subframe 0x{first:02X}")
        count = first & 0x03
        if not count:
            count, at = _read_varuint(data, at)
        register, at = _read_varuint(data, at)
        kind, resolution = Kind(first & 0xF0), Resolution(first >> 2 & 0x03)
        if kind is Kind.READ:
            yield Subframe(kind, register, resolution, count)
            continue
        size = count * _SIZES[resolution]
        if size > end - at:
            raise CodecError("subframe: cut short")
        raw = Struct(f"<{count}{_CODES[resolution]}").unpack_from(data, at)
        at += size
        yield Subframe(kind, register, resolution, count, raw)


_SIZES: Final = (1, 2, 4, 4)


def _varuint(value: int) -> bytes:
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*encoded, value))


def _read_varuint(data: bytes | bytearray, at: int) -> tuple[int, int]:
    """The value, and where it ends."""
    value = 0
    for place, byte in enumerate(data[at : at + 5]):
        value |= (byte & 0x7F) << 7 * place
        if byte < 0x80:
            return value, at + place + 1
    raise CodecError("number: cut short")


def frame(parts: Sequence[Subframe | Refusal]) -> bytes:
    """As a CAN FD frame carries them. Raises CodecError where they are too many."""
    return padded(b"".join(part.encode() for part in parts), FILLER)


def read(register: int, resolution: Resolution, count: int = 1) -> Subframe:
    """The question for some registers."""
    return Subframe(Kind.READ, register, resolution, count)


def write(register: int, resolution: Resolution, *values: float) -> Subframe:
    """Some registers' new values, as they stand there."""
    return Subframe(Kind.WRITE, register, resolution, len(values), values)
