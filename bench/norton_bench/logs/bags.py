"""Bags of ROS and MCAP files of other programs to columns, each with times of its own.

rosbags decodes ROS messages, protobuf its own; what kind a message is stands in the file, never here.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.logs.messages import Collector, Columns
from norton_bench.on_demand import extra
from norton_bench.recording.schemas import PROFILE

STORAGES = (".mcap", ".db3")
METADATA = "metadata.yaml"
PURPOSE = "reading bags of ROS"

Decode = Callable[[bytes], object]


@dataclass(frozen=True)
class Raw:
    """One message as it was stored. ``decode`` is None where its kind is not known, ``kind`` names it."""

    topic: str
    kind: str
    log_ns: int
    data: bytes
    decode: Decode | None


def is_bag(folder: Path) -> bool:
    """Whether a folder is that of a bag."""
    return folder.is_dir() and (
        (folder / METADATA).is_file() or any(each.suffix in STORAGES for each in folder.iterdir())
    )


def is_of_others(path: Path) -> bool:
    """Whether an MCAP file says that another program recorded it; a file that cannot be read does not."""
    from mcap.records import Header  # noqa: PLC0415
    from mcap.stream_reader import StreamReader  # noqa: PLC0415

    try:
        with path.open("rb") as file:
            first = next(StreamReader(file).records)
    except Exception:  # nothing there, a folder, or something else inside
        return False
    return isinstance(first, Header) and first.profile != PROFILE


def read_bag(path: Path) -> Columns:
    """Every number of every message as columns; what could not be read is said in the remarks.

    Raises UsageError where no message can be read.
    """
    collector, unread = Collector(), Counter[str]()
    cut = ""
    try:
        for raw in _messages(path):
            if raw.decode is None:
                unread[f"{raw.topic} ({raw.kind})"] += 1
                continue
            try:
                collector.add(raw.topic, raw.log_ns, raw.decode(raw.data))
            except Exception:  # each library has errors of its own; the message is what they say it is not
                unread[f"{raw.topic} ({raw.kind})"] += 1
    except UsageError:
        raise
    except Exception as wrong:  # likewise: the file ends, or goes on with something else
        cut = " ".join(f"{type(wrong).__name__} {wrong}".split())[:160]
    columns = collector.columns()
    remarks = [f"{path}: messages of {topic} cannot be decoded: {count} set aside." for topic, count in unread.items()]
    if not columns.arrays:
        raise UsageError(_nothing(path, cut, unread, collector.topics))
    if cut:
        remarks.append(
            f"{path}: is damaged or ends in the middle ({cut}); the {collector.count} messages before that are used."
        )
    return Columns(columns.arrays, columns.times_s, (*remarks, *(f"{path}: {each}" for each in columns.remarks)))


def _nothing(path: Path, cut: str, unread: Counter[str], topics: tuple[str, ...]) -> str:
    """Why a bag gives no column, and what to do about it."""
    if cut:
        return f"{path}: is damaged from its beginning ({cut}); copy it again, or mend it with {_mended_by(path)}"
    if unread:
        known = ", ".join(list(unread)[:5])
        return (
            f"{path}: no message can be decoded, for the kinds of {known} are not known here; record joint states, or "
            "write a table (CSV) with PlotJuggler"
        )
    if topics:
        return f"{path}: none of its topics ({', '.join(topics[:5])}) holds numbers; record joint states"
    return f"{path}: holds no message; check what was recorded"


def _mended_by(path: Path) -> str:
    """The command that makes the most of a damaged file of this kind."""
    if path.suffix in (".mcap", ".bag"):
        return "mcap recover" if path.suffix == ".mcap" else "rosbag reindex"
    return "ros2 bag reindex (its metadata), or sqlite3 FILE.db3 .recover (its messages)"


def _messages(path: Path) -> Iterator[Raw]:
    """In the order of the file or files. Raises whatever the libraries raise for a damaged one."""
    if path.suffix == ".bag":
        rosbag1 = extra("rosbags.rosbag1", PURPOSE)
        yield from _of_rosbags(rosbag1.Reader(path), ros1=True)
    elif path.suffix == ".mcap":
        yield from _of_mcap(path)
    elif not path.is_dir():
        yield from _of_rosbags(extra("rosbags.rosbag2", PURPOSE).Reader(path), ros1=False)
    elif storages := sorted(path.glob("*.mcap"), key=_numbered):
        for each in storages:
            yield from _of_mcap(each)
    elif (path / METADATA).is_file():
        yield from _of_rosbags(extra("rosbags.rosbag2", PURPOSE).Reader(path), ros1=False)
    else:
        for each in sorted(path.glob("*.db3"), key=_numbered):
            yield from _of_rosbags(extra("rosbags.rosbag2", PURPOSE).Reader(each), ros1=False)


def _numbered(path: Path) -> tuple[int, str]:
    """rosbag2 numbers the parts of a recording without leading zeros."""
    return len(path.name), path.name


def _of_rosbags(reader: Any, *, ros1: bool) -> Iterator[Raw]:
    with reader:
        formats = extra("rosbags.interfaces", PURPOSE).MessageDefinitionFormat
        words = {formats.MSG: "msg", formats.IDL: "idl", formats.NONE: ""}
        decoders = {
            each.id: _ros(each.msgtype, words[each.msgdef.format], each.msgdef.data, ros1=ros1)
            for each in reader.connections
        }
        for connection, log_ns, data in reader.messages():
            yield Raw(connection.topic, connection.msgtype, log_ns, data, decoders[connection.id])


def _of_mcap(path: Path) -> Iterator[Raw]:
    from mcap.records import Channel, Message, Schema  # noqa: PLC0415
    from mcap.stream_reader import StreamReader  # noqa: PLC0415

    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[Channel, str, Decode | None]] = {}
    with closing(path.open("rb")) as file:
        for record in StreamReader(file).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel) and record.id not in channels:
                schema = schemas.get(record.schema_id)
                kind = schema.name if schema is not None and schema.name else record.message_encoding
                channels[record.id] = (record, kind, _decoder(record.message_encoding, schema))
            elif isinstance(record, Message):
                channel, kind, decode = channels[record.channel_id]
                yield Raw(channel.topic, kind, record.log_time, record.data, decode)


def _decoder(encoding: str, schema: Any) -> Decode | None:
    """For the messages of an MCAP channel; None where their encoding, or their schema, is not known."""
    if encoding == "json":
        return json.loads
    if schema is None:
        return None
    if (encoding, schema.encoding) == ("protobuf", "protobuf"):
        return _protobuf(schema.name, schema.data)
    language = {"ros2msg": "msg", "ros2idl": "idl", "ros1msg": "msg"}.get(schema.encoding)
    if encoding not in ("cdr", "ros1") or language is None:
        return None
    return _ros(schema.name, language, schema.data.decode(errors="replace"), ros1=encoding == "ros1")


def _ros(kind: str, language: str, definition: str, *, ros1: bool) -> Decode | None:
    """By the definition in the file; older bags hold none, and theirs must be one of ROS's own messages."""
    typesys = extra("rosbags.typesys", PURPOSE)
    try:
        if not language:
            store = typesys.get_typestore(typesys.Stores.LATEST)
        else:
            store = typesys.get_typestore(typesys.Stores.EMPTY)
            store.register(_types(typesys, kind, language, definition))
        name = kind if kind in store.fielddefs else kind.replace("/", "/msg/")
        if name not in store.fielddefs:
            return None
    except Exception:  # a definition that is none: said of its messages
        return None
    deserialize = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    return lambda data: deserialize(data, name)


def _types(typesys: Any, kind: str, language: str, definition: str) -> dict[str, Any]:
    if language == "msg":
        return dict(typesys.get_types_from_msg(definition, kind))
    # Several IDL files in one, each behind a line of "=" and one with its name.
    rule = "=" * 80 + "\n"
    files = [each.split("\n", 1)[1] for each in definition.split(rule)[1:]] or [definition]
    return {name: fields for each in files for name, fields in typesys.get_types_from_idl(each).items()}


def _protobuf(kind: str, schema: bytes) -> Decode | None:
    from google.protobuf import descriptor_pool, message_factory  # noqa: PLC0415
    from google.protobuf.descriptor_pb2 import FileDescriptorSet  # noqa: PLC0415

    pool = descriptor_pool.DescriptorPool()
    try:
        for file in FileDescriptorSet.FromString(schema).file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(kind)).FromString
    except Exception:  # a schema that is none: said of its messages
        return None
