"""Messages of fixed layout: a table's rows to protobuf messages in MCAP records and back, thousands at a time.

Protobuf lets a writer leave out fields that are zero. Ours never does, so every message of a stream has the same length
and the same tags in the same places, a whole table becomes records by copying columns, and any protobuf reader still
understands every single message. (protobuf encoding guide, "Message Structure"; MCAP specification, "Message".)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from norton_bench.records import NO_DEVICE_TIME

Rows = npt.NDArray[np.void]
Bytes = npt.NDArray[np.uint8]

# opcode, record length, channel, sequence, log time, publish time
HEADER = np.dtype([("op", "u1"), ("len", "<u8"), ("chan", "<u2"), ("seq", "<u4"), ("log", "<u8"), ("pub", "<u8")])
MESSAGE_OPCODE = 5
RECORD_PREFIX = 9  # opcode and length are not counted by the length


@dataclass(frozen=True)
class Kind:
    """How one numpy type travels: protobuf's type number (descriptor.proto) and wire type."""

    proto_type: int
    wire_type: int
    numpy: str


KINDS = {
    "f8": Kind(1, 1, "<f8"),  # double
    "f4": Kind(2, 5, "<f4"),  # float
    "u8": Kind(6, 1, "<u8"),  # fixed64
    "u4": Kind(7, 5, "<u4"),  # fixed32
    "b1": Kind(8, 0, "?"),  # bool: a varint of one byte
    "i4": Kind(15, 5, "<i4"),  # sfixed32
    "i8": Kind(16, 1, "<i8"),  # sfixed64
}
BYTES = Kind(12, 2, "u1")
KIND_OF_PROTO_TYPE = {kind.proto_type: name for name, kind in KINDS.items()}


def varint(value: int) -> bytes:
    """A non-negative integer in protobuf's base 128."""
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


@dataclass(frozen=True)
class Field:
    """One field of a message: its name, number, and a key of ``KINDS``, or None for bytes of a fixed ``length``."""

    name: str
    number: int
    kind: str | None
    length: int = 0

    @property
    def tag(self) -> bytes:
        """What precedes the value on the wire."""
        if self.kind is None:
            return varint(self.number << 3 | BYTES.wire_type) + varint(self.length)
        return varint(self.number << 3 | KINDS[self.kind].wire_type)

    @property
    def numpy(self) -> tuple[str, tuple[int, ...]]:
        """Type and shape of the value."""
        return (BYTES.numpy, (self.length,)) if self.kind is None else (KINDS[self.kind].numpy, ())


def fields_of(dtype: np.dtype[np.void]) -> tuple[Field, ...]:
    """One field a column, numbered from 1. Raises KeyError for a column type that is not in ``KINDS``."""
    names = dtype.names or ()
    kinds = [dtype[name].str.lstrip("<|=") for name in names]
    return tuple(Field(name, number, kind) for number, (name, kind) in enumerate(zip(names, kinds, strict=True), 1))


@dataclass(frozen=True)
class Layout:
    """The records of one kind of message."""

    fields: tuple[Field, ...]

    @cached_property
    def record(self) -> "np.dtype[np.void]":
        """A whole MCAP message record, packed: the header, then tag and value of every field."""
        columns: list[tuple[str, str, tuple[int, ...]]] = [(name, HEADER[name].str, ()) for name in HEADER.names or ()]
        for field in self.fields:
            columns += [(f"tag {field.name}", "u1", (len(field.tag),)), (field.name, *field.numpy)]
        return np.dtype(columns)

    @cached_property
    def _template(self) -> Rows:
        """One record with everything that is the same in all of them."""
        row = np.zeros(1, self.record)
        row["op"] = MESSAGE_OPCODE
        row["len"] = self.record.itemsize - RECORD_PREFIX
        for field in self.fields:
            row[f"tag {field.name}"] = np.frombuffer(field.tag, np.uint8)
        return row

    @cached_property
    def _constant_places(self) -> npt.NDArray[np.intp]:
        """Byte offsets, within a record, of what never changes."""
        constant = np.zeros(1, self.record)
        for name in ("op", "len", *(f"tag {field.name}" for field in self.fields)):
            constant[name].view(np.uint8)[...] = 1
        return np.flatnonzero(constant.view(np.uint8))

    def encode(self, columns: Rows, *, channel: int, first_sequence: int, stamp: str) -> Rows:
        """The records of a table's rows, shape (n,); ``stamp`` names the column that gives the log time [ns]."""
        rows = self.blank(len(columns), channel)
        rows["seq"] = np.arange(first_sequence, first_sequence + len(columns), dtype=np.uint64).astype(np.uint32)
        rows["log"] = rows["pub"] = columns[stamp].astype(np.uint64)
        for field in self.fields:
            rows[field.name] = columns[field.name]
        return rows

    def blank(self, count: int, channel: int) -> Rows:
        """``count`` records that lack only sequence, times and values."""
        rows = np.repeat(self._template, count)
        rows["chan"] = channel
        return rows

    def decode(self, data: bytes) -> Rows:
        """Records one after the other, shape (n,). Raises ValueError where they are not of this layout."""
        size = self.record.itemsize
        if len(data) % size:
            raise ValueError("message of another length")
        matrix = np.frombuffer(data, np.uint8).reshape(-1, size)
        expected = self._template.view(np.uint8)[self._constant_places]
        if not (matrix[:, self._constant_places] == expected).all():
            raise ValueError("message with other fields")
        return matrix.reshape(-1).view(self.record)


def table_from(rows: Rows, dtype: np.dtype[np.void]) -> Rows:
    """The columns of ``dtype`` out of ``rows``. A column that the file lacks says that nothing is known (``device_ns``:
    that the device has no clock), or is 0 where it cannot."""
    table = np.zeros(len(rows), dtype)
    present = rows.dtype.names or ()
    for name in dtype.names or ():
        if name in present:
            table[name] = rows[name]
        elif dtype[name].kind == "f":
            table[name] = np.nan
        elif name == "device_ns":
            table[name] = NO_DEVICE_TIME
    return table


def layout_of(fields: Sequence[tuple[str, int, int]]) -> Layout:
    """The layout of a message described as (name, number, protobuf type). Raises KeyError for a type not fixed."""
    ordered = sorted(fields, key=lambda field: field[1])
    return Layout(tuple(Field(name, number, KIND_OF_PROTO_TYPE[kind]) for name, number, kind in ordered))
