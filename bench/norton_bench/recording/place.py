"""Whether a file that is being written still stands where it was made; and if not, back with it."""

import os
import shutil
from contextlib import suppress
from io import FileIO
from pathlib import Path


class Place:
    """``file`` is open, and was made at ``path``."""

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
