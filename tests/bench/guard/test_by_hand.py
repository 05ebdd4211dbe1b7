"""The checks' arithmetic, against figures worked out by hand."""

from collections.abc import Callable

import numpy as np
import pytest

from norton_bench.guard.check import Check, Commands, GuardModel, Machine, TorqueReadings, amperes_per_command
from norton_bench.guard.drive_checks import CurrentAgreement, StuckModulator
from norton_bench.guard.motion_checks import CouplingCheck, EncoderAgreement, HeldShaft, Standstill
from norton_bench.guard.torque_checks import FrozenTorque, SaturationCheck, TorqueBalance, TorqueJump
from norton_bench.records import CURRENT, TICK
from norton_bench.sample import Sample
from tests.bench.guard.shafts import NOTHING, START_NS, TICK_NS, resting, turning

MS = 1_000_000
FORGET_S = 0.1
Sent = Callable[[int], Commands]


def said(check: Check, samples: list[Sample], sent: Sent = lambda _: NOTHING) -> list[str | None]:
    """What the check says of each sample, whatever it said before."""
    check.begin(samples[0])
    return [check.fault(sample, sent(k)) for k, sample in enumerate(samples)]


def found_at(check: Check, samples: list[Sample], sent: Sent = lambda _: NOTHING) -> list[int]:
    return [k for k, words in enumerate(said(check, samples, sent)) if words is not None]


# ---- Two encoders on one shaft: both taken to the tick's instant ----------------------------------------------------


def shafts(position_rad: float, age_ms: float, load_age_ms: float, count: int = 6) -> list[Sample]:
    """At rest first; then the actuator at 10 rad/s, the load at 20 rad/s."""
    moving = [
        resting(k)._replace(
            position_rad=position_rad,
            velocity_rad_s=10.0,
            motion_age_ns=round(age_ms * MS),
            load_velocity_rad_s=20.0,
            load_motion_age_ns=round(load_age_ms * MS),
        )
        for k in range(1, count)
    ]
    return [resting(0), *moving]


def test_the_twist_is_that_of_one_instant_and_so_is_what_it_may_be() -> None:
    # 1 + 10 · 2 ms − 20 · 5 ms = 0.92; 0.25 + 4 · 1e-4 + 20 · (3 ms + 2 · 7 ms) = 0.5904
    words = said(CouplingCheck(0.25, 1.0, 1e-4, 1e-3), shafts(1.0, 2.0, 5.0))[-1]
    assert words is not None
    assert "have turned +0.92 rad apart, where 0.59 rad is the most" in words


@pytest.mark.parametrize(("position_rad", "found"), [(0.669, False), (0.672, True), (-0.509, False), (-0.512, True)])
def test_a_twist_that_is_just_too_great(position_rad: float, found: bool) -> None:
    # |position + 0.02 − 0.1| may be 0.5904
    assert bool(found_at(CouplingCheck(0.25, 1.0, 1e-4, 1e-3), shafts(position_rad, 2.0, 5.0))) is found


def test_the_greatest_speed_of_either_is_remembered() -> None:
    """exp(−t / 0.1 s), whichever of the two it was: it allows 3.8 ms of it."""
    for fast in ("velocity_rad_s", "load_velocity_rad_s"):
        burst = resting(1)._replace(**{fast: 100.0}, position_rad=0.0)
        apart = [resting(k)._replace(position_rad=0.5) for k in range(2, 200)]
        first = found_at(CouplingCheck(0.25, 1.0, 0.0, 1e-3), [resting(0), burst, *apart])[0]
        # 0.25 + 100 · kept · (3 ms + 2 · 0.8 ms) < 0.5 after ln(0.46 / 0.25) · 0.1 s, and three strikes.
        assert first == pytest.approx(1 + np.log(0.46 / 0.25) * 1e3 * FORGET_S, abs=3.0)


