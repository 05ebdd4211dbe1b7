"""The recording process: takes parts from its standard input and brings them to disk, whatever happens to the sender.

Run as ``python -m norton_bench.recording.writer``. It answers on standard output, one JSON object a line:
``{"ready": true, "bytes_s": ...}`` once the file has begun, with how fast the disk takes it; ``{"stop": ...}`` where
the experiment had better end, while it goes on recording; then ``{"messages": ..., "bytes": ...}`` at the end, or
``{"error": ...}`` when it gives up.
"""

import json
import os
import platform
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from io import FileIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, BinaryIO

import numpy as np
from mcap.records import Attachment, Channel, Schema

from norton_bench.recording import frames, wire
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.recording.disk import Place, Reserve, Syncing
from norton_bench.recording.layout import HEADER, MESSAGE_OPCODE, RECORD_PREFIX, Layout, fields_of
from norton_bench.recording.mcap_file import Block, McapFile, no_room
from norton_bench.recording.schemas import (
    ESTIMATES,
    EVENTS,
    FORMAT,
    METADATA,
    OUTCOME,
    RAW_CHANNEL_KEY,
    RAW_MESSAGE,
    RIG_FILE,
    SEGMENTS,
    full_name,
    message_class,
    raw_topic,
    schema_bytes,
)
from norton_bench.records import TABLES, Event, SegmentInfo, Stream

_PACKAGES = ("norton-bench", "numpy", "scipy", "numba", "filterpy", "python-can", "cantools", "pyserial", "mcap")


class RecordingFile:
    """One recording as it is written: puts parts into topics."""

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
        self._layouts = {table.name: Layout(fields_of(table.kind.columns)) for table in TABLES}
        self._mcap.add_metadata(METADATA, {**metadata, **versions(), "format": FORMAT})
        self._mcap.add_attachment(Attachment(0, 0, RIG_FILE, "application/toml", rig_text.encode()))
        self._streams = [(table, self._channel(table.topic, table.kind.message)) for table in TABLES]
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
            if data := part.tables.get(stream.name):
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
        table = np.frombuffer(data, stream.kind.columns)
        rows = self._layouts[stream.name].encode(
            table, channel=channel, first_sequence=self._sequences[channel], stamp=stream.kind.stamp
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


# Of Linux' real-time priorities: below the loop and its helpers (drivers/norton_drivers/real_time.py).
PRIORITY = 5


def record(pipe: BinaryIO) -> dict[str, object]:
    """Record what comes through ``pipe`` until its end. Raises OSError where the files cannot be written."""
    start = wire.receive(pipe)
    if not isinstance(start, wire.Start):
        return {"error": "nothing to record"}
    if start.wall_time:
        _go_first()
    path = Path(start.path)
    with ExitStack() as stack:
        reserve = Reserve(path.parent, start.reserve_bytes)
        spool = stack.enter_context(TemporaryFile(dir=path.parent, buffering=0))
        file = stack.enter_context(FileIO(path, "r+b"))
        log = stack.enter_context(FileIO(start.candump, "r+b")) if start.candump else None
        recording = RecordingFile(file, start.rig_text, start.metadata, make_room=reserve.release, spool=spool)
        say({"ready": True, "bytes_s": reserve.bytes_s})
        place = Place(path, file)
        with Syncing([file] if log is None else [file, log]) as syncing:
            ended = _Intake(recording, log, reserve, syncing, place).work(pipe)
        recording.finish(ended)
        place.restore()
        return {"messages": recording.messages, "bytes": recording.size}


def _go_first() -> None:
    """On a busy machine, parts would wait a tenth of a second for a core; they take one per cent of it."""
    with suppress(OSError, AttributeError):  # AttributeError: no such thing on this system
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


@dataclass
class _Intake:
    """Where parts come in, and what may go wrong with the place that they go to."""

    recording: RecordingFile
    log: FileIO | None
    reserve: Reserve
    syncing: Syncing
    place: Place
    told: bool = False

    def work(self, pipe: BinaryIO) -> dict[str, str]:
        """Take parts until the end; returns how it ended."""
        while (message := wire.receive(pipe)) is not None:
            if isinstance(message, wire.Part):
                self._take(message)
            elif isinstance(message, RecordedEstimates):
                self.recording.add_estimates(message)
            trouble = self._trouble()
            if isinstance(message, wire.Stop):
                return {"ended": trouble or "in good order", "dropped_parts": str(message.dropped_parts)}
            if trouble and not self.told:
                say({"stop": trouble})
                self.told = True
        return {"ended": "the experiment's process went away", "dropped_parts": "unknown"}

    def _take(self, part: wire.Part) -> None:
        self.recording.add(part)
        if self.log is not None and (lines := frames.log_lines(part.frames)):
            self._write_log(self.log, lines)

    def _write_log(self, log: FileIO, lines: bytes) -> None:
        view = memoryview(lines)
        while view:
            try:
                view = view[log.write(view) :]
            except OSError:
                if not self.reserve.release():
                    raise

    def _trouble(self) -> str | None:
        """Why the experiment had better end; what is in the file by then is safe."""
        if self.reserve.used:
            return "the disk is full; what was measured until then is whole; make room and run again"
        return self.syncing.trouble or self.place.trouble()


def say(answer: Mapping[str, object]) -> None:
    """Tell the experiment's process, which may be gone."""
    try:
        print(json.dumps(answer), flush=True)
    except BrokenPipeError:
        sys.stdout = None  # nothing left to flush at exit


def main() -> int:
    try:
        answer = record(sys.stdin.buffer)
    except OSError as error:
        answer = {"error": error.strerror or str(error)}
    say(answer)
    return 1 if "error" in answer else 0


if __name__ == "__main__":
    sys.exit(main())
