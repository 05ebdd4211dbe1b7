"""What tests ask of processes that are not theirs."""

import time
from collections.abc import Callable
from pathlib import Path


def process_lives(pid: int) -> bool:
    try:
        return _stat(pid)[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def children(pid: int) -> list[int]:
    """Of its main thread."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def cpu_ticks(pid: int) -> int:
    """How long it has run, in hundredths of a second on most systems."""
    words = _stat(pid)
    return int(words[11]) + int(words[12])


def soon(true: Callable[[], bool], within_s: float) -> float:
    """How long it took."""
    began_s = time.monotonic()
    while not true():
        assert time.monotonic() - began_s < within_s
        time.sleep(0.002)
    return time.monotonic() - began_s


def _stat(pid: int) -> list[str]:
    """From the state on: the name before it may have any letters in it."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
