"""The disk under a recording: its room, a reserve, steady syncing, and whether the file is still where it was made."""

import os
import shutil
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from math import inf
from pathlib import Path
from tempfile import TemporaryFile
from threading import Event, Thread
from typing import IO

from norton_bench.errors import ExperimentError

# Measured with two drives and a sensor at 1 kHz: recording 410 bytes a tick, candump log 210, what the session keeps
# for its own fits 300. Devices may speak more often than the loop ticks.
BYTES_A_TICK = 1000.0
SLOWEST_RATE_HZ = 1000.0
MEGA = 1e6


@dataclass(frozen=True)
class Need:
    """Whether a disk has room for a recording, and takes it fast enough: asked before anything moves.

    What a recording will take: bytes a second, for so many seconds of bench time.
    """

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


# A recording's last parts and its summary; the summary takes about 10 bytes a tick.
RESERVE_BYTES = 8 << 20
_BLOCK_BYTES = 1 << 20


class Reserve:
    """Room kept back on the disk for the day it is full, so that a recording can still be ended in good order.

    ``size`` bytes in a file without a name, in ``folder``; it is gone with the process that holds it.

    Raises OSError where the disk has not even that much room.
    """

    def __init__(self, folder: Path, size: int = RESERVE_BYTES) -> None:
        self.bytes_s = inf  # what the disk takes, as far as was tried
        self.used = False
        self._file: IO[bytes] | None = None
        if size:
            self._file = TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115  (held until its room is needed)
            self.bytes_s = _written_bytes_s(self._file, size)

    def release(self) -> bool:
        """Give the room back; False where that was done before."""
        if self._file is None:
            return False
        self._file.close()
        self._file, self.used = None, True
        return True


def _written_bytes_s(file: IO[bytes], size: int) -> float:
    """How fast the disk takes ``size`` bytes, by its best block: others may have been waiting for someone else.

    Not zeros: a file system may know how to store those for nothing.
    """
    fastest, left = 0.0, size
    while left:
        block = os.urandom(min(left, _BLOCK_BYTES))
        begun_s = time.perf_counter()
        written = file.write(block)
        os.fsync(file.fileno())
        fastest = max(fastest, written / (time.perf_counter() - begun_s))
        left -= written
    return fastest


SYNC_INTERVAL_S = 0.7


class Syncing:
    """Brings files onto the disk at a steady pace, in a thread: a slow disk must not hold up what is being received.

    Inside, ``files`` are brought onto the disk every ``interval_s``, whether anything comes or not.
    """

    def __init__(self, files: Sequence[FileIO], interval_s: float = SYNC_INTERVAL_S) -> None:
        self.trouble: str | None = None
        self._files = files
        self._interval_s = interval_s
        self._over = Event()
        self._thread = Thread(target=self._sync, name="fsync", daemon=True)

    def __enter__(self) -> "Syncing":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _sync(self) -> None:
        while not self._over.wait(self._interval_s):
            try:
                for file in self._files:
                    os.fsync(file.fileno())
            except OSError as error:
                self.trouble = f"the disk reports: {error.strerror or error}; run again, with --out on another disk"
                return


class Place:
    """Whether a file that is being written still stands where it was made; and if not, back with it.

    ``file`` is open, and was made at ``path``.
    """

    def __init__(self, path: Path, file: FileIO) -> None:
        self._path = path
        self._file = file

    def trouble(self) -> str | None:
        """What became of it in words; None as long as it is there."""
        if self._there():
            return None
        if self._deleted():
            return "the file was deleted while it was being written; it is written there anew"
        return f"the file was moved while it was being written; it is whole in {self._now_at()}"

    def restore(self) -> None:
        """Write a file that was deleted anew where it was, with its folder. Raises OSError where that cannot be."""
        if self._there() or not self._deleted():
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("xb") as copy:
            self._file.seek(0)
            shutil.copyfileobj(self._file, copy)
            copy.flush()
            os.fsync(copy.fileno())

    def _there(self) -> bool:
        try:
            return os.path.samestat(self._path.stat(), os.fstat(self._file.fileno()))
        except OSError:
            return False

    def _deleted(self) -> bool:
        return os.fstat(self._file.fileno()).st_nlink == 0

    def _now_at(self) -> str:
        """By its new name where the system tells, as Linux does."""
        with suppress(OSError):
            return str(Path(f"/proc/self/fd/{self._file.fileno()}").readlink())
        return "its new place"
