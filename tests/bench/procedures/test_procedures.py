"""Procedures refuse what the rig cannot do before anything moves, and ask for nothing beyond its limits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from norton_bench.control.calibration import ActuatorFriction
from norton_bench.errors import ExperimentError, RigError, UsageError
from norton_bench.identification.results import FitResult, Trace
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Estimate, Status
from norton_bench.procedures.blocked import BlockedProcedure
from norton_bench.procedures.calibrate import CalibrateProcedure, first_friction, first_inertia_kgm2, known_well_enough
from norton_bench.procedures.catalogue import CATALOGUE, make_procedures
from norton_bench.procedures.free import FreeProcedure
from norton_bench.procedures.imposed import ImposedProcedure
from norton_bench.procedures.knowledge import Knowledge, Procedure, Tare, carry_out
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure, sensor_response
from norton_bench.procedures.tare import torque_sign_faults as signs
from norton_bench.procedures.validate import ValidateProcedure
from norton_bench.records import TICK, TORQUE, Measured
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Command, Rig
from norton_bench.segments import LoadMode, Segment
from tests.bench.bench_in_simulation import opened

RIGS = Path(__file__).parents[3] / "rigs"
RIG = load_rig(RIGS / "sim-odrive.toml")
ALL: tuple[Procedure, ...] = (
    TareProcedure(),
    CalibrateProcedure(),
    FreeProcedure(),
    BlockedProcedure(),
    ImposedProcedure(),
    ValidateProcedure(),
)


def rig_without(*sections: str, shaft: str = "free") -> Rig:
    return replace(RIG, wiring=replace(RIG.wiring, shaft=shaft, **dict.fromkeys(sections)))


@pytest.mark.parametrize(
    ("procedure", "rig", "words"),
    [
        (CalibrateProcedure(), rig_without("load"), "needs a load drive"),
        (ImposedProcedure(), rig_without("load"), "needs a load drive"),
        (ImposedProcedure(), rig_without("torque_sensor"), "needs a torque sensor"),
        (BlockedProcedure(), rig_without("load"), "holds the shaft"),
        (BlockedProcedure(), rig_without("torque_sensor"), "needs a torque sensor"),
        (FreeProcedure(), rig_without("load", shaft="clamped"), "shaft that can turn"),
        (FreeProcedure(), rig_without("torque_sensor"), "needs a torque sensor"),
    ],
)
def test_what_the_rig_lacks_is_refused_in_a_sentence(procedure: Procedure, rig: Rig, words: str) -> None:
    with pytest.raises(RigError, match=words):
        procedure.require(rig)


@pytest.mark.parametrize(
    ("procedure", "rig"),
    [
        (FreeProcedure(), rig_without("load", "torque_sensor")),
        (BlockedProcedure(), rig_without("load", shaft="clamped")),
        *((procedure, RIG) for procedure in ALL),
    ],
)
def test_what_the_rig_can_do_is_accepted(procedure: Procedure, rig: Rig) -> None:
    """No error is raised."""
    procedure.require(rig)


def test_steps_that_build_on_others_must_follow_them() -> None:
    with pytest.raises(UsageError, match="step 1 'free' needs 'calibrate'"):
        make_procedures([("free", FreeProcedure().options)], RIG, place="s.toml")
    first = [("tare", TareOptions()), ("calibrate", CalibrateProcedure().options)]
    with pytest.raises(UsageError, match="step 3 'validate' needs 'free'"):
        make_procedures([*first, ("validate", ValidateProcedure().options)], RIG, place="s.toml")
    alone = rig_without("load", "torque_sensor")
    with pytest.raises(UsageError, match="step 1 'validate' needs 'free'"):
        make_procedures([("validate", ValidateProcedure().options)], alone, place="s.toml")
    made = make_procedures([(name, entry.make().options) for name, entry in CATALOGUE.items()], RIG, place="s.toml")
    assert [procedure.name for procedure in made] == list(CATALOGUE)


def played(procedure: Procedure, known: Knowledge) -> list[Segment]:
    """The procedure's segments, each answered as by a bench on which nothing ever moves."""
    segments: list[Segment] = []
    plan = procedure.plan(known)
    segment = next(plan)
    while True:
        segments.append(segment)
        ticks = np.zeros(segment.ticks, Measured().ticks.dtype)
        ticks["command"] = segment.command
        try:
            segment = plan.send(Measured(ticks=ticks))
        except StopIteration:
            return segments


