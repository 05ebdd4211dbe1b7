"""socketcand's raw mode: CAN frames as text in angle brackets over TCP, both ways.

A server greets with ``< hi >``; the client opens a bus, switches to raw mode, and is answered ``< ok >`` each time.
Source: linux-can/socketcand, doc/protocol.md and src/state_raw.c. Older servers know no remote frames, and say
``< error unknown command >``.
"""

import re
from collections import deque
from dataclasses import dataclass
from typing import Final

from norton_drivers.codecs.common import CodecError

HELLO: Final = "hi"
OK: Final = "ok"
RAW_MODE: Final = b"< rawmode >"
_LONGEST: Final = 256  # a classic frame takes some sixty characters
_IDENTIFIER: Final = "([0-7][0-9A-Fa-f]{2}|[01][0-9A-Fa-f]{7})"  # 11 or 29 bits
_STAMP: Final = r"(\d{1,12}\.\d{1,9})"
_FRAME: Final = re.compile(rf"frame {_IDENTIFIER} {_STAMP}((?: ?[0-9A-Fa-f]{{2}}){{0,8}}) ?", re.ASCII)
_REMOTE: Final = re.compile(rf"rtr {_IDENTIFIER} {_STAMP} ([0-8])", re.ASCII)
_ERROR: Final = re.compile(rf"error ([0-9A-Fa-f]{{3,8}}) {_STAMP}", re.ASCII)
_REQUEST: Final = re.compile(rf"(send|sendrtr) {_IDENTIFIER} ([0-8])((?: [0-9A-Fa-f]{{1,2}}){{0,8}})", re.ASCII)


def open_bus(channel: str) -> bytes:
    """The request for one of the server's buses."""
    return f"< open {channel} >".encode()


@dataclass(frozen=True, slots=True)
class SocketcandFrame:
    """One classic frame. ``stamp_s`` is the server's time of reception; ``length`` is the DLC of a remote frame."""

    arbitration_id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    error: bool = False
    length: int = 0
    stamp_s: float = 0.0

    def encode_request(self) -> bytes:
        """The client's request to send it."""
        if self.remote:
            return f"< sendrtr {self._identifier} {self.length} >".encode()
        words = ["<", "send", self._identifier, str(len(self.data)), *(f"{byte:02X}" for byte in self.data), ">"]
        return " ".join(words).encode()

    def encode_event(self) -> bytes:
        """The server's word that it was received."""
        if self.error:
            return f"< error {self.arbitration_id:03X} {self.stamp_s:.6f} >".encode()
        if self.remote:
            return f"< rtr {self._identifier} {self.stamp_s:.6f} {self.length} >".encode()
        return f"< frame {self._identifier} {self.stamp_s:.6f} {self.data.hex().upper()} >".encode()

    @property
    def _identifier(self) -> str:
        return f"{self.arbitration_id:08X}" if self.extended else f"{self.arbitration_id:03X}"


def decode_event(text: str) -> SocketcandFrame:
    """What stands between the brackets of the server's ``frame``, ``rtr`` or ``error``. Raises CodecError."""
    if match := _FRAME.fullmatch(text):
        data = bytes.fromhex(match[3].replace(" ", ""))
        return SocketcandFrame(int(match[1], 16), data, len(match[1]) == 8, length=len(data), stamp_s=float(match[2]))
    if match := _REMOTE.fullmatch(text):
        return SocketcandFrame(
            int(match[1], 16), b"", len(match[1]) == 8, remote=True, length=int(match[3]), stamp_s=float(match[2])
        )
    if match := _ERROR.fullmatch(text):
        return SocketcandFrame(int(match[1], 16) & 0x1FFFFFFF, error=True, stamp_s=float(match[2]))
    raise CodecError(f"not a socketcand frame: {text!r}")


def decode_request(text: str) -> SocketcandFrame:
    """What stands between the brackets of the client's ``send`` or ``sendrtr``. Raises CodecError."""
    match = _REQUEST.fullmatch(text)
    if match is None:
        raise CodecError(f"not a socketcand request: {text!r}")
    remote, length = match[1] == "sendrtr", int(match[3])
    data = bytes(int(word, 16) for word in match[4].split())
    if len(data) != (0 if remote else length):
        raise CodecError(f"not a socketcand request: {text!r}")
    return SocketcandFrame(int(match[2], 16), data, len(match[2]) == 8, remote, length=length)


class BracketStream:
    """Finds ``< ... >`` in a byte stream however it is cut; what stands between them waits in ``texts``.

    ``malformed`` counts what stood outside, or was too long.
    """

    def __init__(self) -> None:
        self.texts: deque[str] = deque()
        self.malformed = 0
        self._rest = b""

    def feed(self, data: bytes) -> None:
        """Take bytes in. Never raises."""
        *parts, rest = (self._rest + data).split(b">")
        for part in parts:
            self._take(part)
        if len(rest) > _LONGEST:
            self.malformed += 1
            rest = b""
        self._rest = rest

    def _take(self, part: bytes) -> None:
        junk, bracket, inside = part.rpartition(b"<")
        if junk.strip() or not bracket:
            self.malformed += 1
        if bracket:
            self.texts.append(inside.decode("ascii", "replace").strip())
