"""Every line of the guard is tripped, and a healthy bench passes it untouched."""

from math import inf, isfinite, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.errors import SafetyStopError, UsageError
from norton_bench.guard.check import Commands, DriveHealth, GuardModel, Limited
from norton_bench.guard.guard import Guard
from norton_bench.rig.rig import Limits
from norton_bench.sample import Sample
from norton_drivers.readings import DriveState, DriveStatus

LIMITS = Limits(
    torque_nm=1.0,
    velocity_rad_s=80.0,
    stale_after_ns=5_000_000,
    load_torque_nm=0.8,
    position_rad=10.0,
    power_w=20.0,
    temperature_c=80.0,
    command_rate_per_s=100.0,
)
NOW_NS = 1_000_000_000
SAMPLE = Sample(
    NOW_NS,
    torque_nm=0.1,
    torque_age_ns=500_000,
    torque_new=True,
    position_rad=3.0,
    velocity_rad_s=10.0,
    motion_age_ns=500_000,
    motion_new=True,
    load_position_rad=3.0,
    load_velocity_rad_s=10.0,
    load_motion_age_ns=500_000,
    load_motion_new=True,
)
STATUS = DriveStatus(DriveState.ENABLED, heartbeat_ns=NOW_NS - 50_000_000, transistor_temperature_c=30.0)
ACTUATOR = DriveHealth("actuator", STATUS, 300_000_000)
LOAD = DriveHealth("load", STATUS, 300_000_000)
WISH = Commands(0.05, 0.1)


def guard(limits: Limits = LIMITS, *, has_load: bool = True, has_torque_sensor: bool = True) -> Guard:
    made = Guard(limits, 0.5, 1e-3, has_load, has_torque_sensor)
    made.begin(SAMPLE._replace(position_rad=2.0))
    return made


def test_a_healthy_bench_passes_untouched() -> None:
    assert guard().limit(WISH, SAMPLE, (ACTUATOR, LOAD)) == WISH


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"torque_nm": 1.01}, "port torque"),
        ({"torque_nm": -1.01}, "port torque"),
        ({"torque_nm": nan}, "port torque"),
        ({"velocity_rad_s": 80.1}, "actuator velocity"),
        ({"velocity_rad_s": -80.1}, "actuator velocity"),
        ({"velocity_rad_s": nan}, "actuator velocity"),
        ({"load_velocity_rad_s": 81.0}, "load velocity"),
        ({"load_velocity_rad_s": nan}, "load velocity"),
        ({"load_position_rad": nan}, "load position"),
        ({"position_rad": 12.1}, "travel"),
        ({"position_rad": -8.1}, "travel"),
        ({"position_rad": nan}, "travel"),
        ({"torque_nm": 0.9, "velocity_rad_s": 30.0}, "port power"),
        ({"torque_nm": 0.9, "velocity_rad_s": -30.0}, "port power"),
        ({"torque_age_ns": 5_000_001}, "torque sensor: silent"),
        ({"motion_age_ns": 5_000_001}, "actuator encoder: silent"),
        ({"load_motion_age_ns": 5_000_001}, "load encoder: silent"),
        ({"torque_age_ns": -1}, "torque sensor: no reading"),
        ({"motion_age_ns": -1}, "actuator encoder: no reading"),
        ({"load_motion_age_ns": -1}, "load encoder: no reading"),
    ],
)
def test_each_limit_trips_latches_and_names_itself(change: dict[str, float], words: str) -> None:
    gate = guard()
    with pytest.raises(SafetyStopError, match=words):
        gate.limit(WISH, SAMPLE._replace(**change), (ACTUATOR, LOAD))
    with pytest.raises(SafetyStopError, match=words):  # a sample that is well again changes nothing
        gate.limit(WISH, SAMPLE, (ACTUATOR, LOAD))


@pytest.mark.parametrize("name", ["actuator", "load"])
@pytest.mark.parametrize(
    ("status", "words"),
    [
        (STATUS._replace(state=DriveState.IDLE), "left its torque loop"),
        (STATUS._replace(state=DriveState.UNKNOWN), "left its torque loop"),
        (STATUS._replace(state=DriveState.FAULT, errors=("watchdog timer expired",)), "watchdog timer expired"),
        (STATUS._replace(heartbeat_ns=NOW_NS - 300_000_001), "no heartbeat"),
        (STATUS._replace(heartbeat_ns=None), "no heartbeat"),
        (STATUS._replace(transistor_temperature_c=80.5), "transistors at"),
        (STATUS._replace(motor_temperature_c=95.0), "motor at"),
    ],
)
def test_each_drive_is_watched(name: str, status: DriveStatus, words: str) -> None:
    ill = DriveHealth(name, status, 300_000_000)
    drives = (ill, LOAD) if name == "actuator" else (ACTUATOR, ill)
    with pytest.raises(SafetyStopError, match=f"{name} drive.*{words}"):
        guard().limit(WISH, SAMPLE, drives)


