"""An actuator that stays assembled to its load, on a simulated bench without a torque sensor."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from norton_bench.errors import ExperimentError, RigError
from norton_bench.identification.assembly import LoadTaken, Machine
from norton_bench.identification.in_situ import (
    PUSHED,
    Exerted,
    InSituResult,
    figures,
    in_band_motion,
    in_situ_result,
    pushed_segments,
)
from norton_bench.identification.trials import settled
from norton_bench.models.network import NortonNetwork
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.in_situ import SIZE, InSituProcedure, InSituTrial, Size
from norton_bench.procedures.knowledge import Knowledge, carry_out
from norton_bench.procedures.options import CalibrateOptions, InSituOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.records import LOAD_TAKEN, Event, Measured, join
from norton_bench.rig.load import load_rig, parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use
from norton_bench.session.run import learned
from norton_sim.plant import Plant
from norton_sim.truth import read_truth
from tests.bench.bench_in_simulation import opened
from tests.bench.half_rate import half_rate, half_rate_text
from tests.bench.watched import Watched

RIGS = Path(__file__).parents[3] / "rigs"
RIG = load_rig(RIGS / "sim-in-situ.toml")
# The load's viscous damping as its drive counts newton metres, of which each gives 0.95: true to three digits.
TRUE_INERTIA_KGM2, VISCOUS_NMS_RAD = 1.2e-4 / 0.95, 3.16e-4
OPTIONS = InSituOptions(trials=7, duration_s=4.0, shake_s=8.0, viscous_damping_nms_rad=VISCOUS_NMS_RAD)


@dataclass(frozen=True)
class Found:
    known: Knowledge
    result: InSituResult
    true_rms_nm: list[float]
    said: list[str]

    @property
    def last_driven(self) -> int:
        return [trial.number for trial in self.result.trials if trial.driven][-1]

    def below_db(self, number: int) -> float:
        """How far the true torque of a trial lies below that of the first."""
        return float(20 * np.log10(self.true_rms_nm[0] / self.true_rms_nm[number - 1]))


def carried_out(
    rig: Rig, options: InSituOptions, before: Callable[[Knowledge, Watched], Knowledge] | None = None
) -> Found:
    with opened(rig) as bench:
        watched = Watched(bench)
        known = carry_out(TareProcedure(TareOptions(duration_s=0.5)), Knowledge(rig), bench.loop)
        if before is not None:
            known = before(known, watched)
        step, said = InSituProcedure(options), []
        while (decision := step.following(known)).procedure is not None:
            said.append(decision.sentence)
            known = carry_out(decision.procedure, decision.known, watched)
        result = concluded(decision.known)
        return Found(decision.known, result, watched.true_rms_nm, [*said, decision.sentence])


def concluded(known: Knowledge) -> InSituResult:
    """As a session does: from its records, and from what it says of the load."""
    result = in_situ_result(recorded(known), known.tick_s)
    assert result is not None
    return result


def recorded(known: Knowledge) -> Measured:
    assert known.in_situ is not None
    return replace(join(known.records), events=(Event(0, LOAD_TAKEN, known.in_situ.load.as_text()),))


@pytest.fixture(scope="module")
def found() -> Found:
    """The load's inertia is believed to be 20 % more than it is."""
    return carried_out(RIG, OPTIONS.model_copy(update={"inertia_kgm2": 1.2 * TRUE_INERTIA_KGM2}))


def free_velocity(command: np.ndarray, delay_s: float) -> np.ndarray:
    """True velocity of the same actuator with nothing on its shaft, as it arrives ``delay_s`` later."""
    truth = read_truth(RIG.simulated, seed=None, place=RIG.place)
    plant, position = Plant(truth.model_copy(update={"load": None}), 1, "free"), np.zeros(len(command))
    for tick, value in enumerate(command):
        position[tick] = plant.true_position_rad("actuator")
        plant.command("actuator", float(value))
        plant.advance((tick + 1) * RIG.tick_ns)
    velocity = np.gradient(in_band_motion(position, RIG.tick_s), RIG.tick_s)
    ticks = np.arange(len(command))
    return np.interp(ticks - delay_s / RIG.tick_s, ticks, velocity)


