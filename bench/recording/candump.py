"""CAN frames as ``candump -L`` writes them, so that can-utils, python-can and Wireshark can read them.

One line a frame: ``(seconds.microseconds) channel identifier#data R`` or ``T``, for received and sent. Identifiers have
three hexadecimal digits, extended ones eight; error frames carry Linux' flag 0x20000000 in theirs. Serial chunks are
left out. Source: can-utils, lib.c ``sprint_canframe`` and candump.c; python-can, io/canutils.py.
"""

from pathlib import Path

from bench.recording.wire import Frames
from drivers.readings import ERROR_FRAME

# The bench's clock counts nanoseconds, a candump log microseconds.
NS_A_SECOND, NS_A_MICROSECOND = 1_000_000_000, 1_000
SERIAL = -1


def log_name(recording: Path) -> Path:
    """The candump log beside a recording."""
    return recording.with_name(f"{recording.stem}.candump.log")


def log_lines(frames: Frames) -> bytes:
    """The lines of all frames that crossed a CAN bus, in the order in which they were seen."""
    columns = (frames.stamp_ns, frames.channel, frames.sent, frames.data, frames.arbitration_id)
    rows = zip(*columns, frames.extended, frames.remote, strict=True)
    return "".join(_line(*row) for row in rows if row[4] != SERIAL).encode()


def _line(
    stamp_ns: int, channel: str, sent: bool, data: bytes, arbitration_id: int, extended: bool, remote: bool
) -> str:
    seconds, rest_ns = divmod(stamp_ns, NS_A_SECOND)
    wide = extended or arbitration_id & ERROR_FRAME
    identifier = f"{arbitration_id:08X}" if wide else f"{arbitration_id:03X}"
    content = "R" if remote else data.hex().upper()
    name = "_".join(channel.split())
    return f"({seconds}.{rest_ns // NS_A_MICROSECOND:06d}) {name} {identifier}#{content} {'T' if sent else 'R'}\n"
