"""What all codecs share: their one error, the resolution of their floats, and cyclic redundancy checks."""

from binascii import crc_hqx
from math import frexp, ldexp
from typing import Final


class CodecError(ValueError):
    """Bytes that are no message, or a value that no message can carry."""


_FLOAT32_BITS: Final = 24


def float32_step(value: float) -> float:
    """How far apart float32 numbers are near ``value``."""
    _, exponent = frexp(value)
    return ldexp(1.0, exponent - _FLOAT32_BITS)


# binascii's CRC-16 runs most significant bit first and X-25 runs least significant bit first: the same polynomial
# (0x1021) over mirrored bytes gives the mirrored remainder, eight times faster than a table in Python.
_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_MODBUS_POLYNOMIAL: Final = 0xA001  # 0x8005 mirrored


def crc16_x25(data: bytes | bytearray) -> int:
    """CRC-16/X-25 (CRC-16/IBM-SDLC): polynomial 0x1021 reflected, start 0xFFFF, complemented at the end."""
    remainder = crc_hqx(data.translate(_MIRRORED), 0xFFFF) ^ 0xFFFF
    return _MIRRORED[remainder & 0xFF] << 8 | _MIRRORED[remainder >> 8]


def crc16_modbus(data: bytes | bytearray) -> int:
    """CRC-16/MODBUS: polynomial 0x8005 reflected, start 0xFFFF. It is sent low byte first."""
    remainder = 0xFFFF
    for byte in data:
        remainder = remainder >> 8 ^ _MODBUS[remainder & 0xFF ^ byte]
    return remainder


def crc16_8005(data: bytes | bytearray) -> int:
    """CRC-16/UMTS (CRC-16/BUYPASS): polynomial 0x8005, start 0. Dynamixel sends it low byte first."""
    # The same polynomial over mirrored bytes, least significant bit first, gives the mirrored remainder.
    remainder = 0
    for byte in data.translate(_MIRRORED):
        remainder = remainder >> 8 ^ _MODBUS[remainder & 0xFF ^ byte]
    return _MIRRORED[remainder & 0xFF] << 8 | _MIRRORED[remainder >> 8]


def _remainder_of(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (_MODBUS_POLYNOMIAL if byte & 1 else 0)
    return byte


_NYBBLES_97: Final = (0x00, 0x97, 0xB9, 0x2E, 0xE5, 0x72, 0x5C, 0xCB, 0x5D, 0xCA, 0xE4, 0x73, 0xB8, 0x2F, 0x01, 0x96)


def crc8_97(data: bytes | bytearray) -> int:
    """CRC-8 with the polynomial 0x97, start 0, as mjbots' serial lines have it (moteus, docs/integration/uart.md)."""
    remainder = 0
    for byte in data:
        remainder = _NYBBLES_97[remainder >> 4 ^ byte >> 4] ^ remainder << 4 & 0xFF
        remainder = _NYBBLES_97[remainder >> 4 ^ byte & 0xF] ^ remainder << 4 & 0xFF
    return remainder


_MODBUS: Final = tuple(_remainder_of(byte) for byte in range(256))
