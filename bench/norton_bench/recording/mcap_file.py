"""An MCAP file that grows chunk by chunk and is readable up to its last chunk at any moment.

The MCAP library encodes the records; its own writer handles one message at a time, which is twenty times too slow here.
Specification: https://mcap.dev/spec
"""

import os
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO, FileIO
from struct import Struct
from typing import IO, Any

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

from norton_bench.recording.layout import HEADER, Rows
from norton_bench.recording.schemas import PROFILE

CHUNK_BYTES = 16 * 1024
_COPIED_BYTES = 1 << 20
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


def no_room() -> bool:
    """Nothing was kept back."""
    return False


class McapFile:
    """Writes to ``file``, which is unbuffered: what was handed over has reached the operating system.

    ``make_room`` is asked once the file takes no more, and says whether it is worth another try. ``spool`` keeps the
    index of the chunks until the end: beside a long recording in memory, it would grow with it.
    Raises OSError where the file takes no more; what it holds then ends with a whole record.
    """

    def __init__(
        self, file: FileIO, *, make_room: Callable[[], bool] = no_room, spool: IO[bytes] | None = None
    ) -> None:
        self._file = file
        self._make_room = make_room
        self._spool: IO[bytes] = BytesIO() if spool is None else spool
        self._span_ns: tuple[int, int] | None = None
        self._chunk_count = 0
        self._offset = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._blocks: list[Block] = []
        self._pending_bytes = 0
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
        self._write_summary()
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
        index = ChunkIndex(
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
        self._write_to(self._spool, encoded([index]))
        self._chunk_count += 1
        first_ns, last_ns = self._span_ns or (start_ns, end_ns)
        self._span_ns = min(first_ns, start_ns), max(last_ns, end_ns)

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

    def _write_summary(self) -> None:
        """Everything that a reader wants to know before it looks at the messages; the footer has its checksum."""
        start, offsets, checksum = self._offset, [], 0
        for opcode, pieces in self._summary_groups():
            group_start = self._offset
            for piece in pieces:
                self._write(piece)
                checksum = zlib.crc32(piece, checksum)
            if self._offset > group_start:
                offsets.append(SummaryOffset(opcode, group_start, self._offset - group_start))
        offset_start, listed = self._offset, encoded(offsets)
        self._write(listed)
        self._write(_footer(zlib.crc32(listed, checksum), start, offset_start))

    def _summary_groups(self) -> Iterator[tuple[Opcode, Iterable[bytes]]]:
        yield Opcode.SCHEMA, [encoded(self._schemas.values())]
        yield Opcode.CHANNEL, [encoded(self._channels.values())]
        yield Opcode.STATISTICS, [encoded([self._statistics()])]
        self._spool.seek(0)
        yield Opcode.CHUNK_INDEX, iter(lambda: self._spool.read(_COPIED_BYTES), b"")
        yield Opcode.ATTACHMENT_INDEX, [encoded(self._attachments)]
        yield Opcode.METADATA_INDEX, [encoded(self._metadata)]

    def _statistics(self) -> Statistics:
        start_ns, end_ns = self._span_ns or (0, 0)
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=self._chunk_count,
            message_count=self.messages,
            message_end_time=end_ns,
            message_start_time=start_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _put(self, record: McapRecord) -> tuple[int, int]:
        """Offset and length of the record as written."""
        offset = self._offset
        self._write(encoded([record]))
        return offset, self._offset - offset

    def _write(self, data: bytes) -> None:
        try:
            self._write_to(self._file, data)
        except OSError:
            self._take_back()
            raise
        self._offset += len(data)

    def _write_to(self, file: IO[bytes] | FileIO, data: bytes) -> None:
        view = memoryview(data)
        while view:
            try:
                view = view[file.write(view) :]
            except OSError:
                if not self._make_room():
                    raise

    def _take_back(self) -> None:
        """Half a record is worth nothing, and would be in the way of the end."""
        self._file.seek(self._offset)
        with suppress(OSError):
            self._file.truncate()


def encoded(records: Iterable[McapRecord]) -> bytes:
    """Records one after the other."""
    builder: Any = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def _footer(checksum: int, summary_start: int, offset_start: int) -> bytes:
    """The footer, whose checksum goes on from the summary's over the footer's own first fields."""
    unsigned = encoded([Footer(summary_start, offset_start, 0)])[:-4]
    return unsigned + zlib.crc32(unsigned, checksum).to_bytes(4, "little")
