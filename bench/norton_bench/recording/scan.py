"""Reads through an MCAP file as far as it is undamaged, without its index: for reading and for recovery."""

import mmap
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from norton_bench.errors import UsageError
from norton_bench.recording.mcap_file import Block

_FRAME = struct.Struct("<BQ")  # opcode, record length
_FRAME_AND_CHANNEL = struct.Struct("<BQH")
_RUN_LIMIT = 4096  # records compared at once

Buffer = bytes | memoryview
KeepChannel = Callable[[Channel], bool]


@dataclass
class Scan:
    """What was found: ``sound_bytes`` until the first record that is cut off, ``damaged`` chunks skipped on the way.

    ``blocks`` holds runs of message records in the order of the file. ``finished`` says that the end mark was reached.
    """

    size: int
    finished: bool = False
    sound_bytes: int = 0
    damaged: int = 0
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)

    def entries(self, name: str) -> dict[str, str]:
        """A metadata record's content, empty where there is none."""
        return next((record.metadata for record in self.metadata if record.name == name), {})


def scan(path: Path, *, keep: KeepChannel = lambda _: True) -> Scan:
    """Everything undamaged in the file, of the channels for which ``keep`` is true.

    Raises UsageError where the file cannot be opened or is no MCAP file.
    """
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise UsageError(f"{path} is {'empty' if size == 0 else 'not an MCAP recording'}; name a .mcap file")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as view:
                return _scan(memoryview(view), size, keep)
    except FileNotFoundError as error:
        raise UsageError(f"there is no recording {path}; check the name") from error
    except IsADirectoryError as error:
        raise UsageError(f"{path} is a folder; name the .mcap file in it") from error
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}; check who may read it") from error


def _scan(data: memoryview, size: int, keep: KeepChannel) -> Scan:
    found = Scan(size)
    with data:
        for opcode, start, length in _records(data, len(MCAP0_MAGIC)):
            with data[start : start + length] as content:
                _take_if_sound(found, opcode, bytes(content), keep)
            found.sound_bytes = start + length
            if opcode == Opcode.FOOTER:
                found.finished = data[found.sound_bytes :] == MCAP0_MAGIC
                break
    return found


def _records(data: memoryview, start: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and length of the content of every record that is there in full."""
    while start + _FRAME.size <= len(data):
        opcode, length = _FRAME.unpack_from(data, start)
        start += _FRAME.size
        if start + length > len(data):
            return
        yield opcode, start, length
        start += length


def _take_if_sound(found: Scan, opcode: int, content: bytes, keep: KeepChannel) -> None:
    try:
        _take(found, opcode, content, keep)
    except (struct.error, ValueError, EndOfFile):
        found.damaged += 1


def _take(found: Scan, opcode: int, content: bytes, keep: KeepChannel) -> None:
    """One record of the data section. What stands in the summary is known already."""
    stream: Any = ReadDataStream(BytesIO(content))
    if opcode == Opcode.CHUNK:
        _take_chunk(found, Chunk.read(stream), keep)
    elif opcode == Opcode.ATTACHMENT:
        found.attachments.append(Attachment.read(stream))
    elif opcode == Opcode.METADATA:
        found.metadata.append(Metadata.read(stream))
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        _take_definition(found, opcode, stream)
    elif opcode == Opcode.MESSAGE:
        _take_messages(found, _FRAME.pack(opcode, len(content)) + content, 0, keep)


def _take_definition(found: Scan, opcode: int, stream: Any) -> None:
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        found.schemas[schema.id] = schema
    else:
        channel = Channel.read(stream)
        found.channels[channel.id] = channel


def _take_chunk(found: Scan, chunk: Chunk, keep: KeepChannel) -> None:
    try:
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
        data = stream.read(length) if length else b""
    except Exception:  # whatever a decompressor says to damaged bytes
        found.damaged += 1
        return
    _take_messages(found, data, 0, keep)


def _take_messages(found: Scan, data: bytes, start: int, keep: KeepChannel) -> None:
    """The content of a chunk: runs of messages, and definitions between them."""
    while start + _FRAME.size <= len(data):
        opcode, length = _FRAME.unpack_from(data, start)
        size = _FRAME.size + length
        if opcode == Opcode.MESSAGE:
            block = _run(data, start, size)
            if block.channel in found.channels and keep(found.channels[block.channel]):
                found.blocks.append(block)
            size = len(block.data)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            _take_definition(found, opcode, ReadDataStream(BytesIO(data[start + _FRAME.size : start + size])))
        start += size


def _run(data: bytes, start: int, size: int) -> Block:
    """The messages from ``start`` on that share channel and size."""
    first = data[start : start + _FRAME_AND_CHANNEL.size]
    channel = _FRAME_AND_CHANNEL.unpack(first)[2]
    count = 1
    if data[start + size : start + size + len(first)] == first:
        possible = min((len(data) - start) // size, _RUN_LIMIT)
        matrix = np.frombuffer(data, np.uint8, possible * size, start).reshape(possible, size)
        same = (matrix[:, : len(first)] == np.frombuffer(first, np.uint8)).all(axis=1)
        count = possible if same.all() else int(np.argmin(same))
    return Block(channel, size, data[start : start + count * size])
