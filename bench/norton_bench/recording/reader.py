"""Reads a recording back into the form in which it was measured."""

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Channel

from norton_bench.errors import UsageError
from norton_bench.models.parameters import Estimate, Status
from norton_bench.recording import frames
from norton_bench.recording.contents import RecordedEstimates, Recording
from norton_bench.recording.layout import HEADER, Rows, table_from
from norton_bench.recording.scan import KeepChannel, Scan, scan
from norton_bench.recording.schemas import (
    ESTIMATES,
    EVENTS,
    METADATA,
    OUTCOME,
    RAW_CHANNEL_KEY,
    RAW_PREFIX,
    RIG_FILE,
    SEGMENTS,
    layout_in,
    message_class,
    raw_names,
)
from norton_bench.records import TABLES, Chain, Event, Measured, SegmentInfo, Stream, Table
from norton_bench.segments import Use
from norton_drivers.readings import RawFrame
from norton_drivers.servo import Servo


def read_recording(path: Path, *, raw_frames: bool = True) -> Recording:
    """The recording at ``path``; without its raw frames, which are most of the work, where they are not wanted.

    Raises UsageError, with the mend, where the file is missing, is not one of our recordings, or was cut off.
    """
    return recording_in(_sound(path, _keeping(raw_frames)), path)


def read_happenings(path: Path) -> tuple[Mapping[str, str], tuple[Event, ...]]:
    """The recording's metadata and events; also of one that was cut off.

    Raises UsageError where the file is missing or is not one of ours.
    """
    found = scan(path, keep=lambda channel: channel.topic == EVENTS)
    return _metadata(found, path), tuple(_event(message) for message in _messages(found, EVENTS, "Event"))


def _keeping(raw_frames: bool) -> KeepChannel:
    return lambda channel: raw_frames or not channel.topic.startswith(RAW_PREFIX)


def _sound(path: Path, keep: KeepChannel) -> Scan:
    found = scan(path, keep=keep)
    if not found.finished or found.damaged:
        raise UsageError(
            f"the recording {path} is {_fault(found)}; rescue what it holds with: norton-bench recover {path}"
        )
    return found


def _metadata(found: Scan, path: Path) -> Mapping[str, str]:
    metadata = found.entries(METADATA)
    if not metadata:
        raise UsageError(f"{path} was not recorded by norton-bench; name one of its recordings")
    return metadata


def read_so_far(path: Path, *, raw_frames: bool = True) -> Recording:
    """As :func:`read_recording`, of a recording that is still being written, or was cut off: what it holds by now.

    Raises UsageError where the file is missing or is not one of ours.
    """
    return recording_in(scan(path, keep=_keeping(raw_frames)), path)


def recording_in(found: Scan, path: Path) -> Recording:
    """The recording as far as the scan found it. Raises UsageError where it is not one of ours."""
    metadata = _metadata(found, path)
    try:
        segments = tuple(_segment(message) for message in _messages(found, SEGMENTS, "Segment"))
        measured = _measured(found, segments, _chain(metadata))
        live = tuple(_estimates(message) for message in _messages(found, ESTIMATES, "Estimates"))
    except (ValueError, KeyError, DecodeError) as error:
        raise UsageError(
            f"{path} is in format {metadata.get('format', '?')}, which this version cannot read ({error})"
        ) from error
    outcome = found.entries(OUTCOME)
    return Recording(
        measured=measured,
        rig_text=next((file.data.decode() for file in found.attachments if file.name == RIG_FILE), ""),
        metadata=metadata,
        complete=outcome.get("ended") == "in good order" and outcome.get("dropped_parts") == "0",
        live=live,
        part_ends_ns=tuple(dict.fromkeys(segment.end_ns for segment in segments)),  # written again with every part
    )


def _fault(found: Scan) -> str:
    if not found.finished:
        return f"cut off after {found.sound_bytes} of {found.size} bytes"
    return f"damaged in {found.damaged} place{'s' if found.damaged > 1 else ''}"