@pytest.mark.long
def test_the_actuators_own_torque_vanishes(found: Found) -> None:
    assert max(found.below_db(trial.number) for trial in found.result.trials if trial.driven) > 30.0
    assert found.below_db(found.last_driven) > 30.0


def test_the_motion_that_is_left_is_that_of_the_actuator_alone(found: Found) -> None:
    source = found.result.source
    assert source is not None
    # Command and reading each take their time, which the motion cannot tell.
    delays_s = np.arange(0.0, 1.5e-3, 1e-4)
    errors = [source.velocity_rad_s - free_velocity(source.command, delay_s) for delay_s in delays_s]
    rms = min(float(np.sqrt(np.mean(error**2))) for error in errors)
    assert rms < 0.01 * np.sqrt(np.mean(source.velocity_rad_s**2))


def test_the_assembly_is_shaken_for_as_long_as_is_asked(found: Found) -> None:
    shaken = [each for each in recorded(found.known).segments if each.use is Use.CALIBRATE]
    lasted_s = sum(each.end_ns - each.start_ns for each in shaken) * 1e-9
    assert lasted_s == pytest.approx(OPTIONS.shake_s, rel=0.01)


def test_what_was_believed_of_the_load_is_overruled_by_the_twist(found: Found) -> None:
    load = assembled_load(found)
    assert load.inertia_kgm2 == pytest.approx(TRUE_INERTIA_KGM2, rel=0.02)
    assert load.viscous_damping_nms_rad == VISCOUS_NMS_RAD
    assert "+20 %, and is ignored" in found.said[1]


def test_some_trials_are_left_alone_and_tell_the_floor(found: Found) -> None:
    alone = [trial for trial in found.result.trials if not trial.driven]
    assert alone[0].number == 1
    assert len(alone) >= 2
    assert 0.0 < alone[0].noise_nm < 0.05 * alone[0].with_noise_nm
    assert alone[-1].with_noise_nm == pytest.approx(alone[0].with_noise_nm, rel=0.05)


def test_no_torque_was_read(found: Found) -> None:
    assert all(len(record.torque) == 0 for record in found.known.records)


def calibrated(known: Knowledge, watched: Watched) -> Knowledge:
    watched.loop.learn(learned(known))
    return carry_out(CalibrateProcedure(CalibrateOptions(duration_s=4.0)), known, watched.loop)


def assembled_load(found: Found) -> NortonNetwork:
    """What the load was taken for, in newton metres as its drive counts them."""
    assert found.known.in_situ is not None
    assert found.known.in_situ.assembly is not None
    return found.known.in_situ.assembly.load.network


def stiff(name: str) -> Rig:
    text = half_rate_text(name)
    for stiffness in (50, 200):
        text = text.replace(f'stiffness = "{stiffness} N*m/rad"', 'stiffness = "2000 N*m/rad"')
    return parse_rig(text, place=name)


@pytest.mark.long
def test_a_load_that_cannot_be_told_from_the_actuator_is_refused() -> None:
    with pytest.raises(ExperimentError, match="load and actuator cannot be separated: the coupling twists too"):
        carried_out(stiff("sim-in-situ"), OPTIONS)


@pytest.mark.long
def test_an_arm_on_the_load_is_found_and_named() -> None:
    """Its weight is told by the twist like the rest: 20 mN·m are 21.05 as its drive counts them."""
    text = (RIGS / "sim-in-situ.toml").read_text(encoding="utf-8")
    place = "mounted = -1 "
    assert place in text
    rig = parse_rig(text.replace(place, f'gravity = {{ amplitude = "20 mN*m" }}\n{place}'), place="arm")
    with pytest.raises(ExperimentError, match=r"an arm hangs on the load, with a torque of up to 0\.021\d? N\*m by"):
        carried_out(rig, OPTIONS)


