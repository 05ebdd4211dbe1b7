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
    NO_WATCHDOG = "no watchdog"  # a drive goes on that the bench cannot reach, for it has no watchdog
    FAILED = "failed"  # the case itself came to nothing
    SKIPPED = "skipped"  # this machine cannot try it

    @property
    def safe(self) -> bool:
        return self in (Verdict.STOPPED, Verdict.RIDDEN_THROUGH)

    @property
    def tried(self) -> bool:
        return self is not Verdict.SKIPPED

    @property
    def fails(self) -> bool:
        """Whether the bench could have ended it safely, and did not."""
        return self.tried and not self.safe and self is not Verdict.NO_WATCHDOG


class Peak(NamedTuple):
    """The greatest true values, without their signs: at the port, and of either machine."""

    torque_nm: float = nan
    velocity_rad_s: float = nan


NO_PEAK = Peak()
# Kinds of faults after which a drive may hear nothing of the bench: only a watchdog of its own ends what it does.
OUT_OF_REACH = ("dropout", "unplugged", "bus-off", "babbling-node", "host-stall", "host-killed", "host-stopped")


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

    @property
    def out_of_reach(self) -> bool:
        """Whether a drive without a watchdog cannot be stopped."""
        return self.table["kind"] in OUT_OF_REACH


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
    watchdogs: bool = True  # whether each drive has one
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
@dataclass(frozen=True)
class Allowed:
    """How long after a fault a drive may go on; ``watchdogs`` says whether each drive has one."""

    ns: int
    watchdogs: bool = True

    @classmethod
    def of(cls, watchdogs_s: Sequence[float], limits: Limits, tick_ns: int) -> "Allowed":
        """The longest period of the drives' watchdogs. Where a drive has none, what the bench may take to see that a
        device is silent and its loop late; and whatever it takes, if no limit is exceeded."""
        watchdogs = min(watchdogs_s) > 0
        period_ns = round(max(watchdogs_s) * 1e9)
        if not watchdogs:
            period_ns = max(period_ns, limits.stale_after_ns + limits.stall_after_ns)
        return cls(period_ns + SPARE_TICKS * tick_ns, watchdogs)


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
    case: Case,
    *,
    allowed: Allowed,
    limits: Limits,
) -> CaseJudgement:
    """``states`` reach from before the fault until long after the session; the last tells how the drives were left."""
    after = [state for state in states if state.stamp_ns >= begun_ns]
    off_ns = off_after_ns(after, begun_ns)
    peak = _peak(after)
    noticed_ns = begun_ns if detection is None else detection.stamp_ns
    peak_after = _peak([state for state in after if state.stamp_ns >= noticed_ns])
    within = peak.torque_nm <= limits.torque_nm and peak.velocity_rad_s <= limits.velocity_rad_s
    if detection is None and case.expected is Expected.RIDE:
        verdict = Verdict.RIDDEN_THROUGH if within else Verdict.BEYOND_LIMITS
    else:
        verdict = _ended(off_ns, case, allowed, noticed=detection is not None, within=within)
    off_s = None if off_ns is None or detection is None else off_ns * 1e-9
    return CaseJudgement(verdict, off_s, _left(after[-1]), peak, peak_after)


def _ended(off_ns: int | None, case: Case, allowed: Allowed, *, noticed: bool, within: bool) -> Verdict:
    """Of a fault that was noticed, or should have been."""
    if not noticed:
        off_ns = None
    if off_ns is not None and off_ns <= allowed.ns:
        return Verdict.STOPPED
    if case.out_of_reach and not allowed.watchdogs:
        return Verdict.NO_WATCHDOG
    if off_ns is not None and within and not allowed.watchdogs:
        return Verdict.STOPPED
    return Verdict.TOO_LATE if noticed else Verdict.NOT_DETECTED


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
