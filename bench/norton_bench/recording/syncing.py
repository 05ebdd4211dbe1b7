"""Brings files onto the disk at a steady pace, in a thread: a slow disk must not hold up what is being received."""

import os
from collections.abc import Sequence
from io import FileIO
from threading import Event, Thread

SYNC_INTERVAL_S = 0.7


class Syncing:
    """Inside, ``files`` are brought onto the disk every ``interval_s``, whether anything comes or not."""

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
