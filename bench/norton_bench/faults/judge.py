"""What is to be said of a case, from what is true: when both drives were off, and what had happened by then."""

from collections.abc import Sequence
from dataclasses import dataclass

from norton_bench.faults.case import Expected, Peak, Verdict
from norton_bench.rig.rig import Limits
from norton_drivers.rehearsal import TrueState

# Two ticks for what is under way when the watchdogs' period is over.
SPARE_TICKS = 2


def allowed_ns(watchdog_s: float, tick_ns: int) -> int:
    """How long after a fault a drive may go on."""
    return round(watchdog_s * 1e9) + SPARE_TICKS * tick_ns


@dataclass(frozen=True)
class Detection:
    """When and by whom a fault was noticed."""

    stamp_ns: int
    words: str


@dataclass(frozen=True)
class Judgement:
    """See :class:`norton_bench.faults.case.Outcome`."""

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
) -> Judgement:
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
    return Judgement(verdict, off_s, _left(after[-1]), peak, peak_after)


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