@pytest.mark.long
def test_a_load_that_was_calibrated_is_believed_where_nothing_can_check_it() -> None:
    found = carried_out(stiff("sim-odrive"), InSituOptions(trials=4, duration_s=2.0, shake_s=4.0), calibrated)
    assert "cannot be checked" in found.result.assembly[0]
    assert found.below_db(3) > 28.0
    # The torque sensor's newton metres, of which the load's drive gives 0.95 for each of its own.
    load = assembled_load(found)
    assert load.inertia_kgm2 == pytest.approx(TRUE_INERTIA_KGM2, rel=0.02)
    assert load.viscous_damping_nms_rad == pytest.approx(VISCOUS_NMS_RAD, rel=0.03)


@pytest.mark.long
def test_the_viscous_damping_that_was_calibrated_counts_as_the_loads_drive_does() -> None:
    options = InSituOptions(trials=4, duration_s=2.0, shake_s=4.0)
    found = carried_out(half_rate("sim-odrive"), options, calibrated)
    assert "by the twist between the encoders" in found.result.assembly[0]
    assert assembled_load(found).viscous_damping_nms_rad == pytest.approx(VISCOUS_NMS_RAD, rel=0.03)


def test_its_recording_tells_what_it_judged_by(found: Found) -> None:
    """The same trials, driven or not, as it saw them on its way."""
    state = found.known.in_situ
    assert state is not None
    assert found.result.trials == figures(state.trials)
    assert found.result.assembly == state.load.said
    assert state.load == LoadTaken.of_text(state.load.as_text())
    assert "; ".join(found.result.reasons) in found.said[-1]


def test_a_trial_that_was_cut_short_is_left_out(found: Found) -> None:
    whole = recorded(found.known)
    *before, last = whole.segments
    cut = replace(whole, segments=(*before, replace(last, end_ns=last.end_ns - 500_000_000)))
    result = in_situ_result(cut, found.known.tick_s)
    assert result is not None
    numbers = [trial.number for trial in found.result.trials]
    assert [trial.number for trial in result.trials] == numbers[:-1]
    assert in_situ_result(replace(whole, segments=whole.segments[:3]), found.known.tick_s) is None


def test_what_the_load_was_taken_for_is_read_or_refused() -> None:
    with pytest.raises(ExperimentError, match="what the load was taken for cannot be read"):
        LoadTaken.of_text('{"network": {}}')


def test_it_ends_and_says_so_where_more_is_left_than_movements_differ_by(found: Found) -> None:
    assert found.known.in_situ is not None
    wave = np.sin(np.arange(4000) * 0.02)
    trials = tuple(
        Exerted(number, driven, (1e-3 if driven else 1e-2) * wave * (1 + 1e-3 * number), wave)
        for number, driven in enumerate((False, True, True, False, True, True, True), 1)
    )
    state = replace(found.known.in_situ, trials=trials, finished=False)
    decision = InSituProcedure(OPTIONS).following(replace(found.known, in_situ=state))
    assert decision.procedure is None
    assert (
        "after 7 trials more is left than the scatter of movements and the load's values explain" in decision.sentence
    )
    assert not settled(figures(trials))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "because"), [("sim-series-elastic", "the actuator has no model"), ("sim-servo", "the actuator is a servo")]
)
def test_another_actuator_than_a_motor_is_learned_from_its_response(name: str, because: str) -> None:
    """A motor behind a spring, and one behind its own loop: the command of both is a position. As little torque is left
    as is said, at least.
    """
    rig = half_rate(name)
    found = carried_out(rig, InSituOptions(trials=7, duration_s=4.0, shake_s=8.0))
    assert f"{because}: its response is learned from the trials" in found.result.assembly
    assert "the greatest movement that is not too fast" in found.said[1]
    trials = found.result.trials
    assert found.below_db(found.last_driven) > trials[found.last_driven - 1].below_db(trials[0]) > 12.0
    source = found.result.source
    assert source is not None
    assert 0.3 < np.max(np.abs(source.velocity_rad_s)) / rig.limits.velocity_rad_s < 0.6


