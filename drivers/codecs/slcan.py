"""slcan: CAN frames as lines of ASCII on a serial line (Lawicel protocol), classic frames only.

``t`` and ``T`` are data frames with 3 and 8 hexadecimal digits of identifier, ``r`` and ``R`` remote frames; then one
digit of length, the data in hexadecimal, and possibly four digits of the adapter's time stamp. A line ends with CR;
BEL stands for an error, and a lone CR for a command that was taken. Source: Lawicel CANUSB manual, "ASCII commands".
"""

from collections import deque
from dataclasses import dataclass
from typing import Final

from drivers.codecs.errors import CodecError

_END: Final = b"\r"
_LINE_MAX: Final = 64  # a classic frame with time stamp has 31 characters
_KINDS: Final = {ord("t"): (4, False), ord("T"): (9, True), ord("r"): (4, True), ord("R"): (9, True)}
_ANSWERS: Final = b"zZFVvN"  # to commands: sent, flags, version, serial number


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
        try:
            arbitration_id = int(line[1:id_end], 16)
            length = int(line[id_end : id_end + 1], 16)
            rest = bytes.fromhex(line[id_end + 1 :].decode("ascii"))
        except ValueError as error:
            raise CodecError(f"not an slcan frame: {line[:_LINE_MAX]!r}") from error
        size = 0 if remote else length
        if length > 8 or len(rest) not in (size, size + 2):
            raise CodecError(f"not an slcan frame: {line[:_LINE_MAX]!r}")
        return cls(arbitration_id, rest[:size], length, line[0] in b"TR", remote)


class SlcanStream:
    """Finds frames in a byte stream however it is cut; they wait in ``frames``. ``malformed`` counts bad lines."""

    def __init__(self) -> None:
        self.frames: deque[SlcanFrame] = deque()
        self.malformed = 0
        self._rest = b""

    def feed(self, data: bytes) -> None:
        """Take bytes in. Never raises."""
        *lines, rest = (self._rest + data.replace(b"\a", _END)).split(_END)
        for line in lines:
            self._take(line)
        if len(rest) > _LINE_MAX:
            self.malformed += 1
            rest = b""
        self._rest = rest

    def _take(self, line: bytes) -> None:
        if not line or line[0] in _ANSWERS:
            return
        try:
            self.frames.append(SlcanFrame.decode(line))
        except CodecError:
            self.malformed += 1