@pytest.mark.parametrize(
    "wish",
    [Commands(nan, 0.0), Commands(0.0, nan), Commands(inf, 0.0), Commands(0.0, -inf), Commands(0.0, 0.0, 0, nan)],
)
def test_a_wish_that_is_no_number_is_never_sent(wish: Commands) -> None:
    with pytest.raises(SafetyStopError, match="not a number"):
        guard().limit(wish, SAMPLE, (ACTUATOR, LOAD))


@pytest.mark.parametrize("change", [{"torque_nm": nan}, {"load_position_rad": inf}])
def test_what_is_no_number_is_told_as_such(change: dict[str, float]) -> None:
    with pytest.raises(SafetyStopError, match=r"is no number: the device marks its reading as invalid"):
        guard().limit(WISH, SAMPLE._replace(**change), (ACTUATOR, LOAD))


class Doubt:
    """A check that finds fault with what was sent."""

    name = "doubt"

    def __init__(self) -> None:
        self.told: list[object] = []
        self.sent: list[Commands] = []

    def begin(self, sample: Sample) -> None:
        self.told.append(sample)

    def learn(self, known: GuardModel) -> None:
        self.told.append(known)

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        self.told.append(sample)
        self.sent.append(sent)
        return "that cannot be" if sent.command == 0.05 else None


def test_a_check_is_told_what_was_sent_and_its_word_stops_the_bench() -> None:
    doubt, known = Doubt(), GuardModel(moving_command=0.1)
    gate = Guard(LIMITS, 0.5, 1e-3, True, True, (doubt,))
    gate.learn(known)
    gate.begin(SAMPLE)
    assert doubt.told == [known, SAMPLE]
    assert gate.limit(WISH, SAMPLE, (ACTUATOR, LOAD)) == WISH
    assert doubt.told == [known, SAMPLE, SAMPLE]
    with pytest.raises(SafetyStopError, match="that cannot be") as stop:
        gate.limit(WISH, SAMPLE, (ACTUATOR, LOAD))
    assert stop.value.by == "doubt"
    assert doubt.sent == [Commands(0.0, 0.0), WISH]


def test_a_limit_speaks_before_a_check() -> None:
    gate = Guard(LIMITS, 0.5, 1e-3, True, True, (Doubt(),))
    gate.begin(SAMPLE)
    gate.limit(WISH, SAMPLE, (ACTUATOR, LOAD))
    with pytest.raises(SafetyStopError, match="port torque") as stop:
        gate.limit(WISH, SAMPLE._replace(torque_nm=2.0), (ACTUATOR, LOAD))
    assert stop.value.by == "torque"


def test_once_tripped_nothing_is_permitted_before_an_operator_says_so() -> None:
    gate = guard()
    gate.permit()
    gate.trip("the shaft broke", "coupling")
    with pytest.raises(SafetyStopError, match=r"before an operator says so .*; it was: the shaft broke") as stop:
        gate.permit()
    assert stop.value.by == "coupling"
    for silence in ("", "  "):
        with pytest.raises(UsageError, match="say who looked"):
            gate.reset(silence)
    with pytest.raises(SafetyStopError):
        gate.permit()
    gate.reset("N. Hogan: new shaft mounted")
    gate.permit()
    gate.begin(SAMPLE)
    assert gate.limit(WISH, SAMPLE, (ACTUATOR, LOAD)) == WISH


def test_a_guard_that_never_began_stops_at_once() -> None:
    with pytest.raises(SafetyStopError, match="position"):
        Guard(LIMITS, 0.5, 1e-3, True, True).limit(WISH, SAMPLE, (ACTUATOR, LOAD))


def test_what_the_rig_lacks_is_not_missed() -> None:
    bare = Sample(NOW_NS, position_rad=2.0, velocity_rad_s=1.0, motion_age_ns=0)
    gate = guard(has_load=False, has_torque_sensor=False)
    assert gate.limit(Commands(0.05, 0.0), bare, (ACTUATOR,)) == Commands(0.05, 0.0)


