"""The verdict follows from what is true, and from nothing that the bench says of itself."""

from collections.abc import Sequence

import pytest

from norton_bench.faults.case import Allowed, Case, CaseJudgement, Detection, Expected, Verdict, judge
from norton_bench.rig.rig import Limits
from norton_drivers.ports import TrueState

MS = 1_000_000
LIMITS = Limits(torque_nm=1.0, velocity_rad_s=80.0, stale_after_ns=5 * MS)
BEGUN_NS = 1_000 * MS
BOTH = ("actuator", "load")


def states(off_ms: int, end_ms: int = 500, torque_nm: float = 0.2, velocity_rad_s: float = 10.0) -> list[TrueState]:
    """One a millisecond from 100 ms before the fault on; the drives drive until ``off_ms`` after it."""
    return [
        TrueState(
            BEGUN_NS + at_ms * MS, torque_nm, velocity_rad_s, -velocity_rad_s, BOTH if at_ms <= off_ms else (), ()
        )
        for at_ms in range(-100, end_ms)
    ]


def judged(
    truth: Sequence[TrueState],
    detected_ms: float | None,
    expected: Expected = Expected.STOP,
    watchdogs_s: Sequence[float] = (0.1, 0.3),
    kind: str = "freeze",
) -> CaseJudgement:
    detection = None if detected_ms is None else Detection(BEGUN_NS + round(detected_ms * MS), "somebody")
    case = Case("of this kind", {"kind": kind}, expected)
    return judge(truth, BEGUN_NS, detection, case, allowed=Allowed.of(watchdogs_s, LIMITS, MS), limits=LIMITS)


def test_a_drive_may_go_on_for_its_watchdog_and_two_ticks() -> None:
    assert Allowed.of((0.1, 0.3), LIMITS, MS) == Allowed(302 * MS)


def test_where_one_has_no_watchdog_for_as_long_as_a_silent_device_and_a_late_loop_may_take() -> None:
    assert Allowed.of((0.0, 0.0), LIMITS, MS) == Allowed(57 * MS, watchdogs=False)
    assert Allowed.of((0.0, 0.3), LIMITS, MS) == Allowed(302 * MS, watchdogs=False)


@pytest.mark.parametrize(
    ("off_ms", "kind", "verdict"),
    [
        (57, "freeze", Verdict.STOPPED),
        (57, "host-stall", Verdict.STOPPED),
        (300, "freeze", Verdict.STOPPED),  # no limit was exceeded
        (300, "host-stall", Verdict.NO_WATCHDOG),
        (499, "freeze", Verdict.TOO_LATE),  # never off
        (499, "unplugged", Verdict.NO_WATCHDOG),
    ],
)
def test_without_watchdogs_what_counts_is_whether_the_bench_could_reach_them(
    off_ms: int, kind: str, verdict: Verdict
) -> None:
    found = judged(states(off_ms), 20.0, watchdogs_s=(0.0, 0.0), kind=kind)
    assert found.verdict is verdict
    beyond = judged(states(off_ms, torque_nm=1.1), 20.0, watchdogs_s=(0.0, 0.0), kind=kind)
    late = Verdict.TOO_LATE if kind == "freeze" else Verdict.NO_WATCHDOG
    assert beyond.verdict is (Verdict.STOPPED if off_ms == 57 else late)


def test_a_host_that_is_gone_notices_nothing() -> None:
    gone = {"detected_ms": None, "kind": "host-killed"}
    assert judged(states(499), **gone, watchdogs_s=(0.0, 0.0)).verdict is Verdict.NO_WATCHDOG
    assert judged(states(499), **gone).verdict is Verdict.NOT_DETECTED


@pytest.mark.parametrize(
    ("off_ms", "verdict"),
    [(3, Verdict.STOPPED), (302, Verdict.STOPPED), (303, Verdict.TOO_LATE), (499, Verdict.TOO_LATE)],
)
def test_what_is_noticed_must_be_off_in_time(off_ms: int, verdict: Verdict) -> None:
    found = judged(states(off_ms), detected_ms=2.0)
    assert found.verdict is verdict
    assert found.off_s == (None if off_ms == 499 else pytest.approx(off_ms * 1e-3))


def test_a_fault_that_nobody_noticed_is_not_safe_though_the_session_ended() -> None:
    found = judged(states(200), detected_ms=None)
    assert found.verdict is Verdict.NOT_DETECTED
    assert not found.verdict.safe
    assert found.off_s is None


def test_a_fault_that_may_be_ridden_through_is_safe_within_the_limits_alone() -> None:
    assert judged(states(400), None, Expected.RIDE).verdict is Verdict.RIDDEN_THROUGH
    assert judged(states(400, torque_nm=-1.01), None, Expected.RIDE).verdict is Verdict.BEYOND_LIMITS
    assert judged(states(400, velocity_rad_s=80.1), None, Expected.RIDE).verdict is Verdict.BEYOND_LIMITS


def test_to_stop_at_it_is_no_failure_if_it_is_in_time() -> None:
    assert judged(states(20), 20.0, Expected.RIDE).verdict is Verdict.STOPPED
    assert judged(states(350), 20.0, Expected.RIDE).verdict is Verdict.TOO_LATE


def test_peaks_count_from_the_fault_and_from_its_detection() -> None:
    truth = states(50)
    before, between, later = (
        next(i for i, s in enumerate(truth) if s.stamp_ns == BEGUN_NS + at * MS) for at in (-5, 5, 50)
    )
    truth[before] = truth[before]._replace(torque_nm=9.0, velocity_rad_s=900.0)
    truth[between] = truth[between]._replace(torque_nm=-0.7, load_velocity_rad_s=-70.0)
    truth[later] = truth[later]._replace(torque_nm=0.4, velocity_rad_s=40.0)
    found = judged(truth, detected_ms=10.0)
    assert found.peak == (0.7, 70.0)
    assert found.peak_after == (0.4, 40.0)


def test_how_the_drives_are_left() -> None:
    truth = states(5)
    truth[-1] = truth[-1]._replace(armed=("load",))
    assert judged(truth, 1.0).drives == {"actuator": "idle", "load": "armed, no current"}
    truth[-1] = truth[-1]._replace(armed=BOTH, driving=("actuator",))
    assert judged(truth, 1.0).drives == {"actuator": "drives", "load": "armed, no current"}
