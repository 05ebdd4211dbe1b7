"""What a recording holds beside the tables of :class:`norton_bench.records.Measured`, and the schemas of it all."""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet

from norton_bench.recording.layout import BYTES, KINDS, Field, Layout, fields_of, layout_of
from norton_bench.records import TABLES

FORMAT = "1"
PACKAGE = "norton_bench"
PROFILE = "norton-bench"
METADATA = "norton_bench"  # what was known at the start
OUTCOME = "norton_bench.outcome"  # what was known at the end
RIG_FILE = "rig.toml"


EVENTS = "/events"
SEGMENTS = "/segments"
ESTIMATES = "/estimates"

RAW_PREFIX = "/raw/"
RAW_MESSAGE = "RawFrame"
RAW_CHANNEL_KEY = "channel"  # in the MCAP channel's metadata: the name as the rig knows it


def raw_topic(channel: str) -> str:
    """The topic of a bus's or serial port's frames."""
    return RAW_PREFIX + channel.strip("/")


def raw_fields(length: int) -> tuple[Field, ...]:
    """The fields of a raw frame that carries ``length`` bytes."""
    return (
        Field("stamp_ns", 1, "i8"),
        Field("arbitration_id", 2, "i4"),
        Field("sent", 3, "b1"),
        Field("extended", 4, "b1"),
        Field("remote", 5, "b1"),
        Field("data", 6, None, length),
        Field("fd", 7, "b1"),
        Field("switched", 8, "b1"),
    )


def raw_names(schema: bytes) -> frozenset[str]:
    """The fields of raw frames that a file's own schema describes: older files lack some of ours."""
    files = FileDescriptorSet.FromString(schema).file
    return frozenset(field.name for file in files for message in file.message_type for field in message.field)


_TEXT = FieldDescriptorProto.TYPE_STRING
_INT = FieldDescriptorProto.TYPE_SFIXED64
_FLAG = FieldDescriptorProto.TYPE_BOOL
_REAL = FieldDescriptorProto.TYPE_DOUBLE

# Messages that come seldom, and so may be of any length.
_EVENT = {"stamp_ns": _INT, "kind": _TEXT, "text": _TEXT}
_SEGMENT = {
    "index": _INT,
    "procedure": _TEXT,
    "name": _TEXT,
    "use": _TEXT,
    "mode": _TEXT,
    "start_ns": _INT,
    "end_ns": _INT,
    "preview": _FLAG,
}
_ESTIMATE = {"name": _TEXT, "value": _REAL, "std": _REAL, "unit": _TEXT, "status": _TEXT}


def full_name(message: str) -> str:
    """The protobuf schemas of a recording, built here so that no compiler is needed and each file carries its own."""
    return f"{PACKAGE}.{message}"


@cache
def file_descriptor(message: str) -> FileDescriptorProto:
    """The .proto file that defines one message. Raises KeyError for a name that is not ours."""
    file = FileDescriptorProto(name=f"{PACKAGE}/{message}.proto", package=PACKAGE, syntax="proto3")
    descriptor = file.message_type.add(name=message)
    if message == "Estimates":
        _describe(descriptor, {"stamp_ns": _INT, "samples": _INT})
        _describe(descriptor.nested_type.add(name="Estimate"), _ESTIMATE)
        descriptor.field.add(
            name="estimates",
            number=3,
            type=FieldDescriptorProto.TYPE_MESSAGE,
            label=FieldDescriptorProto.LABEL_REPEATED,
            type_name=f".{PACKAGE}.Estimates.Estimate",
        )
    elif message in ("Event", "Segment"):
        _describe(descriptor, _EVENT if message == "Event" else _SEGMENT)
    else:
        _describe(descriptor, {field.name: _proto_type(field) for field in _fixed_fields(message)})
    return file


def schema_bytes(message: str) -> bytes:
    """The FileDescriptorSet that an MCAP schema with encoding "protobuf" holds."""
    return FileDescriptorSet(file=[file_descriptor(message)]).SerializeToString(deterministic=True)


@cache
def message_class(message: str) -> Any:
    """The protobuf class of one message."""
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file_descriptor(message))
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(full_name(message)))


def layout_in(schema: bytes, name: str) -> Layout:
    """The fixed layout that a file's own schema describes, which may be of another version than ours.

    Raises KeyError where the schema lacks the message or gives it a field of no fixed length.
    """
    files = FileDescriptorSet.FromString(schema).file
    found = {f"{file.package}.{message.name}": message for file in files for message in file.message_type}
    return layout_of([(field.name, field.number, field.type) for field in found[name].field])


def _fixed_fields(message: str) -> Iterable[Field]:
    if message == RAW_MESSAGE:
        return raw_fields(0)
    return fields_of({table.kind.message: table.kind.columns for table in TABLES}[message])


def _proto_type(field: Field) -> int:
    return (BYTES if field.kind is None else KINDS[field.kind]).proto_type


def _describe(descriptor: DescriptorProto, fields: Mapping[str, int]) -> None:
    for number, (name, kind) in enumerate(fields.items(), 1):
        descriptor.field.add(
            name=name,
            number=number,
            type=FieldDescriptorProto.Type.ValueType(kind),
            label=FieldDescriptorProto.LABEL_OPTIONAL,
        )
