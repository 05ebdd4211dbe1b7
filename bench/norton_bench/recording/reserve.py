"""Room kept back on the disk for the day it is full, so that a recording can still be ended in good order."""

import os
import time
from math import inf
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

# A recording's last parts and its summary; the summary takes about 10 bytes a tick.
RESERVE_BYTES = 8 << 20
_BLOCK_BYTES = 1 << 20


class Reserve:
    """``size`` bytes in a file without a name, in ``folder``; it is gone with the process that holds it.

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
