"""slcan: CAN frames as lines of ASCII on a serial line (Lawicel protocol, with CANable 2.0's CAN FD frames).

``t`` and ``T`` are data frames with 3 and 8 hexadecimal digits of identifier, ``r`` and ``R`` remote frames, ``d`` and
``D`` CAN FD frames, ``b`` and ``B`` those whose data go at a bit rate of their own; then one hexadecimal digit, the
length code, the data in hexadecimal, and possibly four digits of the adapter's time stamp. A line ends with CR;
BEL stands for a command that was refused, and a lone CR for one that was taken. ``F`` asks for the adapter's status
flags, answered as ``F`` and two hexadecimal digits. Sources: Lawicel CANUSB and CAN232 manuals, "ASCII commands";
normaldotcom/canable2-fw, README; python-can, interfaces/slcan.py.
"""

from collections import deque
from typing import Final

from norton_drivers.codecs.can_frames import FD_LENGTHS, LineFrame
from norton_drivers.codecs.common import CodecError

_END: Final = b"\r"
_LINE_MAX: Final = 160  # a CAN FD frame with time stamp has 142 characters
_LETTERS: Final = b"trdbTRDB"
_EXTENDED, _REMOTE, _FD, _SWITCHED = b"TRDB", b"rR", b"dDbB", b"bB"
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


class SlcanFrame(LineFrame):
    """One CAN frame in a line."""

    __slots__ = ()

    def encode(self) -> bytes:
        """The line, with its CR. Raises CodecError for a frame that no bus can carry."""
        self.check()
        letter = "r" if self.remote else "b" if self.switched else "d" if self.fd else "t"
        letter, digits = (letter.upper(), 8) if self.extended else (letter, 3)
        code = FD_LENGTHS.index(self.length)
        return f"{letter}{self.arbitration_id:0{digits}X}{code:X}{self.data.hex().upper()}\r".encode()

    @classmethod
    def decode(cls, line: bytes) -> "SlcanFrame":
        """A line without its CR. Raises CodecError."""
        if not line or line[0] not in _LETTERS:
            raise CodecError(f"not an slcan frame: {line[:_LINE_MAX]!r}")
        extended, remote, fd, switched = (line[0] in letters for letters in (_EXTENDED, _REMOTE, _FD, _SWITCHED))
        id_end = 9 if extended else 4
        if len(line) <= id_end or len(line) % 2 == id_end % 2 or not _HEXADECIMAL.issuperset(line[1:]):
            raise CodecError(f"not an slcan frame: {line[:_LINE_MAX]!r}")
        length = FD_LENGTHS[int(line[id_end : id_end + 1], 16)]
        size = 0 if remote else length
        rest = bytes.fromhex(line[id_end + 1 :].decode("ascii"))
        if len(rest) not in (size, size + 2):
            raise CodecError(f"not an slcan frame: {line[:_LINE_MAX]!r}")
        frame = cls(int(line[1:id_end], 16), rest[:size], length, extended, remote, fd, switched)
        frame.check()
        return frame


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
