"""A device's object dictionary: typed values, with the checks and consequences that its firmware gives them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from struct import Struct
from typing import Final

from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs.common import CodecError

U8: Final = Struct("<B")
U16: Final = Struct("<H")
U32: Final = Struct("<I")
I8: Final = Struct("<b")
I16: Final = Struct("<h")
I32: Final = Struct("<i")


class AbortError(Exception):
    """An access that the device refuses, with CiA 301's code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"SDO abort 0x{code:08X}")
        self.code = code


@dataclass
class Entry:
    """One value. ``read`` gives it where it is not stored; ``written`` is told of a new one, and may refuse it."""

    layout: Struct
    value: int = 0
    writable: bool = False
    mappable: bool = False
    read: Callable[[], int] | None = None
    written: Callable[[int], None] | None = None

    def __post_init__(self) -> None:
        self.default = self.value

    @property
    def bits(self) -> int:
        return 8 * self.layout.size

    def get(self) -> int:
        return self.value if self.read is None else self.read()

    def set(self, value: int) -> None:
        """Raises AbortError where the firmware refuses."""
        if self.written is not None:
            self.written(value)
        self.value = value


class Objects:
    """Entries by index and subindex, and texts by index."""

    def __init__(self) -> None:
        self._entries: dict[tuple[int, int], Entry] = {}
        self._texts: dict[int, bytes] = {}

    def add(self, index: int, subindex: int, entry: Entry) -> Entry:
        self._entries[index, subindex] = entry
        return entry

    def add_text(self, index: int, text: str) -> None:
        self._texts[index] = text.encode("ascii")

    def entry(self, index: int, subindex: int) -> Entry:
        """Raises AbortError."""
        result = self._entries.get((index, subindex))
        if result is None:
            raise AbortError(protocol.ABORT_NO_SUBINDEX if self._has(index) else protocol.ABORT_NO_OBJECT)
        return result

    def read(self, index: int, subindex: int) -> bytes:
        """The value's bytes. Raises AbortError."""
        if subindex == 0 and index in self._texts:
            return self._texts[index]
        entry = self.entry(index, subindex)
        return entry.layout.pack(entry.get())

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Raises AbortError."""
        entry = self.entry(index, subindex)
        if not entry.writable:
            raise AbortError(protocol.ABORT_NOT_WRITABLE)
        if len(data) != entry.layout.size:
            raise AbortError(protocol.ABORT_WRONG_LENGTH)
        entry.set(entry.layout.unpack(data)[0])

    def reset_communication(self) -> None:
        """Every communication parameter (1000h to 1FFFh) as at power-on."""
        for (index, _), entry in self._entries.items():
            if index < 0x2000:
                entry.value = entry.default

    def _has(self, index: int) -> bool:
        return index in self._texts or any(known == index for known, _ in self._entries)


_EXPEDITED_MAX = 4
_SEGMENT_MAX = 7


class SdoServer:
    """Answers questions about the object dictionary: short values in one frame, texts in segments.

    Source: CiA 301, "SDO". Values are written in one frame only; what else a client may ask is refused as unknown.

    ``answer`` is called with the payload of each answer.
    """

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
