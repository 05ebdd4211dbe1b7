"""What the guard says, word for word: it is all that an operator has to go by; and what tripped, in a word or two."""

from collections.abc import Iterable
from dataclasses import replace
from math import inf, nan

import pytest

from norton_bench.errors import SafetyStopError, UsageError
from norton_bench.guard.check import Commands
from norton_bench.guard.drive_checks import CurrentAgreement, StuckModulator
from norton_bench.guard.guard import Equipment, Guard, checks_for
from norton_bench.guard.motion_checks import CouplingCheck, EncoderAgreement, HeldShaft, Standstill
from norton_bench.guard.torque_checks import FrozenTorque, SaturationCheck, TorqueBalance, TorqueJump
from norton_bench.rig.rig import Command
from norton_bench.sample import Sample
from norton_drivers.readings import DriveState
from tests.bench.guard import test_coupling, test_encoder, test_held, test_modulator, test_torque
from tests.bench.guard.shafts import ask, from_tick, resting, turning
from tests.bench.guard.test_guard import ACTUATOR, LIMITS, LOAD, NOW_NS, SAMPLE, STATUS, WISH

RAISE = "or raise [limits] {} where the bench stands more"
LESS = "ask for less (amplitude of the steps, [actuator.command] limit), " + RAISE
ALONE = (
    "others were heard meanwhile: check its cable and power; a computer that is busy may be late to hand on what a "
    "serial port has received: end other programs"
)
NO_NUMBER = "is no number: the device marks its reading as invalid, or reads beyond its range; check the device"
HEARD = SAMPLE._replace(modulator_position_rad=0.1, modulator_motion_age_ns=500_000)


def gate(**changes: object) -> Guard:
    made = Guard(LIMITS, 0.5, 1e-3, has_load=True, has_torque_sensor=True, modulation_limit=2.0, **changes)
    made.begin(HEARD._replace(position_rad=2.0))
    return made


def stopped(guard: Guard, sample: Sample = HEARD, wish: Commands = WISH, drives=(ACTUATOR, LOAD)) -> tuple[str, str]:
    with pytest.raises(SafetyStopError) as stop:
        guard.limit(wish, sample, drives)
    # Latched, with the same word.
    with pytest.raises(SafetyStopError) as again:
        guard.limit(WISH, HEARD, (ACTUATOR, LOAD))
    assert (str(again.value), again.value.by) == (str(stop.value), stop.value.by)
    return str(stop.value), stop.value.by


@pytest.mark.parametrize(
    ("change", "by", "words"),
    [
        (
            {"velocity_rad_s": -80.25},
            "velocity",
            f"actuator velocity: -80.25 rad/s is outside [limits] velocity = 80 rad/s; {LESS.format('velocity')}",
        ),
        (
            {"load_velocity_rad_s": 81.0},
            "velocity",
            f"load velocity: 81 rad/s is outside [limits] velocity = 80 rad/s; {LESS.format('velocity')}",
        ),
        (
            {"position_rad": 12.5},
            "position",
            "travel from where the shaft stood: 10.5 rad is outside [limits] position = 10 rad; begin further from the "
            f"end, or ask for less (amplitude of the steps), {RAISE.format('position')}",
        ),
        (
            {"torque_nm": 1.25},
            "torque",
            "port torque: 1.25 N m is outside [limits] torque = 1 N m; ask for less ([actuator.command] limit, [load] "
            f"torque_limit), {RAISE.format('torque')}",
        ),
        (
            {"torque_nm": 0.5, "velocity_rad_s": -50.0},
            "power",
            f"port power: -25 W is outside [limits] power = 20 W; {LESS.format('power')}",
        ),
        ({"velocity_rad_s": nan}, "velocity", f"actuator velocity: {NO_NUMBER}"),
        ({"load_velocity_rad_s": nan}, "velocity", f"load velocity: {NO_NUMBER}"),
        ({"position_rad": inf}, "position", f"travel from where the shaft stood: {NO_NUMBER}"),
        ({"load_position_rad": nan}, "position", f"load position: {NO_NUMBER}"),
        ({"torque_nm": nan}, "torque", f"port torque: {NO_NUMBER}"),
        ({"motion_age_ns": -1}, "stale", "actuator encoder: no reading yet"),
        ({"load_motion_age_ns": -1}, "stale", "load encoder: no reading yet"),
        ({"torque_age_ns": -1}, "stale", "torque sensor: no reading yet"),
        ({"modulator_motion_age_ns": -1}, "stale", "modulator encoder: no reading yet"),
        (
            {"motion_age_ns": 7_500_000},
            "stale",
            f"actuator encoder: silent for 7.5 ms, more than [limits] stale_after = 5 ms; {ALONE}",
        ),
        (
            {"modulator_motion_age_ns": 123_400_000},
            "stale",
            f"modulator encoder: silent for 123.4 ms, more than [limits] stale_after = 5 ms; {ALONE}",
        ),
    ],
)
def test_a_limit_and_what_to_do(change: dict[str, float], by: str, words: str) -> None:
    assert stopped(gate(), HEARD._replace(**change)) == (words, by)


