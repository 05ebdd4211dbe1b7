"""A torque value, and a status, somewhere in a CANopen sensor's process data: to bytes and back.

Little-endian, at a byte offset, as a whole number or a float. HBM's TIM40, for one, sends an i32 of four bytes, and two
bytes of status (TIM40 mounting instructions A02590, "PDO contents").
"""

import struct
from dataclasses import dataclass
from math import isfinite
from struct import Struct
from typing import Literal

from norton_drivers.codecs.common import CodecError

ValueType = Literal["i16", "i32", "f32"]
PDO_MAX = 8

_LAYOUTS: dict[str, Struct] = {"i16": Struct("<h"), "i32": Struct("<i"), "f32": Struct("<f")}
_STATUS_MAX = 4


@dataclass(frozen=True, slots=True)
class TorqueField:
    """Where the value stands: ``offset`` and the PDO's ``length`` in bytes."""

    kind: ValueType = "i32"
    offset: int = 0
    length: int = 4

    def encode(self, digits: float) -> bytes:
        """All other bytes are zero. A whole number is rounded. Raises CodecError for what does not fit."""
        layout = _LAYOUTS[self.kind]
        try:
            value = layout.pack(digits if self.kind == "f32" else round(digits))
        except (struct.error, OverflowError, ValueError) as error:
            raise CodecError(f"torque: {digits} does not fit into an {self.kind}") from error
        return (bytes(self.offset) + value).ljust(self.length, b"\0")

    def decode(self, data: bytes | bytearray) -> float:
        """The value, in digits. Raises CodecError for another length, and for what is no number."""
        if len(data) != self.length:
            raise CodecError(f"torque: {len(data)} bytes instead of {self.length}")
        digits = float(_LAYOUTS[self.kind].unpack_from(data, self.offset)[0])
        if not isfinite(digits):
            raise CodecError("torque: not a finite number")
        return digits

    @property
    def end(self) -> int:
        """The shortest PDO that holds the value."""
        return self.offset + _LAYOUTS[self.kind].size


def status_of(data: bytes | bytearray) -> int:
    """The status' bits, the first byte lowest; at most 32 of them. Raises CodecError for an empty frame."""
    if not data:
        raise CodecError("status: empty")
    return int.from_bytes(data[:_STATUS_MAX], "little")
