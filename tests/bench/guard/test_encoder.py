"""An encoder against itself: what turns as it says passes; jumps, sticking and lies do not."""

import pytest

from norton_bench.guard.check import EMPTY_MODEL
from norton_bench.guard.motion_checks import EncoderAgreement
from norton_bench.sample import Sample
from tests.bench.guard.shafts import TICK_NS, ask, from_tick, resting, turning

BOTH = pytest.mark.parametrize(
    ("which", "position", "velocity"),
    [
        ("actuator encoder", "position_rad", "velocity_rad_s"),
        ("load encoder", "load_position_rad", "load_velocity_rad_s"),
    ],
)


def check(which: str = "actuator encoder", resolution_rad: float = 1e-4) -> EncoderAgreement:
    made = EncoderAgreement(which, resolution_rad)
    made.learn(EMPTY_MODEL)
    return made


@BOTH
def test_a_shaft_that_swings_passes(which: str, position: str, velocity: str) -> None:
    assert ask(check(which), map(turning, range(3000))).tick is None


@BOTH
def test_a_velocity_that_lags_and_is_a_tenth_off_passes(which: str, position: str, velocity: str) -> None:
    samples = [turning(k)._replace(**{velocity: 1.1 * getattr(turning(k - 3), velocity)}) for k in range(3000)]
    assert ask(check(which), samples).tick is None


@BOTH
@pytest.mark.parametrize("motion", [turning, resting])
def test_a_jump_that_stays_is_named_with_its_third_reading(which: str, position: str, velocity: str, motion) -> None:
    samples = from_tick(300, lambda s: s._replace(**{position: getattr(s, position) + 0.4}), motion)
    verdict = ask(check(which), samples)
    assert verdict.tick == 302
    assert verdict.said.startswith(f"{which}: its position is +0.")


def test_a_glitch_passes() -> None:
    samples = [turning(k) for k in range(600)]
    samples[300] = samples[300]._replace(position_rad=5.0)
    assert ask(check(), samples).tick is None


@pytest.mark.parametrize(
    "lie",
    [
        lambda s: s._replace(velocity_rad_s=-s.velocity_rad_s),
        lambda s: s._replace(velocity_rad_s=0.0),
        lambda s: s._replace(position_rad=0.5),
    ],
)
def test_a_lie_is_found_within_a_tenth_of_a_second_of_motion(lie) -> None:
    verdict = ask(check(), from_tick(600, lie))
    assert verdict.tick is not None
    assert 600 < verdict.tick < 800


def test_a_coarse_encoder_steps_by_its_resolution() -> None:
    step_rad = 0.15

    def stepped(tick: int) -> Sample:
        sample = turning(tick)
        return sample._replace(position_rad=step_rad * round(sample.position_rad / step_rad))

    samples = [stepped(k) for k in range(3000)]
    assert ask(check(resolution_rad=step_rad), samples).tick is None
    assert ask(check(resolution_rad=0.0), from_tick(0, lambda s: s._replace(position_rad=3 * s.position_rad))).tick


def test_a_pause_is_bridged_by_nothing() -> None:
    def late(tick: int) -> Sample:
        return turning(tick if tick < 300 else tick + 60)

    assert ask(check(), map(late, range(600))).tick is None


@pytest.mark.parametrize("at_once", [1, 5])
def test_readings_that_were_held_up_and_come_in_a_heap_are_a_pause(at_once: int) -> None:
    def heaped(tick: int) -> Sample:
        """The shaft went on for 50 ms, unseen; then all of it came within a tick, as if it were of that tick."""
        there = turning(tick if tick < 300 else tick + 50)
        return there._replace(tick_ns=turning(tick).tick_ns, motion_count=at_once * (51 if tick == 300 else 1))

    def incomplete(tick: int) -> Sample:
        """Only the first of them found room: what was lost shows in the reading after the heap."""
        return heaped(tick) if tick != 300 else turning(300)._replace(motion_count=at_once * 51)

    assert ask(check(), map(heaped, range(600))).tick is None
    assert ask(check(), map(incomplete, range(600))).tick is None
    alone = (heaped(tick)._replace(motion_count=at_once) for tick in range(600))
    assert ask(check(), alone).tick is not None


def test_what_is_not_new_is_not_looked_at() -> None:
    samples = from_tick(300, lambda s: s._replace(position_rad=9.0, motion_count=0))
    assert ask(check(), samples).tick is None


def test_readings_that_come_with_one_stamp_begin_anew() -> None:
    again = [replace_stamp(turning(k), turning(299)) if k in (300, 301) else turning(k) for k in range(600)]
    assert ask(check(), again).tick is None


def replace_stamp(sample: Sample, other: Sample) -> Sample:
    """``sample`` with the arrival of ``other``'s reading."""
    arrival_ns = other.tick_ns - other.motion_age_ns
    return sample._replace(motion_age_ns=sample.tick_ns - arrival_ns)


def test_the_next_time_begins_afresh() -> None:
    looked = check()
    assert ask(looked, map(turning, range(100))).tick is None
    away = [
        s._replace(tick_ns=s.tick_ns + 200 * TICK_NS, position_rad=s.position_rad + 9) for s in map(turning, range(100))
    ]
    assert ask(looked, away).tick is None
