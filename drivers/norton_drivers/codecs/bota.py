"""Bota Systems force-torque sensors, binary serial format: bytes to frames and back, fed in pieces of any size.

A frame is 0xAA, 34 bytes little-endian (status u16, Fx Fy Fz Mx My Mz f32, time u32 [µs], temperature f32) and a
CRC-16/X-25 of those 34 bytes, low byte first. Nothing marks the frame's start but the byte 0xAA, which also occurs
inside frames, so that only a matching CRC tells a frame. Sources: Bota Systems, "Rokubi / SensONE serial
communication"; the maker's published driver ``rokubimini_serial``, which names the status bits below.
"""

from math import isfinite
from struct import Struct
from typing import Final, NamedTuple, Self

from norton_drivers.codecs.common import CodecError, crc16_x25

HEADER: Final = 0xAA
BAUD: Final = 460_800
FRAME_LENGTH: Final = 37

_STATUS_WORDS: Final = (
    (1 << 0, "it skips measurements: set a longer filter in the sensor"),
    (1 << 1, "its range is exceeded"),
    (1 << 2, "its measurements are invalid: it may be damaged"),
    (1 << 3, "its measurements are raw: it has no calibration"),
)
_STATUS_BITS_KNOWN: Final = sum(bit for bit, _ in _STATUS_WORDS)

_PAYLOAD = Struct("<H6fIf")
_CRC = Struct("<H")
_FRAME = Struct("<xH6fIfH")


def describe_status(status: int) -> tuple[str, ...]:
    """A frame's status in words, lowest bit first; empty where all is well."""
    words = tuple(text for bit, text in _STATUS_WORDS if status & bit)
    unknown = status & ~_STATUS_BITS_KNOWN
    return (*words, f"unknown status bits 0x{unknown:04X}") if unknown else words


class BotaFrame(NamedTuple):
    """One sample: status bits, forces [N], torques [N m], the sensor's clock [µs, wraps at 2^32], temperature."""

    status: int
    force_x_n: float
    force_y_n: float
    force_z_n: float
    torque_x_nm: float
    torque_y_nm: float
    torque_z_nm: float
    timestamp_us: int
    temperature_c: float

    def encode(self) -> bytes:
        """The 37 bytes. Raises CodecError where a value does not fit its field."""
        try:
            payload = _PAYLOAD.pack(*self)
        except (OverflowError, ValueError) as error:
            raise CodecError(f"Bota frame: {error}") from error
        return b"\xaa" + payload + _CRC.pack(crc16_x25(payload))

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        """Exactly one frame. Raises CodecError for a wrong length, header or CRC."""
        if len(data) != FRAME_LENGTH or data[0] != HEADER:
            raise CodecError("Bota frame: not 37 bytes that begin with 0xAA")
        *fields, crc = _FRAME.unpack(data)
        if crc16_x25(data[1:-2]) != crc:
            raise CodecError("Bota frame: CRC does not match")
        return cls(*fields)

    @property
    def finite(self) -> bool:
        """Whether all forces and torques are numbers."""
        return isfinite(
            self.force_x_n + self.force_y_n + self.force_z_n + self.torque_x_nm + self.torque_y_nm + self.torque_z_nm
        )


class BotaStream:
    """Finds frames in a byte stream; what it finds does not depend on how the stream is cut.

    ``discarded_bytes`` counts bytes that belong to no frame; ``crc_errors`` counts stretches of 37 bytes that began
    like a frame and were none; ``pending_bytes`` counts those fed after the last complete frame.
    """

    def __init__(self) -> None:
        self.discarded_bytes = 0
        self.crc_errors = 0
        self.pending_bytes = 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[BotaFrame]:
        """The frames completed by ``data``, oldest first. Never raises."""
        buffer = self._buffer
        buffer += data
        frames: list[BotaFrame] = []
        start = 0  # of what is still to be looked at
        while (header := buffer.find(HEADER, start)) >= 0:
            self.discarded_bytes += header - start
            start = header
            if start + FRAME_LENGTH > len(buffer):
                break
            *fields, crc = _FRAME.unpack_from(buffer, start)
            if crc16_x25(buffer[start + 1 : start + FRAME_LENGTH - 2]) == crc:
                frames.append(BotaFrame._make(fields))
                start += FRAME_LENGTH
            else:
                # A frame may begin inside what was taken for one: give up one byte only.
                self.crc_errors += 1
                self.discarded_bytes += 1
                start += 1
        else:  # no frame can begin in what is left
            self.discarded_bytes += len(buffer) - start
            start = len(buffer)
        del buffer[:start]
        self.pending_bytes = len(buffer)
        return frames
