"""Answers questions about the object dictionary: short values in one frame, texts in segments.

Source: CiA 301, "SDO". Values are written in one frame only; what else a client may ask is refused as unknown.
"""

from collections.abc import Callable
from functools import partial

from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs.errors import CodecError
from norton_sim.firmware.canopen.objects import AbortError, Objects

_EXPEDITED_MAX = 4
_SEGMENT_MAX = 7


class SdoServer:
    """``answer`` is called with the payload of each answer."""

    def __init__(self, objects: Objects, answer: Callable[[bytes], None]) -> None:
        self._objects = objects
        self._answer = answer
        self._rest: bytes | None = None  # of a text under way
        self._toggle = False

    def receive(self, data: bytes | bytearray) -> None:
        """One request, whatever its bytes are. A frame that is not of eight bytes is not taken notice of."""
        try:
            request = protocol.sdo_request_of(data)
        except CodecError:
            if len(data) == 8:
                self._refuse(int.from_bytes(data[1:3], "little"), data[3], protocol.ABORT_UNKNOWN_COMMAND)
            return
        match request:
            case protocol.SdoRead(index, subindex):
                self._try(index, subindex, self._read)
            case protocol.SdoWrite(index, subindex, value):
                self._try(index, subindex, partial(self._write, value))
            case protocol.SdoReadSegment(toggle):
                self._read_segment(toggle)
            case protocol.SdoAbort():
                self._rest = None

    def _try(self, index: int, subindex: int, access: Callable[[int, int], None]) -> None:
        self._rest = None
        try:
            access(index, subindex)
        except AbortError as error:
            self._refuse(index, subindex, error.code)

    def _read(self, index: int, subindex: int) -> None:
        data = self._objects.read(index, subindex)
        if len(data) <= _EXPEDITED_MAX:
            self._answer(protocol.SdoValue(index, subindex, data).encode())
            return
        self._rest, self._toggle = data, False
        self._answer(protocol.SdoLongValue(index, subindex, len(data)).encode())

    def _write(self, value: bytes, index: int, subindex: int) -> None:
        self._objects.write(index, subindex, value)
        self._answer(protocol.SdoWritten(index, subindex).encode())

    def _read_segment(self, toggle: bool) -> None:
        if self._rest is None:
            self._refuse(0, 0, protocol.ABORT_UNKNOWN_COMMAND)
            return
        if toggle != self._toggle:
            self._rest = None
            self._refuse(0, 0, protocol.ABORT_TOGGLE)
            return
        segment, rest = self._rest[:_SEGMENT_MAX], self._rest[_SEGMENT_MAX:]
        self._answer(protocol.SdoSegment(toggle, segment, last=not rest).encode())
        self._rest, self._toggle = rest or None, not toggle

    def _refuse(self, index: int, subindex: int, code: int) -> None:
        self._answer(protocol.SdoAbort(index, subindex, code).encode())