@pytest.mark.long
def test_the_impedance_about_the_path_is_told_with_the_source() -> None:
    """Three springs in a row: its own, that of its motor's loop, the torque sensor; in units of the load's drive."""
    found = carried_out(half_rate("sim-series-elastic"), InSituOptions(trials=5, duration_s=4.0, shake_s=8.0))
    about = found.result.impedance
    assert about is not None
    assert about.linear
    assert about.values[2] == pytest.approx(1 / (1 / 3 + 1 / 30 + 1 / 200) / 0.95, rel=0.02)
    assert about.half[2] < 0.02 * about.values[2]


@pytest.mark.long
def test_a_command_of_one_sign_is_moved_about_its_middle() -> None:
    found = carried_out(half_rate("sim-pneumatic"), InSituOptions(trials=7, duration_s=4.0, shake_s=16.0))
    command = found.known.in_situ.command  # type: ignore[union-attr]
    assert command[0] == command[-1] == pytest.approx(0.025)
    assert 0.0 <= np.min(command) < 0.02
    assert found.below_db(found.last_driven) > 20.0


@pytest.mark.long
def test_an_arm_reaches_from_level_to_level() -> None:
    found = carried_out(half_rate("sim-arm"), InSituOptions(trials=5, duration_s=4.0, shake_s=8.0, hold_s=0.5))
    assert len(np.unique(found.known.in_situ.command)) == 9  # type: ignore[union-attr]
    assert found.below_db(found.last_driven) > 25.0


@pytest.mark.long
def test_pushed_off_its_path_an_arm_shows_how_stiff_it_is_at_each_instant() -> None:
    """2 N m/rad at rest and 3 in the middle of each reach, of newton metres of which the load drive counts 1/0.95, in
    series with the coupling."""
    options = InSituOptions(trials=5, duration_s=4.0, shake_s=8.0, hold_s=0.5, pushes=5)
    result = carried_out(half_rate("sim-arm"), options)
    along, posture, reach = result.result.along, *(1 / (0.95 / k + 0.95 / 200.0) for k in (2.0, 3.0))
    assert along is not None
    assert len(result.result.trials) == 5
    assert along.linear
    assert along.resolution_s <= 0.1
    assert np.quantile(along.stiffness_nm_rad, [0.1, 0.9]) == pytest.approx([posture, reach], rel=0.03)
    held = [k for k in (posture, reach) if np.any(np.abs(along.stiffness_nm_rad - k) < along.stiffness_half_nm_rad)]
    assert held == [posture, reach]
    assert sum("off the path with up to" in sentence for sentence in result.said) == 5


def test_where_there_is_no_room_for_pushes_the_step_ends_and_says_so(found: Found) -> None:
    state = found.known.in_situ
    assert state is not None
    slow = replace(RIG, limits=replace(RIG.limits, velocity_rad_s=0.1))
    known = replace(found.known, rig=slow, in_situ=replace(state, finished=False))
    decision = InSituProcedure(OPTIONS.model_copy(update={"pushes": 4})).following(known)
    assert decision.procedure is None
    assert "leaves no room for that; set a smaller amplitude" in decision.sentence


def test_pushes_of_a_resumed_session_lie_before_its_clock_began(found: Found) -> None:
    record = found.known.records[-1]
    before = [replace(record.segments[-1], name=f"{PUSHED}{number}", start_ns=-(10**10) + number) for number in (1, 2)]
    assert pushed_segments(replace(record, segments=tuple(before))) == before


def test_pushes_are_none_or_enough_to_tell_how_sure_they_are() -> None:
    with pytest.raises(ValidationError, match="pushes must be 4 or more, or 0"):
        InSituOptions(pushes=2)


def test_a_movement_that_is_too_fast_at_its_smallest_is_refused(found: Found) -> None:
    state, record = found.known.in_situ, found.known.records[-1]
    assert state is not None
    moved = replace(record.segments[-1], name=f"{SIZE}0.05")
    size = Size(OPTIONS.model_copy(update={"amplitude": 1e-3}), state)
    with pytest.raises(ExperimentError, match=r"the smallest movement .* is faster than 0\.08 rad/s, or goes too far"):
        size.conclude(found.known, replace(record, segments=(moved,)))


