"""Modbus RTU, the part that reads holding registers: questions and answers to bytes and back.

A frame is station, function, data and CRC-16/MODBUS, low byte first; registers have 16 bits, high byte first. Nothing
but silence marks where a frame begins, and silence does not survive adapters and operating systems: an answer is told
by the question that it must fit and by its CRC. Sources: "MODBUS Application Protocol Specification V1.1b3", sections
6.3 and 7; "MODBUS over Serial Line Specification and Implementation Guide V1.02", section 2.5.1.
"""

from dataclasses import dataclass
from struct import Struct, error
from typing import Final, Self

from norton_drivers.codecs.common import CodecError, crc16_modbus

READ_HOLDING_REGISTERS: Final = 3
STATION_MAX: Final = 247
EXCEPTION_FLAG: Final = 0x80
REQUEST_LENGTH: Final = 8

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3

_EXCEPTION_WORDS: Final = {
    ILLEGAL_FUNCTION: "illegal function",
    ILLEGAL_ADDRESS: "illegal data address",
    ILLEGAL_VALUE: "illegal data value",
    4: "device failure",
    5: "acknowledged, still at it",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not respond",
}
_REQUEST = Struct(">BBHH")
_CRC_LENGTH = 2
_EXCEPTION_LENGTH = 5


def describe_exception(code: int) -> str:
    """An exception code in words."""
    return f"exception {code:02d}, {_EXCEPTION_WORDS.get(code, 'unknown')}"


def silence_s(baud: int) -> float:
    """How long the line must be silent between two frames [s]: 3.5 characters of 11 bits, above 19200 baud 1.75 ms."""
    return 1.75e-3 if baud > 19_200 else 3.5 * 11 / baud


def with_crc(frame: bytes) -> bytes:
    """The frame as it goes on the line."""
    return frame + crc16_modbus(frame).to_bytes(2, "little")


def is_sound(frame: bytes | bytearray) -> bool:
    """Whether a frame as it came from the line ends in its own CRC."""
    return len(frame) > _CRC_LENGTH and crc16_modbus(frame[:-2]) == int.from_bytes(frame[-2:], "little")


@dataclass(frozen=True, slots=True)
class ReadRequest:
    """Asks ``station`` for ``count`` registers from ``register`` on."""

    station: int
    register: int
    count: int

    def encode(self) -> bytes:
        """The eight bytes. Raises CodecError for what no frame can carry."""
        try:
            return with_crc(_REQUEST.pack(self.station, READ_HOLDING_REGISTERS, self.register, self.count))
        except error as reason:
            raise CodecError(f"Modbus request: {reason}") from reason

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        """Exactly one request. Raises CodecError."""
        if len(data) != REQUEST_LENGTH or not is_sound(data):
            raise CodecError("Modbus request: not eight bytes with their CRC")
        station, function, register, count = _REQUEST.unpack_from(data)
        if function != READ_HOLDING_REGISTERS:
            raise CodecError(f"Modbus request: function {function} is not {READ_HOLDING_REGISTERS}")
        return cls(station, register, count)


@dataclass(frozen=True, slots=True)
class ReadAnswer:
    """The registers' bytes, high byte first."""

    station: int
    data: bytes

    def encode(self) -> bytes:
        """Raises CodecError for more registers than an answer can carry."""
        if len(self.data) % 2 or not 2 <= len(self.data) <= 250:
            raise CodecError("Modbus answer: 1 to 125 registers, not " + f"{len(self.data)} bytes")
        return with_crc(bytes((self.station, READ_HOLDING_REGISTERS, len(self.data))) + self.data)


@dataclass(frozen=True, slots=True)
class Refusal:
    """What a station answers where it cannot do what was asked."""

    station: int
    code: int
    function: int = READ_HOLDING_REGISTERS

    def encode(self) -> bytes:
        return with_crc(bytes((self.station, self.function | EXCEPTION_FLAG, self.code)))


class AnswerStream:
    """Finds the answer to one question in a byte stream; what it finds does not depend on how the stream is cut.

    ``discarded_bytes`` counts bytes that belong to no answer that was waited for: noise, the echo of a two-wire line,
    what other stations say, answers that came too late.
    """

    def __init__(self) -> None:
        self.discarded_bytes = 0
        self._expected: _Expected | None = None
        self._buffer = bytearray()

    @property
    def pending_bytes(self) -> int:
        """How many bytes were fed after the last answer."""
        return len(self._buffer)

    def expect(self, request: ReadRequest) -> None:
        """From now on look for the answer to ``request``; whatever came before is none."""
        self._discard(len(self._buffer))
        self._expected = _Expected(request)

    def feed(self, data: bytes) -> ReadAnswer | Refusal | None:
        """The answer, where ``data`` completes it. Never raises."""
        self._buffer += data
        if self._expected is None:
            self._discard(len(self._buffer))
        while self._expected is not None and self._buffer:
            answer, length = self._expected.at_start(self._buffer)
            if answer is not None:
                del self._buffer[:length]
                self._expected = None
                return answer
            if length > len(self._buffer):
                break
            self._discard(1)
        return None

    def _discard(self, count: int) -> None:
        self.discarded_bytes += count
        del self._buffer[:count]


class _Expected:
    """How the answer to a request can look."""

    def __init__(self, request: ReadRequest) -> None:
        size = 2 * request.count
        self._station = request.station
        self._answer_head = bytes((request.station, READ_HOLDING_REGISTERS, size))
        self._answer_length = 3 + size + _CRC_LENGTH
        self._refusal_head = bytes((request.station, READ_HOLDING_REGISTERS | EXCEPTION_FLAG))

    def at_start(self, buffer: bytearray) -> tuple[ReadAnswer | Refusal | None, int]:
        """The answer that ``buffer`` begins with; and the length of what it may begin with, 0 where it is none."""
        if self._answer_head.startswith(buffer[:3]):
            length = self._answer_length
            if len(buffer) < length:
                return None, length
            if is_sound(buffer[:length]):
                return ReadAnswer(self._station, bytes(buffer[3 : length - _CRC_LENGTH])), length
        elif self._refusal_head.startswith(buffer[:2]):
            length = _EXCEPTION_LENGTH
            if len(buffer) < length:
                return None, length
            if is_sound(buffer[:length]):
                return Refusal(self._station, buffer[2]), length
        return None, 0
