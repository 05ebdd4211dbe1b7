"""Answers of servos on a half-duplex line: Dynamixel, one by one and together, and Feetech."""

from collections.abc import Sequence
from random import Random

from norton_drivers.codecs import dynamixel, feetech
from norton_drivers.codecs.half_duplex import Answer

from .streams import StreamCodec

_LENGTH = 16  # bytes of a reading
_MISSED_CRC, _MISSED_SUM = 2.0**-16, 2.0**-8


class DynamixelLine:
    """Answers of random servos; ``together``: as a Fast Sync Read of one servo is answered."""

    def __init__(self, *, together: bool) -> None:
        self._stream = dynamixel.AnswerStream()
        self._stream.fast_length = _LENGTH
        self._together = together

    def message(self, random: Random) -> tuple[bytes, object]:
        answer = Answer(random.randrange(253), random.randrange(256), random.randbytes(_LENGTH))
        if self._together:
            return dynamixel.fast_block(answer, b"", 1), answer[:3]
        return dynamixel.status(*answer[:3]), answer[:3]

    def told(self, _wire: bytes) -> Sequence[object]:
        return []

    def hear(self, data: bytes) -> Sequence[object]:
        return [answer[:3] for answer in self._stream.feed(data)]

    def pause(self) -> None:
        """A stream knows no time."""

    def close(self) -> None:
        """Nothing is open."""

    @property
    def by_chance(self) -> float:
        return self._stream.packets.bad_checksums * _MISSED_CRC


class FeetechLine:
    """Answers of random servos. A sum of eight bits lets one damaged packet in 256 through."""

    def __init__(self) -> None:
        self._stream = feetech.AnswerStream()

    def message(self, random: Random) -> tuple[bytes, object]:
        answer = Answer(random.randrange(253), random.randrange(256), random.randbytes(_LENGTH))
        return feetech.Packet(*answer[:3]).encode(), answer[:3]

    def told(self, _wire: bytes) -> Sequence[object]:
        return []

    def hear(self, data: bytes) -> Sequence[object]:
        return [answer[:3] for answer in self._stream.feed(data)]

    def pause(self) -> None:
        """A stream knows no time."""

    def close(self) -> None:
        """Nothing is open."""

    @property
    def by_chance(self) -> float:
        return self._stream.packets.bad_checksums * _MISSED_SUM


def dynamixel_answers() -> StreamCodec:
    return StreamCodec("Dynamixel 2.0", "CRC-16: one damaged packet in 65536", lambda: DynamixelLine(together=False))


def dynamixel_together() -> StreamCodec:
    return StreamCodec("Dynamixel 2.0, fast", "CRC-16", lambda: DynamixelLine(together=True))


def feetech_answers() -> StreamCodec:
    return StreamCodec("Feetech", "a sum of 8 bits: one damaged packet in 256", FeetechLine)