def test_a_movement_that_goes_too_far_is_refused_too(found: Found) -> None:
    state, record = found.known.in_situ, found.known.records[-1]
    assert state is not None
    near = replace(RIG, limits=replace(RIG.limits, position_rad=1e-2))
    moved = replace(record.segments[-1], name=f"{SIZE}0.05")
    with pytest.raises(ExperimentError, match="or goes too far"):
        Size(OPTIONS, state).conclude(replace(found.known, rig=near), replace(record, segments=(moved,)))


def test_no_load_torque_is_sent_beyond_the_loads_limit(found: Found) -> None:
    state = found.known.in_situ
    assert state is not None
    unfinished = replace(state, trials=state.trials[:2], readings=state.readings[:2], finished=False)
    weak = replace(RIG, limits=replace(RIG.limits, load_torque_nm=0.02))
    for rig, greatest_nm in ((RIG, 1.0), (weak, 0.02)):
        trial = InSituProcedure(OPTIONS).following(replace(found.known, rig=rig, in_situ=unfinished)).procedure
        assert isinstance(trial, InSituTrial)
        assert 0.02 <= np.max(np.abs(trial.load_torque_nm)) <= greatest_nm


@pytest.mark.long
def test_an_arm_on_a_calibrated_load_is_refused_too() -> None:
    with pytest.raises(ExperimentError, match="an arm hangs on the load, with a torque of up to"):
        carried_out(half_rate("sim-gravity"), InSituOptions(trials=4, duration_s=2.0, shake_s=4.0), calibrated)


def one_sided(rig: Rig) -> Rig:
    return replace(rig, command=replace(rig.command, lowest=0.0))


def test_it_refuses_what_it_cannot_move_to_and_fro() -> None:
    with pytest.raises(RigError, match="turn it to one side only"):
        InSituProcedure().require(one_sided(load_rig(RIGS / "sim-odrive.toml")))
    InSituProcedure().require(load_rig(RIGS / "sim-pneumatic.toml"))
    with pytest.raises(RigError, match="a servo would jump from level to level"):
        InSituProcedure(InSituOptions(hold_s=0.5)).require(load_rig(RIGS / "sim-servo.toml"))


def test_levels_are_held_within_the_movement() -> None:
    with pytest.raises(ValueError, match="hold is longer than half of the duration"):
        InSituOptions(duration_s=2.0, hold_s=1.5)


def test_how_well_the_load_is_known_tells_how_well_the_torque_is() -> None:
    """A load 2 % off in inertia, at a gain of 0.95, leaves 2 % of the torque that moves the inertia open."""
    network = replace(
        NortonNetwork(0.95, 1000.0, 1.2e-4, 3e-4, 8e-3, 8.0, 5e-3, "N*m"),
        covariance_names=("torque_gain", "inertia"),
        covariance=((1e-8, 0.0), (0.0, (0.02 * 1.2e-4) ** 2)),
    )
    load = Machine(network, 0.0, 0.0).in_drive_units()
    inertias = [each.network.inertia_kgm2 for each in load.drawn()]
    assert np.mean(inertias) == pytest.approx(TRUE_INERTIA_KGM2, rel=0.01)
    assert np.std(inertias) == pytest.approx(0.02 * TRUE_INERTIA_KGM2, rel=0.3)
    assert load.knowing("inertia", 2e-4).drawn()[3].network.inertia_kgm2 == 2e-4
    assert Machine(replace(network, covariance_names=(), covariance=()), 0.0, 0.0).drawn() == ()
    taken = LoadTaken(load, ("as it is",), 100)
    assert LoadTaken.of_text(taken.as_text()) == taken


def test_it_needs_a_load_drive() -> None:
    with pytest.raises(RigError, match="needs a load drive"):
        InSituProcedure().require(load_rig(RIGS / "sim-free-shaft.toml"))
