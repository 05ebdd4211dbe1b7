"""Two encoders on one shaft: twist passes, going apart does not."""

from math import inf

import pytest

from norton_bench.guard.check import EMPTY_MODEL, GuardModel
from norton_bench.guard.motion_checks import CouplingCheck
from norton_bench.sample import Sample
from tests.bench.guard.shafts import ask, from_tick, resting, turning

STIFF = GuardModel(sensor_stiffness_nm_rad=200.0)


def check(twist_rad: float = 0.5, resolution_rad: float = 1e-4, known: GuardModel = EMPTY_MODEL) -> CouplingCheck:
    made = CouplingCheck(twist_rad, 1.0, resolution_rad, 1e-3)
    made.learn(known)
    return made


def offset(by_rad: float):
    return lambda sample: sample._replace(load_position_rad=sample.load_position_rad + by_rad)


@pytest.mark.parametrize("known", [EMPTY_MODEL, STIFF])
def test_a_shaft_that_swings_passes_wherever_its_encoders_begin(known: GuardModel) -> None:
    assert ask(check(known=known), map(offset(7.0), map(turning, range(2000)))).tick is None


def test_readings_that_travel_for_different_times_pass() -> None:
    def late(tick: int) -> Sample:
        past = turning(tick - 3)
        return turning(tick)._replace(
            load_position_rad=past.load_position_rad, load_velocity_rad_s=past.load_velocity_rad_s
        )

    assert ask(check(known=STIFF), map(late, range(2000))).tick is None


@pytest.mark.parametrize(
    ("twist_rad", "known", "by_rad", "found"),
    [
        (0.5, EMPTY_MODEL, 0.45, False),
        (0.5, EMPTY_MODEL, 0.55, True),
        (0.5, STIFF, 0.04, False),
        (0.5, STIFF, 0.06, True),  # 1 N m twists 200 N m/rad by 5 mrad
        (0.5, GuardModel(sensor_stiffness_nm_rad=20.0), 0.15, False),
        (0.5, GuardModel(sensor_stiffness_nm_rad=20.0), 0.25, True),
        (0.03, STIFF, 0.04, True),  # the rig's own limit is never widened
        (0.5, GuardModel(sensor_stiffness_nm_rad=0.1), 0.55, True),
        (inf, STIFF, 100.0, False),
    ],
)
def test_how_far_apart_is_too_far(twist_rad: float, known: GuardModel, by_rad: float, found: bool) -> None:
    verdict = ask(check(twist_rad, known=known), from_tick(300, offset(by_rad), resting))
    assert (verdict.tick == 302) is found
    assert ("an encoder jumped" in verdict.said) is found


def test_a_jump_that_goes_back_passes() -> None:
    samples = [turning(k) for k in range(600)]
    samples[300] = offset(1.0)(samples[300])
    assert ask(check(), samples).tick is None


@pytest.mark.parametrize(
    ("fault", "suspicion"),
    [
        (lambda s: s._replace(position_rad=0.3, velocity_rad_s=0.0), "the actuator's encoder stands still"),
        (lambda s: s._replace(load_position_rad=0.3, load_velocity_rad_s=0.0), "the load's encoder stands still"),
        (lambda s: s._replace(load_position_rad=-s.load_position_rad), "they turn opposite ways"),
        (lambda s: s._replace(load_position_rad=2 * s.load_position_rad), "the coupling broke or slips"),
    ],
)
def test_the_cause_is_guessed_from_how_they_went(fault, suspicion: str) -> None:
    verdict = ask(check(0.1), from_tick(300, fault))
    assert verdict.tick is not None
    assert suspicion in verdict.said


def test_one_bad_reading_of_a_slow_drive_passes_however_long_it_stands() -> None:
    bad = [offset(1.0)(resting(k))._replace(load_motion_new=k == 300) for k in range(300, 320)]
    samples = [*map(resting, range(300)), *bad, *map(resting, range(320, 600))]
    assert ask(check(), samples).tick is None


@pytest.mark.parametrize("age", ["motion_age_ns", "load_motion_age_ns"])
def test_old_readings_are_not_compared(age: str) -> None:
    samples = from_tick(300, lambda s: offset(1.0)(s)._replace(**{age: 40_000_000}))
    assert ask(check(), samples).tick is None


def test_where_the_encoders_stand_counts_from_each_beginning() -> None:
    looked = check()
    assert ask(looked, map(resting, range(100))).tick is None
    assert ask(looked, map(offset(3.0), map(resting, range(100)))).tick is None
