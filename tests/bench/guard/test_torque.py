"""The torque sensor by itself: frozen, at its end, jumping; and a free shaft that must turn."""

from dataclasses import replace
from math import inf

import pytest

from norton_bench.guard.check import EMPTY_MODEL, Commands, GuardModel, Machine, TorqueReadings
from norton_bench.guard.motion_checks import Standstill
from norton_bench.guard.torque_checks import FrozenTorque, SaturationCheck, TorqueJump
from norton_bench.sample import Sample
from tests.bench.guard.shafts import ask, from_tick, resting, turning


def habits(longest_repeat: int | None = 2, period_s: float = 1e-3, greatest_step_nm: float | None = 0.02) -> GuardModel:
    return GuardModel(
        torque=TorqueReadings(0.03, 1e-3, period_s, longest_repeat, greatest_step_nm),
        actuator=Machine(0.9, 5e-5, 1e-3, 0.02),
        load=Machine(0.95, 1.2e-4, 3e-4, 0.008),
    )


def shows(torque_nm: float):
    return lambda sample: sample._replace(torque_nm=torque_nm)


# ---- frozen ---------------------------------------------------------------------------------------------------------


def frozen(known: GuardModel) -> FrozenTorque:
    made = FrozenTorque(1e-3)
    made.learn(known)
    return made


def test_a_sensor_that_lives_passes() -> None:
    assert ask(frozen(habits()), map(turning, range(2000))).tick is None


def test_a_sensor_that_stands_still_is_found_after_a_twentieth_of_a_second() -> None:
    verdict = ask(frozen(habits()), from_tick(300, shows(0.25)))
    assert verdict.tick == 350
    assert "gives 0.25 N m in 51 readings in a row" in verdict.said


def test_a_sensor_that_is_slow_to_change_is_given_ten_times_what_it_took() -> None:
    assert ask(frozen(habits(longest_repeat=40)), from_tick(300, shows(0.25))).tick == 700


def test_readings_that_are_not_new_do_not_count() -> None:
    samples = from_tick(300, lambda s: s._replace(torque_nm=0.25, torque_new=s.tick_ns % 10_000_000 == 0))
    assert ask(frozen(habits()), samples).tick == pytest.approx(800, abs=10)
    assert ask(frozen(habits(period_s=0.01)), samples).tick == pytest.approx(500, abs=10)  # 2 seen in a row: 20


def clipped(run: int):
    """Rows of so many equal readings, each after three others."""
    return lambda k: shows(0.25) if k % (run + 3) >= 3 else (lambda sample: sample)


def test_at_the_end_of_its_range_a_sensor_repeats_itself_for_a_while_again_and_again() -> None:
    """20 − 3 are left of each row: two of them and 16 of the third are more than 50."""
    samples = [clipped(20)(k)(sample) for k, sample in enumerate(map(turning, range(1000)))]
    verdict = ask(frozen(habits()), samples)
    assert verdict.tick == 3 * 23 - 4
    assert "in 17 readings in a row, after 34 in such rows" in verdict.said


def test_rows_that_a_resting_sensor_might_show_do_not_add_up() -> None:
    samples = [clipped(10)(k)(sample) for k, sample in enumerate(map(turning, range(2000)))]
    assert ask(frozen(habits()), samples).tick is None


def test_a_slow_loop_sees_fewer_readings_and_finds_it_as_soon() -> None:
    made = FrozenTorque(2.5e-3)
    made.learn(habits())
    assert ask(made, from_tick(300, shows(0.25))).tick == 320  # twenty of its ticks


def test_of_a_coarse_sensor_nothing_is_said() -> None:
    assert ask(frozen(habits(longest_repeat=None)), from_tick(0, shows(0.25))).tick is None


def test_before_the_tare_nothing_is_said_of_standing_still() -> None:
    assert ask(frozen(EMPTY_MODEL), from_tick(0, shows(0.25))).tick is None


# ---- at the end of the range ----------------------------------------------------------------------------------------


def at_end(known: GuardModel = EMPTY_MODEL) -> SaturationCheck:
    made = SaturationCheck(2.0)
    made.learn(known)
    return made


@pytest.mark.parametrize("torque_nm", [1.99, -1.99, 2.5])
def test_three_readings_at_the_end_of_the_range(torque_nm: float) -> None:
    verdict = ask(at_end(), from_tick(300, shows(torque_nm)))
    assert verdict.tick == 302
    assert "at the end of its range of 2 N m" in verdict.said


def test_the_bias_is_part_of_the_range() -> None:
    assert ask(at_end(), from_tick(300, shows(1.96))).tick is None
    assert ask(at_end(habits()), from_tick(300, shows(1.96))).tick == 302
    assert ask(at_end(habits()), from_tick(300, shows(-1.99))).tick is None


