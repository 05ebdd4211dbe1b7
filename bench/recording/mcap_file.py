"""An MCAP file that grows chunk by chunk and is readable up to its last chunk at any moment.

The MCAP library encodes the records; its own writer handles one message at a time, which is twenty times too slow here.
Specification: https://mcap.dev/spec
"""

import os
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from io import FileIO
from struct import Struct
from typing import Any

import numpy as np
import numpy.typing as npt
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import LIBRARY_IDENTIFIER, MCAP0_MAGIC

from bench.recording.layout import HEADER, Rows
from bench.recording.streams import PROFILE

CHUNK_BYTES = 16 * 1024
_MESSAGE_INDEX = Struct("<BQHI")  # opcode, record length, channel, bytes of entries
_INDEX_ENTRY = np.dtype([("log", "<u8"), ("offset", "<u8")])


@dataclass(frozen=True)
class Block:
    """Message records of one channel, all of one size, one after the other."""

    channel: int
    size: int
    data: bytes

    @staticmethod
    def of(rows: Rows) -> "Block":
        """The block of at least one encoded row."""
        return Block(int(rows["chan"][0]), rows.dtype.itemsize, rows.tobytes())

    @property
    def count(self) -> int:
        return len(self.data) // self.size

    def log_times(self) -> npt.NDArray[np.uint64]:
        """Log time [ns] of every record, shape (count,)."""
        start, width = HEADER.fields["log"][1], HEADER["log"].itemsize  # type: ignore[index]
        matrix = np.frombuffer(self.data, np.uint8).reshape(-1, self.size)
        return np.ascontiguousarray(matrix[:, start : start + width]).view("<u8").ravel()

    def pieces(self, limit: int) -> "list[Block]":
        """The same records in blocks of about ``limit`` bytes at most."""
        step = max(1, limit // self.size) * self.size
        parts = range(0, len(self.data), step)
        return [Block(self.channel, self.size, self.data[start : start + step]) for start in parts]


class McapFile:
    """Writes to ``file``, which is unbuffered: what was handed over has reached the operating system."""

    def __init__(self, file: FileIO) -> None:
        self._file = file
        self._offset = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._blocks: list[Block] = []
        self._pending_bytes = 0
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._write(MCAP0_MAGIC)
        self._put(Header(PROFILE, LIBRARY_IDENTIFIER))

    @property
    def messages(self) -> int:
        return self._counts.total()

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._offset

    def add_schema(self, schema: Schema) -> None:
        if schema.id not in self._schemas:
            self._schemas[schema.id] = schema
            self._put(schema)

    def add_channel(self, channel: Channel) -> None:
        if channel.id not in self._channels:
            self._channels[channel.id] = channel
            self._put(channel)

    def add_attachment(self, attachment: Attachment) -> None:
        self.flush()
        offset, length = self._put(attachment)
        self._attachments.append(
            AttachmentIndex(
                offset,
                length,
                attachment.log_time,
                attachment.create_time,
                len(attachment.data),
                attachment.name,
                attachment.media_type,
            )
        )

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        self.flush()
        offset, length = self._put(Metadata(name, dict(entries)))
        self._metadata.append(MetadataIndex(offset, length, name))

    def add(self, block: Block) -> None:
        """Append messages; a chunk that is full is written at once."""
        for piece in block.pieces(CHUNK_BYTES):
            self._blocks.append(piece)
            self._pending_bytes += len(piece.data)
            if self._pending_bytes >= CHUNK_BYTES:
                self.flush()

    def flush(self) -> None:
        """Write the messages that wait for a full chunk."""
        if self._blocks:
            blocks, self._blocks, self._pending_bytes = self._blocks, [], 0
            self._write_chunk(blocks)

    def sync(self) -> None:
        """Bring everything written onto the disk."""
        os.fsync(self._file.fileno())

    def finish(self) -> None:
        """Write what is pending, the summary and the end mark, and bring all of it onto the disk."""
        self.flush()
        self._put(DataEnd(0))
        self._write(self._summary())
        self._write(MCAP0_MAGIC)
        self.sync()

    def _write_chunk(self, blocks: list[Block]) -> None:
        data = b"".join(block.data for block in blocks)
        times = np.concatenate([block.log_times() for block in blocks])
        start_ns, end_ns = int(times.min()), int(times.max())
        compressed = zstandard.compress(data, 1)
        offset, length = self._put(Chunk("zstd", compressed, end_ns, start_ns, zlib.crc32(data), len(data)))
        index_start = self._offset
        index_offsets = self._write_message_indexes(blocks)
        self._chunks.append(
            ChunkIndex(
                length,
                offset,
                "zstd",
                len(compressed),
                end_ns,
                self._offset - index_start,
                index_offsets,
                start_ns,
                len(data),
            )
        )

    def _write_message_indexes(self, blocks: list[Block]) -> dict[int, int]:
        """Where in the file each channel's index stands."""
        entries: dict[int, list[bytes]] = {}
        place = 0
        for block in blocks:
            index = np.empty(block.count, _INDEX_ENTRY)
            index["log"] = block.log_times()
            index["offset"] = place + np.arange(block.count) * block.size
            entries.setdefault(block.channel, []).append(index.tobytes())
            self._counts[block.channel] += block.count
            place += len(block.data)
        return {channel: self._write_message_index(channel, b"".join(parts)) for channel, parts in entries.items()}

    def _write_message_index(self, channel: int, entries: bytes) -> int:
        offset = self._offset
        self._write(_MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries)
        return offset

    def _summary(self) -> bytes:
        groups: dict[Opcode, list[McapRecord]] = {
            Opcode.SCHEMA: list(self._schemas.values()),
            Opcode.CHANNEL: list(self._channels.values()),
            Opcode.STATISTICS: [self._statistics()],
            Opcode.CHUNK_INDEX: list(self._chunks),
            Opcode.ATTACHMENT_INDEX: list(self._attachments),
            Opcode.METADATA_INDEX: list(self._metadata),
        }
        body = b""
        offsets: list[McapRecord] = []
        for opcode, records in groups.items():
            group = encoded(records)
            if group:
                offsets.append(SummaryOffset(opcode, self._offset + len(body), len(group)))
            body += group
        offset_start = self._offset + len(body)
        body += encoded(offsets)
        return body + _footer(body, self._offset, offset_start)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self.messages,
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _put(self, record: McapRecord) -> tuple[int, int]:
        """Offset and length of the record as written."""
        offset = self._offset
        self._write(encoded([record]))
        return offset, self._offset - offset

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]
        self._offset += len(data)


def encoded(records: Iterable[McapRecord]) -> bytes:
    """Records one after the other."""
    builder: Any = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def _footer(summary: bytes, summary_start: int, offset_start: int) -> bytes:
    """The footer, whose checksum covers the summary and the footer's own first fields."""
    unsigned = encoded([Footer(summary_start, offset_start, 0)])[:-4]
    return unsigned + zlib.crc32(summary + unsigned).to_bytes(4, "little")
