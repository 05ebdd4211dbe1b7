"""One fault on one rig, and what came of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import isfinite, nan
from typing import Any, NamedTuple


class Expected(Enum):
    """What a bench should make of a fault."""

    STOP = "stop"  # notice it, and have both drives off in time
    RIDE = "ride through"  # go on, and stay within its limits; to stop in time is no failure


class Verdict(Enum):
    """What it did."""

    STOPPED = "stopped"
    RIDDEN_THROUGH = "ridden through"
    NOT_DETECTED = "not detected"
    TOO_LATE = "too late"  # a drive went on for longer than it may
    BEYOND_LIMITS = "beyond limits"  # nothing was noticed, and a limit was exceeded in truth
    FAILED = "failed"  # the case itself came to nothing
    SKIPPED = "skipped"  # this machine cannot try it

    @property
    def safe(self) -> bool:
        return self in (Verdict.STOPPED, Verdict.RIDDEN_THROUGH)


class Peak(NamedTuple):
    """The greatest true values, without their signs: at the port, and of either machine."""

    torque_nm: float = nan
    velocity_rad_s: float = nan


NO_PEAK = Peak()


@dataclass(frozen=True)
class Case:
    """A fault as a session file would say it; unless it says when, it begins amid motion under a changing command."""

    name: str
    table: Mapping[str, Any]
    expected: Expected = Expected.STOP
    quick: bool = False  # belongs to the short round

    @property
    def on(self) -> str:
        return str(self.table.get("on", "bench"))


@dataclass(frozen=True)
class Outcome:
    """What came of a case. Times count from when the fault began; NaN or None stands for what did not happen.

    ``off_s`` is when no drive drove its motor any more, where the fault was noticed. ``peak`` counts from the fault on,
    ``peak_after`` from when it was noticed. ``hits`` are the frames that the fault lost, held up or changed.
    """

    fault: str
    on: str
    family: str
    rig: str
    expected: Expected
    verdict: Verdict
    guard: str = ""  # who noticed, in his own words
    detected_s: float | None = None
    off_s: float | None = None
    allowed_s: float = nan
    drives: Mapping[str, str] = field(default_factory=dict)  # role -> state
    peak: Peak = NO_PEAK
    peak_after: Peak = NO_PEAK
    hits: int = 0
    longest_silence_s: float = nan
    counted: tuple[str, ...] = ()  # what the bench itself counted

    @property
    def evidence(self) -> str:
        """What shows that a fault that was ridden through has been there, and was no danger."""
        parts = [f"{self.hits} hit on their way"] if self.hits else []
        if isfinite(self.longest_silence_s):
            parts.append(f"longest silence {self.longest_silence_s * 1e3:.1f} ms")
        return "; ".join([*parts, *self.counted])