@pytest.mark.parametrize("procedure", ALL[1:], ids=lambda procedure: procedure.name)
def test_no_segment_asks_for_more_than_the_rig_allows(procedure: Procedure) -> None:
    limits = RIG.limits
    for segment in played(procedure, Knowledge(RIG)):
        assert np.max(np.abs(segment.command)) <= RIG.command.limit
        assert np.max(np.abs(segment.velocity_rad_s), initial=0.0) <= limits.velocity_rad_s
        assert np.max(np.abs(segment.load_torque_nm), initial=0.0) <= min(limits.load_torque_nm, limits.torque_nm)
        if segment.mode is LoadMode.ADMITTANCE and segment.admittance.rigid:
            assert len(segment.position_rad) == len(segment.acceleration_rad_s2) == segment.ticks


@pytest.mark.parametrize("procedure", ALL[1:], ids=lambda procedure: procedure.name)
def test_the_announced_duration_is_about_right(procedure: Procedure) -> None:
    taken_s = sum(segment.ticks for segment in played(procedure, Knowledge(RIG))) * RIG.tick_s
    assert taken_s == pytest.approx(procedure.duration_s(RIG), rel=0.2)


def test_a_shaft_that_never_turns_is_named() -> None:
    with pytest.raises(ExperimentError, match="did not turn"):
        played(TareProcedure(), Knowledge(RIG))


@pytest.mark.parametrize(
    ("section", "words"),
    [("load", "reverse .load. direction"), ("torque_sensor", "reverse .torque_sensor. direction")],
)
def test_a_wrong_sign_in_the_rig_file_is_found_and_named(section: str, words: str) -> None:
    device = getattr(RIG.wiring, section)
    wrong = replace(RIG, wiring=replace(RIG.wiring, **{section: replace(device, direction=-device.direction)}))
    with opened(wrong) as bench, pytest.raises(ExperimentError, match=words):
        carry_out(TareProcedure(TareOptions(duration_s=0.5)), Knowledge(wrong), bench.loop)


def with_sensor(**changes: str) -> Rig:
    """The rig with another torque sensor."""
    sensor = {**RIG.simulated["torque_sensor"], **changes}
    return replace(RIG, simulated={**RIG.simulated, "torque_sensor": sensor})


def test_a_push_that_noise_hides_is_made_again_and_faster() -> None:
    """The port feels 14 mN m of it: of 60 mN m of noise, one push of 1.2 s tells that to some four deviations."""
    noisy = with_sensor(noise="60 mN*m")
    with opened(noisy) as bench:
        known = carry_out(TareProcedure(TareOptions(duration_s=1.0)), Knowledge(noisy), bench.loop)
    segments = known.records[-1].segments
    assert "load pushes again" in [segment.name for segment in segments]
    assert known.tare is not None
    assert known.tare.moving_load_nm == pytest.approx(0.035, rel=0.2)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_felt_of_a_push_has_an_honest_deviation(seed: int) -> None:
    """A torque in proportion to the push, among noise, in counts of 1 mN m."""
    random = np.random.default_rng(seed)
    felt_nm, noise_nm, count = 5e-3, 2e-3, 1000

    def read(torque_nm: npt.NDArray[np.float64], start_ns: int) -> Measured:
        ticks, readings = np.zeros(count, TICK), np.zeros(count, TORQUE)
        ticks["tick_ns"] = readings["arrival_ns"] = start_ns + 1_000_000 * np.arange(count)
        ticks["command"] = torque_nm
        seen = 8e-3 + felt_nm * torque_nm + noise_nm * random.standard_normal(count)
        readings["torque_nm"], readings["valid"] = np.round(seen, 3), True
        return Measured(ticks=ticks, torque=readings)

    rest, push = read(np.zeros(count), 0), read(np.geomspace(0.01, 1.0, count), 2_000_000_000)
    answer = sensor_response(push, rest)
    assert answer.tells
    assert abs(answer.torque_nm - felt_nm) < 3.5 * answer.deviation_nm
    assert answer.deviation_nm < 0.15 * noise_nm
    unfelt = replace(read(np.zeros(count), 2_000_000_000), ticks=push.ticks)
    assert any("does not measure the push" in fault and "mN m a reading" in fault for fault in signs(unfelt, rest, 1))
    assert list(signs(push, rest, 1)) == []