def test_the_limit_of_torque_may_twist_it_by_four_times_what_it_should() -> None:
    check = CouplingCheck(0.25, 2.0, 1e-4, 1e-3)
    check.learn(GuardModel(sensor_stiffness_nm_rad=100.0))
    # 4 · 2 / 100 + 4 · 1e-4 = 0.0804
    steady = lambda rad: [resting(0), *(resting(k)._replace(position_rad=rad) for k in range(1, 9))]  # noqa: E731
    assert not found_at(check, steady(0.0803))
    assert found_at(check, steady(0.0806))


def test_the_third_pair_of_new_readings_tells() -> None:
    """Each pair wants both to have spoken again, in whatever order."""
    apart = resting(0)._replace(position_rad=1.0, motion_new=False, load_motion_new=False)
    new = [(True, True), (True, False), (True, False), (False, True), (False, True), (False, False), (True, False)]
    samples = [apart._replace(motion_new=one, load_motion_new=other) for one, other in new]
    assert found_at(CouplingCheck(0.25, 1.0, 0.0, 1e-3), [resting(0), *samples]) == [7]


# ---- One encoder: its position against its velocity -----------------------------------------------------------------


def steady(count: int, per_tick: int = 1, off_rad: float = 0.0, age_ns: int = 0) -> list[Sample]:
    """At 10 rad/s; ``off_rad`` is added from the fifth tick on."""
    return [
        resting(k)._replace(
            position_rad=0.01 * k + (off_rad if k >= 5 else 0.0),
            velocity_rad_s=10.0,
            motion_age_ns=age_ns,
            motion_count=per_tick,
        )
        for k in range(count)
    ]


def test_an_encoders_words_hold_its_figures() -> None:
    """One jump by 0.5 rad, of which (1 − 1/100) is left after every tick: 0.5 · 0.99² at the third reading."""
    words = [each for each in said(EncoderAgreement("actuator encoder", 0.0), steady(9, off_rad=0.5)) if each]
    assert words[0].startswith("actuator encoder: its position is +0.49 rad off what its velocity (now 10 rad/s)")


@pytest.mark.parametrize("age_ms", [0, 3])
def test_an_age_moves_all_readings_alike(age_ms: int) -> None:
    assert found_at(EncoderAgreement("actuator encoder", 0.0), steady(12, off_rad=0.5, age_ns=age_ms * MS))[0] == 7


