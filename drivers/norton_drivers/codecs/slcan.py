"""slcan: CAN frames as lines of ASCII on a serial line (Lawicel protocol), classic frames only.

``t`` and ``T`` are data frames with 3 and 8 hexadecimal digits of identifier, ``r`` and ``R`` remote frames; then one
digit of length, the data in hexadecimal, and possibly four digits of the adapter's time stamp. A line ends with CR;
BEL stands for a command that was refused, and a lone CR for one that was taken. ``F`` asks for the adapter's status
flags, answered as ``F`` and two hexadecimal digits. Source: Lawicel CANUSB and CAN232 manuals, "ASCII commands".
"""

from collections import deque
from dataclasses import dataclass
from typing import Final

from norton_drivers.codecs.common import CodecError

_END: Final = b"\r"
_LINE_MAX: Final = 64  # a classic frame with time stamp has 31 characters
_KINDS: Final = {ord("t"): (4, False), ord("T"): (9, True), ord("r"): (4, True), ord("R"): (9, True)}
_STANDARD_MAX: Final = 0x7FF
_EXTENDED_MAX: Final = 0x1FFFFFFF
_HEXADECIMAL: Final = frozenset(b"0123456789abcdefABCDEF")
_ANSWERS: Final = b"zZVvN"  # to commands: sent, version, serial number

ASK_FLAGS: Final = b"F\r"
# Bit 4 is unused in Lawicel's own adapters; usb2canfdv1 says bus-off there.
FLAG_BUS_OFF: Final = 0x10
FLAG_BUS_ERROR: Final = 0x80
FLAG_WORDS: Final = (
    (0x01, "receive buffer of the adapter full, frames were lost"),
    (0x02, "send buffer of the adapter full, frames were lost"),
    (0x04, "error warning level reached"),
    (0x08, "receive overrun"),
    (FLAG_BUS_OFF, "bus-off"),
    (0x20, "error-passive"),
    (0x40, "arbitration lost"),
    (FLAG_BUS_ERROR, "bus error"),
)


def encode_flags(flags: int) -> bytes:
    """An adapter's answer to :data:`ASK_FLAGS`."""
    return f"F{flags:02X}\r".encode()


def decode_flags(line: bytes) -> int:
    """The answer without its CR. Raises CodecError."""
    if len(line) != 3 or line[:1] != b"F" or not _HEXADECIMAL.issuperset(line[1:]):
        raise CodecError(f"no status flags: {line[:_LINE_MAX]!r}")
    return int(line[1:], 16)


@dataclass(frozen=True, slots=True)
class SlcanFrame:
    """One classic CAN frame; ``length`` is its DLC, ``data`` is empty for a remote frame."""

    arbitration_id: int
    data: bytes
    length: int
    extended: bool = False
    remote: bool = False

    def encode(self) -> bytes:
        """The line, with its CR."""
        letter = ("R" if self.extended else "r") if self.remote else ("T" if self.extended else "t")
        digits = 8 if self.extended else 3
        return f"{letter}{self.arbitration_id:0{digits}X}{self.length}{self.data.hex().upper()}\r".encode()

    @classmethod
    def decode(cls, line: bytes) -> "SlcanFrame":
        """A line without its CR. Raises CodecError."""
        if not line or line[0] not in _KINDS:
            raise CodecError(f"not an slcan frame: {line[:_LINE_MAX]!r}")
        id_end = _KINDS[line[0]][0]
        remote = line[0] in b"rR"
        if len(line) <= id_end or len(line) % 2 == id_end % 2 or not _HEXADECIMAL.issuperset(line[1:]):
            raise CodecError(f"not an slcan frame: {line[:_LINE_MAX]!r}")
        arbitration_id = int(line[1:id_end], 16)
        length = int(line[id_end : id_end + 1], 16)
        rest = bytes.fromhex(line[id_end + 1 :].decode("ascii"))
        size = 0 if remote else length
        greatest = _EXTENDED_MAX if line[0] in b"TR" else _STANDARD_MAX
        if length > 8 or len(rest) not in (size, size + 2) or arbitration_id > greatest:
            raise CodecError(f"not an slcan frame: {line[:_LINE_MAX]!r}")
        return cls(arbitration_id, rest[:size], length, line[0] in b"TR", remote)


class SlcanStream:
    """Finds frames in a byte stream however it is cut; they wait in ``frames``, status flags in ``flags``.

    ``malformed`` counts bad lines, ``refused`` the commands that the adapter did not take, ``flags_asked`` the
    questions for them, of which an adapter hears.
    """

    def __init__(self) -> None:
        self.frames: deque[SlcanFrame] = deque()
        self.flags: deque[int] = deque()
        self.malformed = 0
        self.refused = 0
        self.flags_asked = 0
        self._rest = b""
        self._skipping = False  # what has begun is too long for a line, and so is none to its end

    def feed(self, data: bytes) -> None:
        """Take bytes in. Never raises."""
        self.refused += data.count(b"\a")
        *lines, rest = (self._rest + data.replace(b"\a", _END)).split(_END)
        for line in lines:
            if not self._skipping:
                self._take(line)
            self._skipping = False
        if len(rest) > _LINE_MAX and not self._skipping:
            self.malformed += 1
            self._skipping = True
        self._rest = b"" if self._skipping else rest

    def _take(self, line: bytes) -> None:
        if not line or line[0] in _ANSWERS:
            return
        if line == b"F":
            self.flags_asked += 1
            return
        try:
            if line[:1] == b"F":
                self.flags.append(decode_flags(line))
            else:
                self.frames.append(SlcanFrame.decode(line))
        except CodecError:
            self.malformed += 1