def test_tare_finds_bias_and_noise() -> None:
    with opened(RIG) as bench:
        known = carry_out(TareProcedure(TareOptions(duration_s=1.0)), Knowledge(RIG), bench.loop)
    assert known.tare is not None
    # The rig's simulated sensor: 1 mN·m of noise; bias 3 mN·m; a thousand samples.
    assert known.tare.torque_noise_nm == pytest.approx(1e-3, rel=0.1)
    assert known.tare.torque_bias_nm == pytest.approx(3e-3, abs=4e-3 / np.sqrt(1000))
    # Both frictions together, 28 mN·m, held against 0.95 and 0.9 of what is told, and what gaining speed takes.
    assert known.tare.moving_load_nm == pytest.approx(0.035, rel=0.2)
    assert known.tare.moving_command == pytest.approx(0.037, rel=0.2)
    assert known.tare.moving_load_nm < known.tare.moving_command


def test_tare_says_nothing_of_pushes_that_were_not_made() -> None:
    free = load_rig(RIGS / "sim-free-shaft.toml")
    with opened(free) as bench:
        known = carry_out(TareProcedure(TareOptions(duration_s=0.5)), Knowledge(free), bench.loop)
    assert known.tare is not None
    assert (known.tare.moving_load_nm, known.tare.moving_command is None) == (None, False)


@pytest.mark.long
def test_a_loop_faster_than_its_devices_calibrates_as_well() -> None:
    fast = replace(RIG, wiring=replace(RIG.wiring, tick_ns=500_000))
    with opened(fast) as bench:
        known = carry_out(TareProcedure(TareOptions(duration_s=1.0)), Knowledge(fast), bench.loop)
        calibration = carry_out(CalibrateProcedure(CalibrateOptions(duration_s=2.0)), known, bench.loop).calibration
    assert calibration is not None
    assert calibration.inertia_kgm2 == pytest.approx(1.2e-4, rel=0.02)


def told_by(**told: tuple[float, Status]) -> FitResult:
    """An actuator's fit whose inertia, friction and stiffness have these relative deviations."""
    network = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, command_unit="N*m")
    values = {"inertia": (5e-5, "kg*m^2"), "coulomb_torque": (0.02, "N*m"), "presliding_stiffness": (10.0, "N*m/rad")}
    estimates = tuple(
        Estimate(name, value, told[name][0] * value, unit, told[name][1]) for name, (value, unit) in values.items()
    )
    gain = Estimate("torque_gain", 0.9, 0.5, "N*m/(N*m)", Status.VALID)
    damping = Estimate("presliding_damping", 0.01, 1e-4, "N*m*s/rad", Status.VALID)
    trace = Trace(np.zeros(1), np.zeros(1), np.zeros(1), "N*m")
    return FitResult((gain, *estimates, damping), network, True, 1e-3, 0.01, 1000, 0.0, 0.0, 0.0, 0.0, trace)


KNOWN = {"inertia": (0.04, Status.VALID), "coulomb_torque": (0.04, Status.VALID)}
WELL = {**KNOWN, "presliding_stiffness": (0.15, Status.VALID)}


def test_an_actuators_friction_that_the_calibration_tells_well_is_built_on() -> None:
    assert first_friction(told_by(**WELL)) == ActuatorFriction(1e-3, 0.02, 10.0, 0.01)


@pytest.mark.parametrize(
    "told",
    [
        {"inertia": (0.06, Status.VALID)},
        {"coulomb_torque": (0.06, Status.VALID)},
        {"presliding_stiffness": (0.25, Status.VALID)},
        {"presliding_stiffness": (0.15, Status.DOUBTFUL)},
    ],
    ids=["inertia", "coulomb torque", "stiffness", "doubtful"],
)
def test_a_friction_that_it_does_not_tell_well_is_not(told: dict[str, tuple[float, Status]]) -> None:
    assert first_friction(told_by(**{**WELL, **told})) is None


def test_nor_is_one_of_a_fit_that_did_not_converge_or_was_not_made() -> None:
    assert first_friction(replace(told_by(**WELL), converged=False)) is None
    assert first_friction(None) is None