def _chain(metadata: Mapping[str, str]) -> Chain:
    return Chain(
        float(metadata.get("torque_averaging_s", "0")),
        frozenset(metadata.get("released_at_zero", "").split()),
        Servo(**json.loads(metadata["servo"])) if metadata.get("servo") else None,
        frozenset(metadata.get("answers_commands", "").split()),
    )


def _measured(found: Scan, segments: Iterable[SegmentInfo], chain: Chain) -> Measured:
    return Measured(
        **cast(dict[str, Any], {stream.name: _table(found, stream) for stream in TABLES}),
        segments=tuple({segment.index: segment for segment in segments}.values()),
        events=tuple(_event(message) for message in _messages(found, EVENTS, "Event")),
        frames=frames_in(found),
        chain=chain,
    )


def _table(found: Scan, stream: Stream) -> Table:
    kind = stream.kind
    pieces = [table_from(rows, kind.columns) for _, rows in _fixed_rows(found, stream.topic)]
    table = np.concatenate(pieces) if pieces else np.empty(0, kind.columns)
    stamps = table[kind.stamp]
    return table if (np.diff(stamps) >= 0).all() else table[np.argsort(stamps, kind="stable")]


def frames_in(found: Scan) -> tuple[RawFrame, ...]:
    """The raw frames, in their order of arrival."""
    topics = [channel.topic for channel in found.channels.values() if channel.topic.startswith(RAW_PREFIX)]
    return frames.decode([(_wire_name(channel), rows) for topic in topics for channel, rows in _raw_rows(found, topic)])


def _wire_name(channel: Channel) -> str:
    return channel.metadata.get(RAW_CHANNEL_KEY, channel.topic.removeprefix(RAW_PREFIX))


def _fixed_rows(found: Scan, topic: str) -> Iterator[tuple[Channel, Rows]]:
    """The records of a table's topic, decoded by the layout that the file itself describes."""
    for channel, _, data in _joined(found, topic):
        schema = found.schemas[channel.schema_id]
        yield channel, layout_in(schema.data, schema.name).decode(data)


def _raw_rows(found: Scan, topic: str) -> Iterator[tuple[Channel, Rows]]:
    for channel, size, data in _joined(found, topic):
        names = raw_names(found.schemas[channel.schema_id].data)
        yield channel, frames.raw_layout(frames.length_of(size, names), names).decode(data)


def _joined(found: Scan, topic: str) -> Iterator[tuple[Channel, int, bytes]]:
    """For every channel of the topic and every size of record on it: channel, size, and all those records."""
    parts: dict[tuple[int, int], list[bytes]] = {}
    for block in found.blocks:
        if found.channels[block.channel].topic == topic:
            parts.setdefault((block.channel, block.size), []).append(block.data)
    for (channel, size), data in parts.items():
        yield found.channels[channel], size, b"".join(data)


def _messages(found: Scan, topic: str, message: str) -> Iterator[Any]:
    """The protobuf messages of a topic whose messages are of any length, in the order of the file."""
    kind = message_class(message)
    for block in found.blocks:
        if found.channels[block.channel].topic == topic:
            for start in range(0, len(block.data), block.size):
                yield kind.FromString(block.data[start + HEADER.itemsize : start + block.size])


def _segment(message: Any) -> SegmentInfo:
    return SegmentInfo(
        index=message.index,
        procedure=message.procedure,
        name=message.name,
        use=Use(message.use),
        mode=message.mode,
        start_ns=message.start_ns,
        end_ns=message.end_ns,
        preview=message.preview,
    )


def _event(message: Any) -> Event:
    return Event(message.stamp_ns, message.kind, message.text)


def _estimates(message: Any) -> RecordedEstimates:
    estimates = tuple(
        Estimate(item.name, item.value, item.std, item.unit, Status(item.status)) for item in message.estimates
    )
    return RecordedEstimates(message.stamp_ns, message.samples, estimates)