def test_infinite_limits_are_none() -> None:
    free = replace(LIMITS, velocity_rad_s=inf, position_rad=inf, power_w=inf)
    guard = Guard(free, 0.5, 1e-3, has_load=True, has_torque_sensor=True)
    guard.begin(SAMPLE)
    far = SAMPLE._replace(position_rad=1e9, velocity_rad_s=-1e9, load_velocity_rad_s=1e9)
    assert guard.limit(WISH, far, (ACTUATOR, LOAD)) == WISH


@pytest.mark.parametrize(
    "change",
    [
        {"velocity_rad_s": -80.0, "torque_nm": 0.0},
        {"load_velocity_rad_s": 80.0},
        {"position_rad": 12.0},
        {"torque_nm": -1.0},
        {"torque_nm": 0.5, "velocity_rad_s": 40.0},
        {"motion_age_ns": 5_000_000},
        {"load_motion_age_ns": 5_000_000},
        {"torque_age_ns": 5_000_000},
        {"modulator_motion_age_ns": 5_000_000},
        {"motion_age_ns": 0},
        {"load_motion_age_ns": 0},
        {"torque_age_ns": 0},
        {"modulator_motion_age_ns": 0},
    ],
)
def test_a_limit_itself_is_within(change: dict[str, float]) -> None:
    assert gate().limit(WISH, HEARD._replace(**change), (ACTUATOR, LOAD)) == WISH


@pytest.mark.parametrize(
    ("others_ns", "alone"), [(0, True), (2_999_999, True), (3_000_000, False), (2_000_001, True), (4_000_000, False)]
)
def test_who_else_was_heard_within_half_of_a_silence(others_ns: int, alone: bool) -> None:
    ages = dict.fromkeys(("motion_age_ns", "load_motion_age_ns", "modulator_motion_age_ns"), others_ns)
    everybody = (
        "nothing else was heard either: the bus, its adapter or the computer stood still, or `sim serve` in a "
        "rehearsal: check the bus, and end other programs"
    )
    silence = "torque sensor: silent for 6.0 ms, more than [limits] stale_after = 5 ms; "
    assert stopped(gate(), HEARD._replace(torque_age_ns=6_000_000, **ages)) == (
        silence + (ALONE if alone else everybody),
        "stale",
    )


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        (
            Commands(nan, 0.25),
            "the controller asked for command nan and load torque 0.25 N m: not a number, so nothing was sent",
        ),
        (Commands(0.0, 0.0, 0, inf), "the procedure asked for modulation inf: not a number"),
    ],
)
def test_a_wish_that_is_no_number(wish: Commands, words: str) -> None:
    assert stopped(gate(), wish=wish) == (words, "wish")


def test_a_shaft_that_was_nowhere_when_the_drives_were_enabled() -> None:
    guard = Guard(LIMITS, 0.5, 1e-3, True, True)
    guard.begin(SAMPLE._replace(position_rad=nan))
    assert stopped(guard, SAMPLE) == ("actuator position: not a number when the drives were enabled", "position")


def test_the_window_stays_where_the_shaft_first_stood() -> None:
    guard = gate()
    guard.begin(HEARD._replace(position_rad=9.0))
    assert stopped(guard, HEARD._replace(position_rad=12.5))[1] == "position"


@pytest.mark.parametrize(
    ("status", "by", "words"),
    [
        (STATUS._replace(state=DriveState.IDLE), "drive", "left its torque loop (idle: no reason given)"),
        (
            STATUS._replace(state=DriveState.FAULT, errors=("hot", "low supply")),
            "drive",
            "left its torque loop (fault: hot; low supply)",
        ),
        (STATUS._replace(heartbeat_ns=None), "heartbeat", "no heartbeat for 300 ms"),
        (STATUS._replace(heartbeat_ns=NOW_NS - 300_000_001), "heartbeat", "no heartbeat for 300 ms"),
        (
            STATUS._replace(transistor_temperature_c=80.6),
            "temperature",
            "transistors at 81 °C, above [limits] temperature = 80 °C",
        ),
        (
            STATUS._replace(motor_temperature_c=95.0),
            "temperature",
            "motor at 95 °C, above [limits] temperature = 80 °C",
        ),
    ],
)
def test_a_drive(status: object, by: str, words: str) -> None:
    ill = ACTUATOR._replace(status=status)
    assert stopped(gate(), drives=(ill, LOAD)) == (f"actuator drive: {words}", by)