def test_a_friction_that_a_search_without_an_end_is_sure_of_is_built_on() -> None:
    """The bandwidth of an amplifier that is too quick to be seen has no greatest value."""
    sure = {name: (share, Status.NOT_CONVERGED) for name, (share, _) in WELL.items()} | {
        "inertia": (0.03, Status.NOT_CONVERGED)
    }
    fit = replace(told_by(**sure), converged=False)
    gain = Estimate("torque_gain", 0.9, 0.01, "N*m/(N*m)", Status.NOT_CONVERGED)
    endless = replace(fit, estimates=(gain, *fit.estimates[1:]), torque_relative=0.1)
    assert first_friction(endless) == ActuatorFriction(1e-3, 0.02, 10.0, 0.01)
    assert first_friction(fit) is None


def test_an_inertia_per_unit_of_torque_gain_is_none() -> None:
    assert first_inertia_kgm2(told_by(**WELL)) == 5e-5
    assert first_inertia_kgm2(told_by(**{**WELL, "inertia": (np.nan, Status.RATIO_ONLY)})) is None


def test_a_load_whose_contact_no_count_can_tell_will_do() -> None:
    """The search for its stiffness goes on for ever; the rest is sure."""

    def fit_with(inertia: float, *, left: float = 0.1) -> FitResult:
        told = {**WELL, "inertia": (inertia, Status.NOT_CONVERGED), "presliding_stiffness": (5.0, Status.NOT_CONVERGED)}
        fit = told_by(**told)
        gain = Estimate("torque_gain", 0.95, 0.01, "N*m/(N*m)", Status.NOT_CONVERGED)
        return replace(fit, estimates=(gain, *fit.estimates[1:]), converged=False, torque_relative=left)

    assert known_well_enough(fit_with(0.01))
    assert not known_well_enough(fit_with(0.2))
    assert not known_well_enough(fit_with(0.01, left=0.6))
    assert known_well_enough(replace(fit_with(0.2), converged=True))


def shaken_nm(command: Command, tare: Tare | None) -> float:
    """The greatest load torque of the calibration's search, on a rig whose load may give 1 N·m."""
    known = Knowledge(replace(RIG, command=command), tare)
    return float(np.max(np.abs(next(CalibrateProcedure().plan(known)).load_torque_nm)))


@pytest.mark.parametrize(
    ("command", "moving", "greatest_nm"),
    [
        (Command("N*m", 0.5), (0.04, 0.04), 1.0),
        (Command("N*m", 0.12), (0.06, 0.06), 0.36),
        (Command("A", 3.0), (0.75, -0.05), 0.6),
        (Command("N*m", 0.12), (0.06, None), 1.0),
        (Command("N*m", 0.12), (None, 0.06), 1.0),
        (Command("rad", 0.4, sent_as="N*m"), (0.1, 0.01), 1.0),
    ],
)
def test_the_load_shakes_no_more_than_three_times_as_hard_as_the_actuator(
    command: Command, moving: tuple[float | None, float | None], greatest_nm: float
) -> None:
    tare = Tare(0.0, 1e-3, *moving)
    assert shaken_nm(command, tare) == pytest.approx(shaken_nm(command, None) * greatest_nm)


def test_a_shake_that_breaks_loose_ends_below_the_velocity_limit() -> None:
    """Half as strong again as one that friction held back; the next one is weaker, and begins at rest."""
    known = Knowledge(RIG, tare=Tare(torque_bias_nm=0.0, torque_noise_nm=1e-3))
    plan = CalibrateProcedure().plan(known)
    next(plan)
    search = Measured(ticks=np.zeros(2000, TICK))
    plan.send(search)
    shake = plan.send(Measured(ticks=np.zeros(400, TICK)))
    limit_rad_s = RIG.limits.velocity_rad_s
    assert (shake.name, shake.stop_at_velocity_rad_s) == ("shake", pytest.approx(0.7 * limit_rad_s))
    fast = np.zeros(1000, TICK)
    fast["velocity_rad_s"] = np.linspace(0.0, 0.72 * limit_rad_s, 1000)
    assert plan.send(Measured(ticks=fast)).name == "rest"
    weaker = plan.send(Measured(ticks=np.zeros(400, TICK)))
    assert weaker.name == "shake"
    assert 0.5 < np.std(weaker.load_torque_nm) / np.std(shake.load_torque_nm) < 0.65
