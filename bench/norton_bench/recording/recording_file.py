"""One recording as it is written: parts put into topics."""

import platform
from collections import Counter
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from io import FileIO
from typing import IO

import numpy as np
from mcap.records import Attachment, Channel, Schema

from norton_bench.recording import frames, wire
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.recording.layout import HEADER, MESSAGE_OPCODE, RECORD_PREFIX, Layout, fields_of
from norton_bench.recording.mcap_file import Block, McapFile, no_room
from norton_bench.recording.schemas import full_name, message_class, schema_bytes
from norton_bench.recording.streams import (
    ESTIMATES,
    EVENTS,
    FORMAT,
    METADATA,
    OUTCOME,
    RAW_CHANNEL_KEY,
    RAW_MESSAGE,
    RIG_FILE,
    SEGMENTS,
    STREAMS,
    Stream,
    raw_topic,
)
from norton_bench.records import Event, SegmentInfo

_PACKAGES = ("norton-bench", "numpy", "scipy", "numba", "filterpy", "python-can", "cantools", "pyserial", "mcap")


class RecordingFile:
    """One recording: puts parts into topics."""

    def __init__(
        self,
        file: FileIO,
        rig_text: str,
        metadata: Mapping[str, str],
        *,
        make_room: Callable[[], bool] = no_room,
        spool: IO[bytes] | None = None,
    ) -> None:
        self._mcap = McapFile(file, make_room=make_room, spool=spool)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequences: Counter[int] = Counter()
        self._raw_frames = 0
        self._layouts = {stream.table: Layout(fields_of(stream.dtype)) for stream in STREAMS}
        self._mcap.add_metadata(METADATA, {**metadata, **versions(), "format": FORMAT})
        self._mcap.add_attachment(Attachment(0, 0, RIG_FILE, "application/toml", rig_text.encode()))
        self._streams = [(stream, self._channel(stream.topic, stream.message)) for stream in STREAMS]
        for topic, message in ((EVENTS, "Event"), (SEGMENTS, "Segment"), (ESTIMATES, "Estimates")):
            self._channel(topic, message)

    @property
    def messages(self) -> int:
        return self._mcap.messages

    @property
    def size(self) -> int:
        return self._mcap.size

    def add(self, part: wire.Part) -> None:
        """Write a part so that it survives the death of both processes."""
        for stream, channel in self._streams:
            if data := part.tables.get(stream.table):
                self._add_table(stream, channel, data)
        for rows in frames.encode(part.frames, self._raw_channel, self._raw_frames):
            self._mcap.add(Block.of(rows))
        self._raw_frames += len(part.frames.stamp_ns)
        for segment in part.segments:
            self._add_segment(segment)
        for event in part.events:
            self._add_event(event)
        self._mcap.flush()

    def add_estimates(self, live: RecordedEstimates) -> None:
        message = message_class("Estimates")(stamp_ns=live.stamp_ns, samples=live.samples)
        for estimate in live.estimates:
            message.estimates.add(
                name=estimate.name,
                value=estimate.value,
                std=estimate.std,
                unit=estimate.unit,
                status=estimate.status.value,
            )
        self._add_message(self._channels[ESTIMATES], live.stamp_ns, message.SerializeToString())

    def finish(self, outcome: Mapping[str, str]) -> None:
        self._mcap.add_metadata(OUTCOME, outcome)
        self._mcap.finish()

    def _add_table(self, stream: Stream, channel: int, data: bytes) -> None:
        table = np.frombuffer(data, stream.dtype)
        rows = self._layouts[stream.table].encode(
            table, channel=channel, first_sequence=self._sequences[channel], stamp=stream.stamp
        )
        self._sequences[channel] += len(table)
        self._mcap.add(Block.of(rows))

    def _add_segment(self, segment: SegmentInfo) -> None:
        message = message_class("Segment")(
            index=segment.index,
            procedure=segment.procedure,
            name=segment.name,
            use=segment.use.value,
            mode=segment.mode,
            start_ns=segment.start_ns,
            end_ns=segment.end_ns,
            preview=segment.preview,
        )
        self._add_message(self._channels[SEGMENTS], segment.start_ns, message.SerializeToString())

    def _add_event(self, event: Event) -> None:
        message = message_class("Event")(stamp_ns=event.stamp_ns, kind=event.kind, text=event.text)
        self._add_message(self._channels[EVENTS], event.stamp_ns, message.SerializeToString())

    def _add_message(self, channel: int, stamp_ns: int, payload: bytes) -> None:
        header = np.zeros(1, HEADER)
        header["op"] = MESSAGE_OPCODE
        header["len"] = HEADER.itemsize - RECORD_PREFIX + len(payload)
        header["chan"] = channel
        header["seq"] = self._sequences[channel]
        header["log"] = header["pub"] = max(stamp_ns, 0)  # MCAP knows no time before its epoch
        self._sequences[channel] += 1
        record = header.tobytes() + payload
        self._mcap.add(Block(channel, len(record), record))

    def _raw_channel(self, name: str) -> int:
        return self._channel(raw_topic(name), RAW_MESSAGE, {RAW_CHANNEL_KEY: name})

    def _channel(self, topic: str, message: str, metadata: Mapping[str, str] | None = None) -> int:
        """The channel's number; its schema and itself are made known to the file on first use."""
        if topic not in self._channels:
            if message not in self._schemas:
                self._schemas[message] = len(self._schemas) + 1
                schema = Schema(self._schemas[message], schema_bytes(message), "protobuf", full_name(message))
                self._mcap.add_schema(schema)
            self._channels[topic] = len(self._channels) + 1
            self._mcap.add_channel(
                Channel(self._channels[topic], topic, "protobuf", dict(metadata or {}), self._schemas[message])
            )
        return self._channels[topic]


def versions() -> dict[str, str]:
    """What the recording was made with."""
    found = {"version.python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[f"version.{package}"] = version(package)
        except PackageNotFoundError:
            continue
    return found
