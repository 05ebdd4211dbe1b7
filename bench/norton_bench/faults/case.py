"""One fault on one rig, and its result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import isfinite, nan
from typing import Any, NamedTuple

from norton_bench.rig.rig import Limits
from norton_drivers.ports import TrueState


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
class CaseResult:
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


# Two ticks for what is under way when the watchdogs' period is over.
SPARE_TICKS = 2


# What is to be said of a case, from what is true: when both drives were off, and what had happened by then.
def allowed_ns(watchdog_s: float, tick_ns: int) -> int:
    """How long after a fault a drive may go on."""
    return round(watchdog_s * 1e9) + SPARE_TICKS * tick_ns


@dataclass(frozen=True)
class Detection:
    """When and by whom a fault was noticed."""

    stamp_ns: int
    words: str


@dataclass(frozen=True)
class CaseJudgement:
    """See :class:`norton_bench.faults.case.CaseResult`."""

    verdict: Verdict
    off_s: float | None
    drives: dict[str, str]
    peak: Peak
    peak_after: Peak


def judge(
    states: Sequence[TrueState],
    begun_ns: int,
    detection: Detection | None,
    expected: Expected,
    *,
    allowed_ns: int,
    limits: Limits,
) -> CaseJudgement:
    """``states`` reach from before the fault until long after the session, and the last tells how the drives were left;
    ``allowed_ns`` is what a drive may take to be off, from the fault on."""
    after = [state for state in states if state.stamp_ns >= begun_ns]
    off_ns = off_after_ns(after, begun_ns)
    peak = _peak(after)
    noticed_ns = begun_ns if detection is None else detection.stamp_ns
    peak_after = _peak([state for state in after if state.stamp_ns >= noticed_ns])
    if detection is not None:
        verdict = Verdict.STOPPED if off_ns is not None and off_ns <= allowed_ns else Verdict.TOO_LATE
    elif expected is Expected.STOP:
        verdict = Verdict.NOT_DETECTED
    else:
        within = peak.torque_nm <= limits.torque_nm and peak.velocity_rad_s <= limits.velocity_rad_s
        verdict = Verdict.RIDDEN_THROUGH if within else Verdict.BEYOND_LIMITS
    off_s = None if off_ns is None or detection is None else off_ns * 1e-9
    return CaseJudgement(verdict, off_s, _left(after[-1]), peak, peak_after)


def off_after_ns(after: Sequence[TrueState], begun_ns: int) -> int | None:
    """How long after the fault a drive was last seen to drive its motor; None where one still does at the end."""
    if after[-1].driving:
        return None
    return max((state.stamp_ns - begun_ns for state in after if state.driving), default=0)


def _peak(states: Sequence[TrueState]) -> Peak:
    return Peak(
        max(abs(state.torque_nm) for state in states),
        max(max(abs(state.velocity_rad_s), abs(state.load_velocity_rad_s)) for state in states),
    )


def _left(state: TrueState) -> dict[str, str]:
    """How the drives are left. One that has no idle state stays armed, with no current."""

    def of(role: str) -> str:
        if role in state.driving:
            return "drives"
        return "armed, no current" if role in state.armed else "idle"

    return {role: of(role) for role in ("actuator", "load")}
