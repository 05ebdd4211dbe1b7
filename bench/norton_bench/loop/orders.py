"""What a session says to a loop in a process of its own, and what it answers: small messages over a pipe.

Every order but :class:`Idle` gets one answer, :class:`Done` or :class:`Failed`. After :class:`Enable` is done, segments
are run until :class:`Idle`, or until one fails: either way the drives are idle when :class:`Idled` comes.
"""

from dataclasses import dataclass
from typing import Any

from norton_bench.loop.learned import Learned
from norton_bench.segments import Segment


@dataclass(frozen=True)
class Identify:
    """Answered with the devices' identities."""


@dataclass(frozen=True)
class VerifyWatchdogs:
    """Answered with one finding for each drive."""


@dataclass(frozen=True)
class Learn:
    """Know this."""

    learned: Learned


@dataclass(frozen=True)
class ResetGuard:
    """The operator says that the bench is safe."""

    word: str


@dataclass(frozen=True)
class Enable:
    """Enable the drives."""


@dataclass(frozen=True)
class Run:
    """Answered with what :class:`norton_bench.records.SegmentInfo` there is to say of it."""

    segment: Segment


@dataclass(frozen=True)
class Idle:
    """Idle the drives, at once, because of ``error`` or because all has been done."""

    error: Exception | None = None


@dataclass(frozen=True)
class Close:
    """The session needs the loop no more."""


Order = Identify | VerifyWatchdogs | Learn | ResetGuard | Enable | Run | Idle | Close


@dataclass(frozen=True)
class Done:
    """An order was carried out."""

    value: Any = None


@dataclass(frozen=True)
class Failed:
    """An order was not."""

    error: Exception


@dataclass(frozen=True)
class Idled:
    """The drives are idle; ``error`` is why, where it was not asked for."""

    error: Exception | None = None


class LeaveError(Exception):
    """In the loop's process: the session wants the drives idle, whatever runs."""

    def __init__(self, idle: Idle) -> None:
        super().__init__(idle)
        self.idle = idle
