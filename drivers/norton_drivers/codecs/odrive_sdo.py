"""Any parameter of an ODrive with firmware 0.6, read and written by its endpoint number.

Source: ODrive manual, "CAN Protocol", RxSdo and TxSdo.
"""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import ClassVar, Self

from norton_drivers.codecs.odrive import MessageId, check_length, pack_float

_SDO = Struct("<BHx4s")
_U32 = Struct("<I")
_F32 = Struct("<f")


class SdoOpcode(IntEnum):
    READ = 0
    WRITE = 1


# Endpoint numbers differ between boards and firmware revisions: these are those of one published list of firmware
# 0.6. A board's own stand in the flat_endpoints.json that ODrive publishes for it.
ENDPOINT_WATCHDOG_TIMEOUT = 200  # axis0.config.watchdog_timeout, f32 [s]
ENDPOINT_ENABLE_WATCHDOG = 201  # axis0.config.enable_watchdog, bool


def f32_value(number: float) -> bytes:
    """The four value bytes of a float parameter."""
    return pack_float(_F32, "parameter", number)


def f32_of(value: bytes) -> float:
    """The float in four value bytes."""
    return float(_F32.unpack(value)[0])


def u32_value(number: int) -> bytes:
    """The four value bytes of an unsigned (or boolean) parameter."""
    return _U32.pack(number)


def u32_of(value: bytes) -> int:
    """The unsigned number in four value bytes."""
    return int(_U32.unpack(value)[0])


@dataclass(frozen=True, slots=True)
class RxSdo:
    """Read or write any parameter, host to drive (command 04). Endpoint numbers belong to one firmware version."""

    COMMAND: ClassVar[MessageId] = MessageId.RX_SDO
    opcode: int
    endpoint: int
    value: bytes = bytes(4)

    def encode(self) -> bytes:
        return _SDO.pack(self.opcode, self.endpoint, self.value)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        # A read, and the write of a small type, may come without the last value bytes.
        check_length(data, 4, "parameter request")
        return cls(*_SDO.unpack(bytes(data[:8]).ljust(8, b"\0")))


@dataclass(frozen=True, slots=True)
class TxSdo:
    """A parameter's value, drive to host (command 05)."""

    COMMAND: ClassVar[MessageId] = MessageId.TX_SDO
    endpoint: int
    value: bytes

    def encode(self) -> bytes:
        return _SDO.pack(0, self.endpoint, self.value)

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        check_length(data, 5, "parameter answer")
        _, endpoint, value = _SDO.unpack(bytes(data[:8]).ljust(8, b"\0"))
        return cls(endpoint, value)