def test_what_a_drive_may_just_do() -> None:
    status = STATUS._replace(heartbeat_ns=NOW_NS - 300_000_000, transistor_temperature_c=80.0, motor_temperature_c=80.0)
    assert gate().limit(WISH, HEARD, (ACTUATOR._replace(status=status), LOAD)) == WISH


def test_everything_that_was_clipped_is_told() -> None:
    assert gate().limit(Commands(9.0, 9.0, 0, 9.0), HEARD, (ACTUATOR, LOAD)) == Commands(0.1, 0.8, 15, 2.0)


def test_a_stall_shows_for_so_long() -> None:
    guard, fast = gate(), HEARD._replace(velocity_rad_s=81.0)
    guard.stood_still(NOW_NS - 200_000_000, 30_000_000)  # just still counts
    guard.stood_still(NOW_NS, 12_000_000)
    assert stopped(guard, fast)[0] == (
        "actuator velocity: 81 rad/s is outside [limits] velocity = 80 rad/s; the loop had stood still for 42 of the "
        "last 200 ms, with its last commands acting: other programs kept it from the processor, or a virtual machine's "
        "host did; end them"
    )


@pytest.mark.parametrize(("still_ns", "shows"), [(4_999_999, False), (5_000_000, True)])
def test_a_stall_that_is_worth_a_word(still_ns: int, shows: bool) -> None:
    guard = gate()
    guard.stood_still(NOW_NS, still_ns)
    assert ("stood still" in stopped(guard, HEARD._replace(velocity_rad_s=81.0))[0]) is shows


def test_a_load_that_lets_go() -> None:
    said, _ = stopped(gate(load_dead_band_nm=2.5e-3), HEARD._replace(velocity_rad_s=81.0))
    assert said.endswith(
        f"; {LESS.format('velocity')}; the load does nothing below 0.0025 N m, where its drive lets go of its motor: "
        "where that is much of the friction it has to overcome, lower the drive's minimum current, and what [load] "
        "says of it"
    )


def test_a_reset_wants_a_word() -> None:
    with pytest.raises(UsageError, match=r"^a guard that tripped is reset by an operator's word: say who looked, and "):
        gate().reset(" ")


# ---- The checks -----------------------------------------------------------------------------------------------------


def opposite(sample: Sample) -> Sample:
    return sample._replace(load_position_rad=-sample.load_position_rad)


COUPLING = {
    "the actuator's encoder stands still while the load's turns; check it, its cable, and the coupling": (
        lambda s: s._replace(position_rad=0.3, velocity_rad_s=0.0)
    ),
    "the load's encoder stands still while the actuator's turns; check it, its cable, and the coupling": (
        lambda s: s._replace(load_position_rad=0.3, load_velocity_rad_s=0.0)
    ),
    "they turn opposite ways; check the coupling, both encoders, and [load] direction in the rig file": opposite,
    "the coupling broke or slips, or an encoder jumped; check all three": (
        lambda s: s._replace(load_position_rad=2 * s.load_position_rad)
    ),
}


@pytest.mark.parametrize(("mend", "fault"), COUPLING.items())
def test_a_coupling(mend: str, fault) -> None:
    said = ask(test_coupling.check(0.1), from_tick(300, fault)).said
    assert said.startswith("coupling: actuator and load have turned ")
    assert said.endswith(f" rad is the most that can be ([limits] twist, and what comes with speed): {mend}")


def test_a_current() -> None:
    check = CurrentAgreement("actuator", 0.5, "N*m", 20.0)
    samples = [resting(tick)._replace(current_a=-6.0) for tick in range(300)]
    said = ask(check, samples, lambda tick: Commands(-0.1 if tick < 150 else 0.2, 0.0) if tick > 148 else WISH).said
    assert said == (
        "actuator drive: its current is -6 A, though all commands of the last tenth of a second (0 to 0.05 N*m) ask "
        "for 0 to 1 A: it follows something else, or reports a wrong current; check the drive's control mode, who else "
        "is on the bus, and its current sensing"
    )


