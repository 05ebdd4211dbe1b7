"""Whether a disk has room for a recording, and takes it fast enough: asked before anything moves."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from norton_bench.errors import ExperimentError

# Measured with two drives and a sensor at 1 kHz: recording 410 bytes a tick, candump log 210, what the session keeps
# for its own fits 300. Devices may speak more often than the loop ticks.
BYTES_A_TICK = 1000.0
SLOWEST_RATE_HZ = 1000.0
MEGA = 1e6


@dataclass(frozen=True)
class Need:
    """What a recording will take: bytes a second, for so many seconds of bench time."""

    bytes_s: float = 0.0
    duration_s: float = 0.0

    @staticmethod
    def of(tick_s: float, duration_s: float) -> "Need":
        """About what a bench with this tick needs for a session of this length."""
        return Need(BYTES_A_TICK * max(1.0 / tick_s, SLOWEST_RATE_HZ), duration_s)

    @property
    def bytes(self) -> float:
        return self.bytes_s * self.duration_s


def check_room(folder: Path, need: Need) -> None:
    """Raises ExperimentError where ``folder``, which is there, lies on a disk with less room than that."""
    free = shutil.disk_usage(folder).free
    if free < need.bytes:
        raise ExperimentError(
            f"the {need.duration_s:.0f} s planned take about {need.bytes / MEGA:.0f} MB, and the disk of {folder} has "
            f"{free / MEGA:.0f} MB left; make room, or record elsewhere with --out"
        )


def too_slow(bytes_s: float, need: Need) -> str | None:
    """What is to be said of a disk that takes ``bytes_s``; None where that will do."""
    if bytes_s >= need.bytes_s:
        return None
    return (
        f"the disk takes {bytes_s / MEGA:.2g} MB/s, and recording needs {need.bytes_s / MEGA:.2g} MB/s; "
        "record to a faster one"
    )
