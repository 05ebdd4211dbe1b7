"""Adapters: CAN frames in lines on a serial line, as slcan and mjbots' fdcanusb have them."""

import re
from collections.abc import Sequence
from contextlib import suppress
from random import Random
from typing import TypeVar

from norton_drivers.codecs import fdcanusb
from norton_drivers.codecs.can_frames import LineFrame
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.fdcanusb import FdcanusbFrame
from norton_drivers.codecs.slcan import SlcanFrame, SlcanStream

from .streams import StreamCodec

Framed = TypeVar("Framed", bound=LineFrame)


class SlcanLine:
    """Frames in lines; a damaged digit makes another frame, which nothing can tell."""

    by_chance = 0.0
    _GRAMMAR = re.compile(
        rb"(?:(?:[tr](?P<i>[0-7]..)|[TR](?P<j>[01].{7}))(?P<n>[0-8])|(?:[db](?P<k>[0-7]..)|[DB](?P<l>[01].{7}))(?P<m>.))"
        rb"(?P<rest>.*)"
    )
    _DIGITS = re.compile(rb".[0-9a-fA-F]*")
    _LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)

    def __init__(self) -> None:
        self._stream = SlcanStream()
        self._begun = b""

    def message(self, random: Random) -> tuple[bytes, object]:
        frame = _random_frame(SlcanFrame, random)
        return frame.encode(), frame

    def told(self, wire: bytes) -> Sequence[object]:
        *lines, self._begun = re.split(rb"[\r\a]", self._begun + wire)
        return [frame for line in lines if (frame := self._frame_in(line)) is not None]

    def hear(self, data: bytes) -> Sequence[object]:
        self._stream.feed(data)
        heard = list(self._stream.frames)
        self._stream.frames.clear()
        return heard

    def pause(self) -> None:
        """The line has no pauses."""

    def close(self) -> None:
        """Nothing to release."""

    def _frame_in(self, line: bytes) -> SlcanFrame | None:
        """By the grammar in Lawicel's manuals; case matters in the first letter alone."""
        found = self._GRAMMAR.fullmatch(line) if self._DIGITS.fullmatch(line) else None
        if found is None:
            return None
        letter, identifier = line[:1], found["i"] or found["j"] or found["k"] or found["l"]
        extended, remote, fd = letter.isupper(), letter in b"rR", letter in b"dDbB"
        length = self._LENGTHS[int(found["n"] or found["m"], 16)]
        size = 0 if remote else 2 * length
        if len(found["rest"]) not in (size, size + 4):
            return None
        data = bytes.fromhex(found["rest"][:size].decode())
        return SlcanFrame(int(identifier, 16), data, length, extended, remote, fd, letter in b"bB")


class FdcanusbLine:
    """Frames in lines with checksums, as a moteus' UART sends them."""

    def __init__(self) -> None:
        self.by_chance = 0.0
        self._lines = fdcanusb.line_stream()

    def message(self, random: Random) -> tuple[bytes, object]:
        frame = _random_frame(FdcanusbFrame, random)
        return fdcanusb.with_checksum(frame.encode_event()) + b"\r\n", frame

    def told(self, wire: bytes) -> Sequence[object]:
        """There is a checksum; a damaged line passes it once in 256 times."""
        self.by_chance += 1 / 256
        return []

    def hear(self, data: bytes) -> Sequence[object]:
        heard: list[object] = []
        for line in self._lines.feed(data):
            with suppress(CodecError):
                text = fdcanusb.checked(line.text)
                if text != line.text:
                    heard.append(FdcanusbFrame.decode_event(text))
        return heard

    def pause(self) -> None:
        """The line has no pauses."""

    def close(self) -> None:
        """Nothing to release."""


def _random_frame(kind: type[Framed], random: Random) -> Framed:
    extended, fd = random.random() < 0.5, random.random() < 0.2
    remote = not fd and random.random() < 0.1
    length = random.choice((1, 2, 3, 5, 8, 12, 12, 64) if fd else range(1, 9))
    data = b"" if remote else random.randbytes(length)
    identifier = random.getrandbits(29 if extended else 11)
    return kind(identifier, data, length, extended, remote, fd, fd and random.random() < 0.5)


def slcan_lines() -> StreamCodec:
    return StreamCodec("slcan lines", "form: letter, digits, length", SlcanLine)


def fdcanusb_lines() -> StreamCodec:
    return StreamCodec("fdcanusb lines", "CRC-8", FdcanusbLine)
