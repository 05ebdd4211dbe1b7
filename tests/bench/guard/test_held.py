"""A shaft on its bench that gives to no torque is held, or its encoder is stuck."""

from dataclasses import replace

import pytest

from norton_bench.guard.check import EMPTY_MODEL, GuardModel
from norton_bench.guard.motion_checks import HeldShaft
from norton_bench.sample import Sample
from tests.bench.guard.shafts import TICK_NS, ask, resting, turning

KNOWN = GuardModel(sensor_stiffness_nm_rad=200.0, still_swing_nm=0.02)
COUNT_RAD = 5e-5


def check(known: GuardModel = KNOWN, resolution_rad: float = COUNT_RAD) -> HeldShaft:
    made = HeldShaft(1.0, resolution_rad)
    made.learn(known)
    return made


def rising(tick: int, per_s: float = 1.0) -> Sample:
    """Held from the beginning, under a port torque that grows."""
    return resting(tick)._replace(torque_nm=per_s * 1e-3 * tick)


@pytest.mark.parametrize("per_s", [4.0, -4.0])
def test_a_shaft_that_stands_whatever_pulls_at_it_is_found_after_a_tenth_of_a_second(per_s: float) -> None:
    verdict = ask(check(), (rising(k, per_s) for k in range(1000)))
    assert verdict.tick == 101
    assert "stands still at 0 rad for 100 ms while the port torque goes from" in verdict.said
    assert "where a swing of 0.1 N m is the most that left it so before" in verdict.said


def test_a_slow_torque_is_given_its_time() -> None:
    assert ask(check(), (rising(k, 0.2) for k in range(1000))).tick == pytest.approx(501, abs=1)


@pytest.mark.parametrize(
    ("known", "resolution_rad", "found"),
    [
        (replace(KNOWN, still_swing_nm=0.29), COUNT_RAD, True),
        (replace(KNOWN, still_swing_nm=0.31), COUNT_RAD, False),
        (replace(KNOWN, sensor_stiffness_nm_rad=4000.0), COUNT_RAD, True),
        (replace(KNOWN, sensor_stiffness_nm_rad=5000.0), COUNT_RAD, False),
        (KNOWN, 2e-3, False),
        (replace(KNOWN, still_swing_nm=None), COUNT_RAD, False),
        (replace(KNOWN, sensor_stiffness_nm_rad=None), COUNT_RAD, False),
        (EMPTY_MODEL, COUNT_RAD, False),
    ],
)
def test_by_how_much_the_torque_may_change(known: GuardModel, resolution_rad: float, found: bool) -> None:
    held = (rising(k, 0.9) for k in range(1000))
    assert (ask(check(known, resolution_rad), held).tick is not None) is found


def test_a_shaft_that_gives_passes() -> None:
    def giving(tick: int) -> Sample:
        return rising(tick)._replace(position_rad=COUNT_RAD * (tick // 60))

    assert ask(check(), map(giving, range(3000))).tick is None
    assert ask(check(), map(turning, range(3000))).tick is None


def test_a_shaft_at_rest_under_a_torque_that_stays_passes() -> None:
    assert ask(check(), (resting(k)._replace(torque_nm=0.8) for k in range(3000))).tick is None


def test_an_encoder_that_is_silent_does_not_stand_still() -> None:
    assert ask(check(), (rising(k)._replace(motion_age_ns=40_000_000) for k in range(1000))).tick is None


def test_the_next_time_begins_afresh() -> None:
    looked = check()
    assert ask(looked, (resting(k)._replace(torque_nm=0.0) for k in range(500))).tick is None
    later = [resting(k)._replace(tick_ns=resting(k).tick_ns + 700 * TICK_NS, torque_nm=0.5) for k in range(500)]
    assert ask(looked, later).tick is None