def test_one_reading_at_the_end_passes_and_repeats_are_none() -> None:
    samples = [turning(k) for k in range(600)]
    samples[300] = shows(2.0)(samples[300])
    samples[400:410] = [s._replace(torque_nm=2.0, torque_new=False) for s in samples[400:410]]
    assert ask(at_end(), samples).tick is None


# ---- jumps ----------------------------------------------------------------------------------------------------------


def jump(known: GuardModel) -> TorqueJump:
    made = TorqueJump(1.0, 1e-3)
    made.learn(known)
    return made


def test_a_step_that_stays_is_found_with_its_third_reading() -> None:
    verdict = ask(jump(habits()), from_tick(300, lambda s: s._replace(torque_nm=s.torque_nm + 0.6)))
    assert verdict.tick == 302
    assert "jumped from" in verdict.said


@pytest.mark.parametrize(
    ("known", "step_nm", "found"),
    [
        (habits(), 0.4, False),
        (habits(greatest_step_nm=0.3), 0.8, False),
        (habits(greatest_step_nm=0.3), 0.95, True),
        (habits(greatest_step_nm=None), 0.95, False),
        (EMPTY_MODEL, 0.95, False),
        (replace(habits(), load=None), 0.95, False),
        (replace(habits(), actuator=None), 0.95, False),
    ],
)
def test_how_great_a_step_is_too_great(known: GuardModel, step_nm: float, found: bool) -> None:
    assert (ask(jump(known), from_tick(300, shows(step_nm), resting)).tick is not None) is found


@pytest.mark.parametrize("change", [Commands(0.5, 0.0), Commands(0.0, -0.5), Commands(-0.3, 0.2)])
def test_what_the_drives_were_told_to_change_the_torque_may_change_by(change: Commands) -> None:
    def told(tick: int) -> Commands:
        return change if tick >= 295 else Commands(0.0, 0.0)

    assert ask(jump(habits()), from_tick(300, shows(0.7), resting), told).tick is None
    assert ask(jump(habits()), from_tick(300, shows(0.99), resting), told).tick is not None
    assert ask(jump(habits()), from_tick(400, shows(0.7), resting), told).tick == 402


def test_a_spike_passes() -> None:
    samples = [turning(k) for k in range(600)]
    samples[300:302] = [shows(0.9)(s) for s in samples[300:302]]
    assert ask(jump(habits()), samples).tick is None


def test_after_a_heap_of_readings_the_torque_may_be_another() -> None:
    for missing in (0, 1):  # after the heap's own readings, some may have found no room
        samples = from_tick(300 + missing, shows(0.9))
        samples[300] = samples[300]._replace(torque_count=20)
        assert ask(jump(habits()), samples).tick is None
    assert ask(jump(habits()), from_tick(300, shows(0.9))).tick == 302


def test_after_a_pause_the_torque_may_be_another() -> None:
    samples = [*map(turning, range(300)), *(shows(0.9)(turning(k)) for k in range(303, 600))]
    assert ask(jump(habits()), samples).tick is None
    slow = from_tick(300, shows(0.9))
    slow = [s._replace(torque_new=tick % 10 == 0) for tick, s in enumerate(slow)]
    assert ask(jump(habits()), slow).tick is None


# ---- a free shaft ---------------------------------------------------------------------------------------------------


def free(moving_command: float | None = -0.02) -> Standstill:
    made = Standstill("N*m")
    made.learn(GuardModel(moving_command=moving_command))
    return made


def pushed_at_300(tick: int) -> Commands:
    return Commands(0.05 if tick >= 300 else 0.0, 0.0)


def test_a_free_shaft_that_does_not_turn_though_it_is_pushed() -> None:
    verdict = ask(free(), map(resting, range(1000)), pushed_at_300)
    assert verdict.tick == 400
    assert "actuator encoder: stands still at -0 rad for 100 ms under 0.05 N*m" in verdict.said


def test_a_free_shaft_that_turns_by_a_count_now_and_then_passes() -> None:
    def creeping(tick: int) -> Sample:
        return resting(tick)._replace(position_rad=1e-4 * (tick // 90))

    assert ask(free(), map(creeping, range(1000)), pushed_at_300).tick is None


def test_an_encoder_that_is_silent_does_not_stand_still() -> None:
    silent = (resting(k)._replace(motion_age_ns=40_000_000) for k in range(1000))
    assert ask(free(), silent, pushed_at_300).tick is None


@pytest.mark.parametrize("moving_command", [0.03, None, inf])
def test_a_push_that_need_not_move_it_passes(moving_command: float | None) -> None:
    assert ask(free(moving_command), map(resting, range(1000)), pushed_at_300).tick is None
