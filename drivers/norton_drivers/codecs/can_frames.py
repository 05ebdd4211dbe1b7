"""CAN frames as the protocols of adapters carry them, classical ones and CAN FD, and the lengths they may have."""

from dataclasses import dataclass
from typing import Final

from norton_drivers.codecs.common import CodecError

STANDARD_MAX: Final = 0x7FF
EXTENDED_MAX: Final = 0x1FFFFFFF
CLASSICAL_LENGTH_MAX: Final = 8
# How many bytes a CAN FD frame may have, by its length code. Source: ISO 11898-1:2015, table 5.
FD_LENGTHS: Final = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


def padded(data: bytes, filler: int) -> bytes:
    """``data`` at the next length that a CAN FD frame can have. Raises CodecError for more than 64 bytes."""
    for length in FD_LENGTHS:
        if length >= len(data):
            return data.ljust(length, bytes((filler,)))
    raise CodecError(f"{len(data)} bytes where a CAN FD frame has at most {FD_LENGTHS[-1]}")


@dataclass(frozen=True, slots=True)
class LineFrame:
    """One CAN frame; ``length`` counts its bytes, ``data`` is empty for a remote frame. ``fd``: a CAN FD frame;
    ``switched``: its data go at a bit rate of their own."""

    arbitration_id: int
    data: bytes
    length: int
    extended: bool = False
    remote: bool = False
    fd: bool = False
    switched: bool = False

    def check(self) -> None:
        """Raises CodecError for a frame that no bus can carry."""
        lengths = FD_LENGTHS if self.fd else FD_LENGTHS[: CLASSICAL_LENGTH_MAX + 1]
        if self.length not in lengths:
            raise CodecError(f"no such frame has {self.length} bytes")
        if self.arbitration_id > (EXTENDED_MAX if self.extended else STANDARD_MAX):
            raise CodecError(f"no such frame has the identifier 0x{self.arbitration_id:X}")
        if self.fd and self.remote:
            raise CodecError("CAN FD has no remote frames")