def test_a_modulator() -> None:
    verdict = ask(test_modulator.check(), (test_modulator.at(k, 0.5) for k in range(2000)), test_modulator.rising)
    assert verdict.said == (
        "modulator encoder: stands still at 0.5 rad, though 100 ms ago its command had gone from 0 to 2.1 N*m/rad: it "
        "is stuck or at a stop, or its encoder is; check both, and [modulator.command] limit"
    )


def test_an_encoder() -> None:
    jumped = ask(test_encoder.check(), from_tick(300, lambda s: s._replace(position_rad=s.position_rad + 1.0)))
    assert jumped.said.startswith("actuator encoder: its position is +")
    assert jumped.said.endswith(
        " rad is the most that can be: the count jumped, sticks or runs backwards; check encoder, cable and mounting"
    )


def test_a_held_shaft() -> None:
    said = ask(test_held.check(), (test_held.rising(k, 4.0) for k in range(1000))).said
    assert said.startswith("actuator encoder: stands still at 0 rad for 100 ms while the port torque goes from 0 to ")
    assert said.endswith("check both")


def test_a_free_shaft_that_stands() -> None:
    said = ask(test_torque.free(), map(resting, range(1000)), test_torque.pushed_at_300).said
    assert said.endswith("times what set the shaft in motion: the encoder is stuck, or the shaft is held; check both")


def test_a_torque_sensor() -> None:
    frozen = ask(test_torque.frozen(test_torque.habits()), from_tick(300, test_torque.shows(0.25))).said
    assert frozen == (
        "torque sensor: gives 0.25 N m in 51 readings in a row, as no living sensor does: it is frozen or at the end "
        "of its range; switch it off and on again, and check its supply"
    )
    at_end = ask(test_torque.at_end(), from_tick(300, test_torque.shows(1.99))).said
    assert at_end == (
        "torque sensor: at the end of its range of 2 N m for 3 readings: the torque may be any; lower the commands, or "
        "mount a sensor of a greater range"
    )
    jumped = ask(test_torque.jump(test_torque.habits()), from_tick(300, test_torque.shows(0.6), resting)).said
    assert jumped.endswith(
        " to 0.6 N m between two readings and stayed there, where a change of 0.5 N m is the most that can be: check "
        "the sensor's zero, amplifier and cable, and that the shaft hits nothing"
    )


# ---- What a rig's checks are made of ---------------------------------------------------------------------------------

EVERYTHING = Equipment(
    load=True,
    torque_sensor=True,
    range_nm=2.0,
    resolution_rad=3e-4,
    load_resolution_rad=1e-4,
    modulation=Command("N*m/rad", 4.0),
    modulator_resolution_rad=5e-5,
)


def inside(checks: Iterable[object]) -> list[tuple[str, dict[str, object]]]:
    return [(type(check).__name__, {k: v for k, v in vars(check).items() if not callable(v)}) for check in checks]


def made_for(command: Command, fitted: Equipment) -> list[tuple[str, dict[str, object]]]:
    return inside(checks_for(replace(LIMITS, twist_rad=0.25), command, 1e-3, fitted))


def test_each_check_knows_its_own_limit_unit_and_resolution() -> None:
    """As they would be if they were made by hand, one by one."""
    expected = [
        EncoderAgreement("actuator encoder", 3e-4),
        EncoderAgreement("load encoder", 1e-4),
        CouplingCheck(0.25, 1.0, 3e-4 + 1e-4, 1e-3),
        StuckModulator(4.0, "N*m/rad", 5e-5),
        CurrentAgreement("actuator", 500.0, "mA", 1e-3),
        CurrentAgreement("load", 0.8, "N*m"),
        FrozenTorque(1e-3),
        TorqueJump(1.0, 1e-3),
        SaturationCheck(2.0),
        TorqueBalance(1.0),
        HeldShaft(1.0, 3e-4),
    ]
    assert made_for(Command("mA", 500.0), EVERYTHING) == inside(expected)
    alone = [EncoderAgreement("actuator encoder", 0.0), Standstill("N*m"), CurrentAgreement("actuator", 0.5, "N*m")]
    assert made_for(Command("N*m", 0.5), Equipment(False, False, runs=True)) == inside(alone)


def test_a_shaft_that_swings_keeps_all_checks_quiet() -> None:
    """Together, begun twice: nothing of the first time is left."""
    checks = checks_for(
        replace(LIMITS, twist_rad=0.25), Command("N*m", 0.5), 1e-3, replace(EVERYTHING, modulation=None)
    )
    for check in checks:
        assert ask(check, map(turning, range(300))).tick is None
        assert ask(check, map(turning, range(5000, 5300))).tick is None
