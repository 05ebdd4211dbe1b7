"""CAN frames as ``candump -L`` writes them, so that can-utils, python-can and Wireshark can read them.

One line a frame: ``(seconds.microseconds) channel identifier#data R`` or ``T``, for received and sent. Identifiers have
three hexadecimal digits, extended ones eight; error frames carry Linux' flag 0x20000000 in theirs. Serial chunks are
left out. Source: can-utils, lib.c ``sprint_canframe`` and candump.c; python-can, io/canutils.py.
"""

from functools import lru_cache
from pathlib import Path

from norton_bench.recording.wire import Frames
from norton_drivers.readings import ERROR_FRAME

# The bench's clock counts nanoseconds, a candump log microseconds.
NS_A_SECOND, NS_A_MICROSECOND, MICROSECONDS_A_SECOND = 1_000_000_000, 1_000, 1_000_000
SERIAL = -1


def log_name(recording: Path) -> Path:
    """The candump log beside a recording."""
    return recording.with_name(f"{recording.stem}.candump.log")


def log_lines(frames: Frames) -> bytes:
    """The lines of all frames that crossed a CAN bus, in the order in which they were seen."""
    told = (frames.stamp_ns, frames.sent, frames.data, frames.remote)
    rows = zip(*told, frames.channel, frames.arbitration_id, frames.extended, strict=True)
    return "".join(
        [
            f"({stamp_ns // NS_A_SECOND}.{stamp_ns // NS_A_MICROSECOND % MICROSECONDS_A_SECOND:06d}) {_place(*place)}#"
            f"{'R' if remote else data.hex().upper()} {'T' if sent else 'R'}\n"
            for stamp_ns, sent, data, remote, *place in rows
            if place[1] != SERIAL
        ]
    ).encode()


@lru_cache(maxsize=256)  # a bus has few identifiers, each seen a thousand times a second
def _place(channel: str, arbitration_id: int, extended: bool) -> str:
    """Channel and identifier."""
    wide = extended or arbitration_id & ERROR_FRAME
    return f"{'_'.join(channel.split())} {arbitration_id:0{8 if wide else 3}X}"