def test_a_modulator_must_be_heard_and_is_held_within_its_limit() -> None:
    gate = Guard(LIMITS, 0.5, 1e-3, True, True, modulation_limit=2.0)
    heard = SAMPLE._replace(modulator_position_rad=0.1, modulator_motion_age_ns=500_000)
    gate.begin(heard)
    for wished, passed in ((1.5, 1.5), (3.0, 2.0), (-3.0, -2.0)):
        found = gate.limit(WISH._replace(modulation=wished), heard, (ACTUATOR, LOAD))
        assert found.modulation == passed
        assert bool(found.limited & Limited.MODULATION) == (passed != wished)
    with pytest.raises(SafetyStopError, match=r"modulator encoder: silent for 6\.0 ms"):
        gate.limit(WISH, heard._replace(modulator_motion_age_ns=6_000_000), (ACTUATOR, LOAD))


@pytest.mark.parametrize(
    ("others_ns", "said"),
    [(1_000_000, "others were heard meanwhile"), (4_000_000, "nothing else was heard either")],
)
def test_a_silence_is_the_device_s_own_or_everybody_s(others_ns: int, said: str) -> None:
    silent = SAMPLE._replace(torque_age_ns=6_000_000, motion_age_ns=others_ns, load_motion_age_ns=others_ns)
    with pytest.raises(SafetyStopError, match=said):
        guard().limit(WISH, silent, (ACTUATOR, LOAD))


def test_a_limit_that_is_reached_after_a_stall_says_so() -> None:
    gate, fast = guard(), SAMPLE._replace(velocity_rad_s=-80.03)
    gate.stood_still(NOW_NS - 500_000_000, 90_000_000)  # long ago
    gate.stood_still(NOW_NS - 80_000_000, 24_000_000)
    gate.stood_still(NOW_NS, 41_000_000)
    with pytest.raises(SafetyStopError, match="the loop had stood still for 65 of the last 200 ms") as stop:
        gate.limit(WISH, fast, (ACTUATOR, LOAD))
    assert "ask for less" not in str(stop.value)
    calm = guard()
    calm.stood_still(NOW_NS - 500_000_000, 90_000_000)
    calm.stood_still(NOW_NS, 1_000_000)
    with pytest.raises(SafetyStopError, match="ask for less"):
        calm.limit(WISH, fast, (ACTUATOR, LOAD))


number = st.floats(-1e6, 1e6)


@given(st.lists(st.tuples(number, number), min_size=1, max_size=20))
def test_what_passes_is_within_every_bound(wishes: list[tuple[float, float]]) -> None:
    gate, last = guard(), 0.0
    for command, load_nm in wishes:
        passed = gate.limit(Commands(command, load_nm), SAMPLE, (ACTUATOR, LOAD))
        assert abs(passed.command) <= 0.5
        assert abs(passed.load_torque_nm) <= LIMITS.load_torque_nm
        assert abs(passed.command - last) <= LIMITS.command_rate_per_s * 1e-3 + 1e-12
        assert isfinite(passed.command)
        assert bool(passed.limited & Limited.LOAD_TORQUE) == (passed.load_torque_nm != load_nm)
        assert bool(passed.limited & (Limited.COMMAND | Limited.COMMAND_RATE)) == (passed.command != command)
        last = passed.command


@pytest.mark.parametrize(
    ("change", "mend"),
    [
        ({"velocity_rad_s": -80.03}, "ask for less (amplitude of the steps, [actuator.command] limit), or raise "),
        ({"torque_nm": 1.2}, "ask for less ([actuator.command] limit, [load] torque_limit), or raise [limits] torque"),
        ({"position_rad": 13.0}, "begin further from the end"),
    ],
)
def test_a_limit_that_was_reached_says_what_to_do(change: dict[str, float], mend: str) -> None:
    with pytest.raises(SafetyStopError) as stop:
        guard().limit(WISH, SAMPLE._replace(**change), (ACTUATOR, LOAD))
    assert mend in str(stop.value)
    assert "does nothing below" not in str(stop.value)
    lets_go = Guard(LIMITS, 0.5, 1e-3, has_load=True, has_torque_sensor=True, load_dead_band_nm=2.5e-3)
    lets_go.begin(SAMPLE._replace(position_rad=2.0))
    with pytest.raises(SafetyStopError, match=r"the load does nothing below 0\.0025 N m.*lower the drive's minimum"):
        lets_go.limit(WISH, SAMPLE._replace(**change), (ACTUATOR, LOAD))