def test_readings_from_further_and_further_back_are_as_far_apart_as_they_were_taken() -> None:
    """The tick's own clock counts, less the age: half a tick apart, though seen at every tick."""
    late = [
        resting(k)._replace(position_rad=5e-3 * k, velocity_rad_s=10.0, motion_age_ns=k * MS // 2) for k in range(200)
    ]
    assert not found_at(EncoderAgreement("actuator encoder", 0.0), late)


# ---- The torque, from one reading to the next -----------------------------------------------------------------------

HABITS = GuardModel(
    torque=TorqueReadings(0.0, 1e-3, 1e-3, 2, 0.02),
    actuator=Machine(0.9, 5e-5, 1e-3, 0.02),
    load=Machine(0.95, 1.2e-4, 3e-4, 0.008),
)


def torques(*values_nm: float, age_ns: int = 400_000) -> list[Sample]:
    return [resting(k)._replace(torque_nm=value, torque_age_ns=age_ns) for k, value in enumerate(values_nm)]


def jump(known: GuardModel = HABITS) -> TorqueJump:
    check = TorqueJump(1.0, 1e-3)
    check.learn(known)
    return check


@pytest.mark.parametrize(
    ("values_nm", "found"),
    [
        ((0.0, 0.0, 0.51, 0.51, 0.51), [4]),
        ((0.0, 0.0, 0.49, 0.49, 0.49), []),
        ((0.2, 0.2, -0.4, -0.4, -0.4), [4]),  # by 0.6, from the other side of zero
        ((-0.3, -0.3, 0.3, 0.3, 0.3, 0.3), [4, 5]),
        ((0.3, 0.3, 0.9, 0.52, 0.9, 0.9), []),  # half of it is gone: a glitch
        ((0.3, 0.3, 0.9, 0.57, 0.9, 0.9), [4, 5]),
        ((0.0, 0.0, 0.6, 0.0, 0.6, 0.6, 0.6), [6]),
    ],
)
def test_a_jump(values_nm: tuple[float, ...], found: list[int]) -> None:
    assert found_at(jump(), torques(*values_nm)) == found


def test_a_jump_says_from_where_to_where() -> None:
    words = said(jump(), torques(-0.3, -0.3, 0.35, 0.36, 0.37))[-1]
    assert words is not None
    assert words.startswith("port torque: jumped from -0.3 to 0.37 N m between two readings and stayed there")


@pytest.mark.parametrize(("gap_ms", "found"), [(2.5, True), (2.6, False)])
def test_how_far_apart_neighbours_may_be(gap_ms: float, found: bool) -> None:
    """Two and a half periods between the readings' arrivals, whenever they were seen."""
    first = torques(0.0, 0.0)
    age_ns = round((9 - gap_ms) * MS)  # at the tenth tick, of which the last before was the first
    later = [resting(k)._replace(torque_nm=0.6, torque_age_ns=age_ns) for k in (10, 11, 12)]
    samples = [*(each._replace(torque_age_ns=0) for each in first), *later]
    assert bool(found_at(jump(), samples)) is found


@pytest.mark.parametrize(("count", "found"), [(2, True), (3, False)])
def test_a_heap_is_more_than_two(count: int, found: bool) -> None:
    samples = torques(0.0, 0.0, 0.6, 0.6, 0.6)
    samples[2] = samples[2]._replace(torque_count=count)
    assert bool(found_at(jump(), samples)) is found


def test_a_change_of_the_commands_is_forgotten_with_twenty_milliseconds() -> None:
    """0.5 + 0.9 · 0.4 · exp(−t / 20 ms): a step of 0.6 is too great after 25.6 ms."""
    sent: Sent = lambda k: Commands(0.4 if k >= 10 else 0.0, 0.0)  # noqa: E731
    for at, found in ((10 + 25, False), (10 + 26, True)):
        values = [0.0] * at + [0.6] * 3
        assert bool(found_at(jump(), torques(*values), sent)) is found


def test_equal_readings_are_counted() -> None:
    check = FrozenTorque(1e-3)
    check.learn(HABITS)
    values = [0.1, 0.2] + [0.25] * 52
    words = said(check, torques(*values))
    assert [k for k, each in enumerate(words) if each] == [52, 53]
    assert words[52] is not None
    assert "0.25 N m in 51 readings" in words[52]
    check.begin(resting(0))
    assert check.fault(torques(0.25)[0], NOTHING) is None  # afresh, though it is the same again


@pytest.mark.parametrize(("torque_nm", "found"), [(1.98, True), (1.9799, False), (-1.98, True)])
def test_the_end_of_the_range_begins_at_99_hundredths(torque_nm: float, found: bool) -> None:
    assert bool(found_at(SaturationCheck(2.0), torques(*[torque_nm] * 3))) is found


# ---- Currents -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("current_a", "found"), [(3.59, False), (3.61, True), (-1.59, False), (-1.61, True)])
@pytest.mark.parametrize("sign", [1, -1])
def test_how_much_more_current_is_too_much(current_a: float, found: bool, sign: int) -> None:
    """Commands from 0 to 0.1, at 20 A each, and 0.3 · 0.1 + 0.1 · 0.5 more: from −0.08 to 0.18."""
    check = CurrentAgreement("actuator", 0.5, "N*m", 20.0 * sign)
    samples = [resting(k)._replace(current_a=current_a * sign) for k in range(50)]
    assert bool(found_at(check, samples, lambda _: Commands(0.1, 0.0))) is found


def test_the_slope_of_a_current_that_follows_at_once() -> None:
    """The command in force is that of the last tick at or before the reading; before the first, the first."""
    ticks, current = np.zeros(4, TICK), np.zeros(5, CURRENT)
    ticks["tick_ns"] = START_NS + np.arange(4) * TICK_NS
    ticks["command"] = [1.0, 3.0, -2.0, 0.5]
    current["arrival_ns"] = START_NS + np.array([-1, 0, 1_000_000, 2_999_999, 3_000_000])
    current["current_a"] = 4.0 * np.array([1.0, 1.0, 3.0, -2.0, 0.5])
    assert amperes_per_command(ticks, "command", current) == pytest.approx(4.0, abs=1e-12)
    assert amperes_per_command(ticks, "command", current[:3]) == pytest.approx(4.0, abs=1e-12)


@pytest.mark.parametrize(("noise_a", "seen"), [(0.199, True), (0.201, False)])
def test_a_slope_is_seen_where_it_is_ten_of_its_own_deviations(noise_a: float, seen: bool) -> None:
    """Commands ±1 and noise that goes with neither: a deviation of noise · √(8/(8 − 2)/8) about a slope of …"""
    ticks, current = np.zeros(8, TICK), np.zeros(8, CURRENT)
    ticks["tick_ns"] = current["arrival_ns"] = START_NS + np.arange(8) * TICK_NS
    ticks["command"] = [1, 1, 1, 1, -1, -1, -1, -1]
    slope = 2.0 / np.sqrt(6.0)  # ten times 0.2 · √(8 / 6 / 8)
    current["current_a"] = slope * ticks["command"] + noise_a * np.array([1, -1, 1, -1, 1, -1, 1, -1])
    assert (amperes_per_command(ticks, "command", current) is not None) is seen


# ---- A modulator, and a held shaft ----------------------------------------------------------------------------------


def test_a_modulator_that_moved_is_watched_from_there_on() -> None:
    """It moves by more than four counts at tick 50: what counts is the command since then."""
    check = StuckModulator(4.0, "N*m/rad", 1e-4)
    samples = [resting(k)._replace(modulator_position_rad=5.1e-4 if k >= 50 else 0.0) for k in range(300)]
    sent: Sent = lambda k: Commands(0.0, 0.0, modulation=2.0 + 0.01 * k)  # noqa: E731
    # From 2.5 on, by more than 0.4 at tick 91, and a tenth of a second.
    first = found_at(check, samples, sent)[0]
    assert first == pytest.approx(191, abs=1)


def test_a_swing_that_is_just_small_enough() -> None:
    check = HeldShaft(1.0, 0.0)
    check.learn(GuardModel(sensor_stiffness_nm_rad=200.0, still_swing_nm=0.05))
    for swing_nm, found in ((0.149, False), (0.151, True)):
        assert bool(found_at(check, torques(*([0.0] * 50 + [swing_nm] * 100)))) is found


# ---- The beginning -----------------------------------------------------------------------------------------------


def all_checks(factor: float = 1.0) -> list[Check]:
    """One of each, its figures times ``factor``."""
    return [
        EncoderAgreement("actuator encoder", 1e-4 * factor),
        CouplingCheck(0.25 * factor, 1.0 * factor, 1e-4 * factor, 1e-3 * factor),
        CurrentAgreement("actuator", 0.5 * factor, "N*m", 20.0 * factor),
        StuckModulator(4.0 * factor, "N*m/rad", 1e-4 * factor),
        Standstill("N*m"),
        FrozenTorque(1e-3 * factor),
        TorqueJump(1.0 * factor, 1e-3 * factor),
        SaturationCheck(2.0 * factor),
        TorqueBalance(1.0 * factor),
        HeldShaft(1.0 * factor, 1e-4 * factor),
    ]


# What begins otherwise: not known yet, one reading a tick, and a sensor as quick as the common low-pass.
OTHERWISE = {"_start_rad": None, "_load": None, "_actuator": None, "_usual": 1.0, "_low_pass_s": 0.02, "_old_ns": 2e7}


@pytest.mark.parametrize("number", range(10))
def test_a_new_check_has_seen_nothing(number: int) -> None:
    """What it holds beside its own figures is zero, or without limit."""
    held, other = vars(all_checks()[number]), vars(all_checks(2.0)[number])
    own = {name: value for name, value in held.items() if value == other[name] and not callable(value)}
    for name, value in own.items():
        if not isinstance(value, str):
            expected = OTHERWISE.get(name, np.inf if value == np.inf else 0.0)
            assert value == expected or value in {NOTHING, (0.0, 0.0)}, name


@pytest.mark.parametrize("check", all_checks(), ids=lambda check: f"{check.name} {type(check).__name__}")
def test_a_check_that_was_never_begun_nor_taught_is_quiet(check: Check) -> None:
    """Also as to what a rig lacks: everything it holds is a number from the beginning."""
    assert not any(check.fault(turning(k), Commands(0.0, 0.0, modulation=0.0)) for k in range(300))


@pytest.mark.parametrize(
    ("check", "wrong", "sent", "first"),
    [
        (
            CouplingCheck(0.25, 1.0, 0.0, 1e-3),
            lambda k: resting(k)._replace(position_rad=1.0 if k % 100 else 0.0),
            NOTHING,
            3,
        ),
        (SaturationCheck(2.0), lambda k: resting(k)._replace(torque_nm=1.99), NOTHING, 2),
        (jump(), lambda k: resting(k)._replace(torque_nm=0.6 if k % 100 > 1 else 0.0), NOTHING, 4),
        (
            CurrentAgreement("actuator", 0.5, "N*m", 20.0),
            lambda k: resting(k)._replace(current_a=9.0),
            Commands(0.1, 0.0),
            2,
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_strikes_are_counted_afresh(check: Check, wrong: Callable[[int], Sample], sent: Commands, first: int) -> None:
    """One less than it takes to tell, and the drives are enabled anew, as often as one likes."""
    for time in range(4):
        assert not found_at(check, [wrong(100 * time + k) for k in range(first)], lambda _: sent)
        assert found_at(check, [wrong(100 * time + k) for k in range(first + 1)], lambda _: sent) == [first]


def test_equal_readings_are_counted_from_the_beginning() -> None:
    """The first of them differs from nothing: fifty may be equal, and the one after tells."""
    check = FrozenTorque(1e-3)
    check.learn(HABITS)
    for _ in range(2):
        assert found_at(check, torques(*[0.25] * 51)) == [50]
        assert found_at(check, torques(*[0.5] * 3)) == []


def test_figures_that_follow_from_the_limits() -> None:
    """With a limit of 2 N m: half of it for a jump, a tenth for a held shaft; and a coarse pair of encoders."""
    wide = TorqueJump(2.0, 1e-3)
    wide.learn(HABITS)
    assert not found_at(wide, torques(0.0, 0.0, 0.99, 0.99, 0.99))
    assert found_at(wide, torques(0.0, 0.0, 1.01, 1.01, 1.01)) == [4]
    held = HeldShaft(2.0, 0.0)
    held.learn(GuardModel(sensor_stiffness_nm_rad=200.0, still_swing_nm=0.0))
    for swing_nm, found in ((0.19, False), (0.21, True)):
        assert bool(found_at(held, torques(*([0.0] * 50 + [swing_nm] * 100)))) is found
    for twist_rad, found in ((0.64, False), (0.66, True)):  # 0.25 + 4 · 0.1
        apart = [resting(k)._replace(position_rad=twist_rad) for k in range(1, 9)]
        assert bool(found_at(CouplingCheck(0.25, 1.0, 0.1, 1e-3), [resting(0), *apart])) is found


def test_a_free_shaft_may_stand_at_first() -> None:
    check = Standstill("N*m")
    check.learn(GuardModel(moving_command=0.02))
    assert found_at(check, [resting(k) for k in range(300)], lambda _: Commands(0.5, 0.0))[0] > 90


def test_what_was_asked_for_is_told_in_amperes() -> None:
    check = CurrentAgreement("actuator", 0.5, "N*m", 20.0)
    samples = [resting(k)._replace(current_a=9.0) for k in range(20)]
    words = said(check, samples, lambda k: Commands(-0.1 if k < 5 else 0.2, 0.0))[-1]
    assert words is not None
    assert "(-0.1 to 0.2 N*m) ask for -2 to 4 A" in words
