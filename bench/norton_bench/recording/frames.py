"""Raw frames to message records and back, in bulk: frames of one channel and one length share a layout."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.recording.layout import Layout, Rows
from norton_bench.recording.schemas import raw_fields
from norton_bench.recording.wire import Frames
from norton_drivers.readings import ERROR_FRAME, RawFrame

ALL_NAMES = frozenset(field.name for field in raw_fields(0))


@cache
def raw_layout(length: int, names: frozenset[str] = ALL_NAMES) -> Layout:
    """The layout of frames that carry ``length`` bytes, in a file that has the fields ``names`` of them."""
    return Layout(tuple(field for field in raw_fields(length) if field.name in names))


def length_of(record_bytes: int, names: frozenset[str] = ALL_NAMES) -> int:
    """How many bytes of data a raw record of this size carries. Raises ValueError for an impossible size."""
    for tag_bytes in range(1, 5):  # the length's own length depends on it
        length = record_bytes - raw_layout(0, names).record.itemsize + 1 - tag_bytes
        if length >= 0 and raw_layout(length, names).record.itemsize == record_bytes:
            return length
    raise ValueError("message of another length")


def encode(frames: Frames, channel_id: Callable[[str], int], first_sequence: int) -> Iterator[Rows]:
    """Records in groups of one channel and one length. Their sequence numbers keep the order of arrival."""
    if not frames.stamp_ns:
        return
    ids = {name: channel_id(name) for name in dict.fromkeys(frames.channel)}
    channels = np.array([ids[name] for name in frames.channel])
    lengths = np.array([len(data) for data in frames.data])
    columns: dict[str, npt.NDArray[Any]] = {
        "stamp_ns": np.array(frames.stamp_ns, np.int64),
        "arbitration_id": np.array(frames.arbitration_id, np.int32),
        "sent": np.array(frames.sent),
        "extended": np.array(frames.extended),
        "remote": np.array(frames.remote),
        "fd": np.array(frames.fd),
        "switched": np.array(frames.switched),
    }
    for channel, length in sorted(set(zip(channels.tolist(), lengths.tolist(), strict=True))):
        places = np.flatnonzero((channels == channel) & (lengths == length))
        rows = raw_layout(length).blank(len(places), channel)
        rows["seq"] = (first_sequence + places).astype(np.uint32)
        rows["log"] = rows["pub"] = columns["stamp_ns"][places].astype(np.uint64)
        for name, values in columns.items():
            rows[name] = values[places]
        data = b"".join(frames.data[place] for place in places.tolist())
        rows["data"] = np.frombuffer(data, np.uint8).reshape(-1, length) if length else 0
        yield rows


def decode(groups: Sequence[tuple[str, Rows]]) -> tuple[RawFrame, ...]:
    """The frames of all (channel, records) groups, in their order of arrival."""
    sequences: list[int] = []
    frames: list[RawFrame] = []
    for channel, rows in groups:
        sequences += rows["seq"].tolist()
        frames += _frames(channel, rows)
    return tuple(frames[place] for place in np.argsort(np.array(sequences), kind="stable").tolist())


def _frames(channel: str, rows: Rows) -> Iterator[RawFrame]:
    data = np.ascontiguousarray(rows["data"])
    length, joined = data.shape[1], data.tobytes()
    present, lacking = rows.dtype.names or (), [False] * len(rows)
    names = ("stamp_ns", "sent", "arbitration_id", "extended", "remote", "fd", "switched")
    columns = [rows[name].tolist() if name in present else lacking for name in names]
    for place, (stamp_ns, sent, *kind) in enumerate(zip(*columns, strict=True)):
        yield RawFrame(stamp_ns, channel, sent, joined[place * length : (place + 1) * length], *kind)


# The bench's clock counts nanoseconds, a candump log microseconds.
NS_A_SECOND, NS_A_MICROSECOND, MICROSECONDS_A_SECOND = 1_000_000_000, 1_000, 1_000_000
SERIAL = -1
CANFD_BRS = 1  # Linux, include/uapi/linux/can.h


def log_name(recording: Path) -> Path:
    """CAN frames as ``candump -L`` writes them, so that can-utils, python-can and Wireshark can read them.

    One line a frame: ``(seconds.microseconds) channel identifier#data R`` or ``T``, for received and sent; a CAN FD
    frame has ``##`` and a digit of flags, 1 where its data went at the second bit rate. Identifiers have three
    hexadecimal digits, extended ones eight; error frames carry Linux' flag 0x20000000 in theirs. Serial chunks are left
    out. Source: can-utils, lib.c ``sprint_canframe`` and candump.c; python-can, io/canutils.py.

    The candump log beside a recording.
    """
    return recording.with_name(f"{recording.stem}.candump.log")


def log_lines(frames: Frames) -> bytes:
    """The lines of all frames that crossed a CAN bus, in the order in which they were seen."""
    told = (frames.stamp_ns, frames.sent, frames.data, frames.remote, frames.fd, frames.switched)
    rows = zip(*told, frames.channel, frames.arbitration_id, frames.extended, strict=True)
    return "".join(
        [
            f"({stamp_ns // NS_A_SECOND}.{stamp_ns // NS_A_MICROSECOND % MICROSECONDS_A_SECOND:06d}) {_place(*place)}#"
            f"{'#' if fd else ''}{CANFD_BRS * switched if fd else ''}{'R' if remote else data.hex().upper()} "
            f"{'T' if sent else 'R'}\n"
            for stamp_ns, sent, data, remote, fd, switched, *place in rows
            if place[1] != SERIAL
        ]
    ).encode()


@lru_cache(maxsize=256)  # a bus has few identifiers, each seen a thousand times a second
def _place(channel: str, arbitration_id: int, extended: bool) -> str:
    """Channel and identifier."""
    wide = extended or arbitration_id & ERROR_FRAME
    return f"{'_'.join(channel.split())} {arbitration_id:0{8 if wide else 3}X}"
