"""Steps plan within every limit of the rig, by what was measured before them, and say what that costs."""

from contextlib import suppress
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.control import design
from norton_bench.control.calibration import LoadCalibration
from norton_bench.identification.results import FitResult, Trace
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Estimate, Status
from norton_bench.procedures.blocked import BlockedProcedure
from norton_bench.procedures.excitations import LEAST, SHARE, PlanBounds, bounds_of, words_for
from norton_bench.procedures.free import TOO_FAST, FreeProcedure
from norton_bench.procedures.imposed import ImposedProcedure
from norton_bench.procedures.knowledge import Knowledge, Plan, Procedure, Reducing, Tare
from norton_bench.procedures.validate import ValidateProcedure
from norton_bench.procedures.waves import Motion
from norton_bench.records import TICK, Measured, SegmentInfo, join
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import PRESCRIBED_MOTION, LoadMode, Segment
from norton_drivers.servo import Servo
from tests.bench.control.test_design import COARSE
from tests.bench.procedures.test_procedures import played

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-odrive.toml")
# A heavy machine that a light one drives: at speed it takes more than 10 W to turn it round.
STRONG = NortonNetwork(0.9, 600.0, 1.5e-4, 2e-3, 0.04, 10.0, 0.01, command_unit="N*m")
# Time constant 0.9 s: a search that ends at 48 rad/s has found commands that lead to 80 and more.
SLOW = NortonNetwork(0.049, 220.0, 2.2e-4, 2.4e-4, 0.045, 3.3, 0.023, command_unit="N*m")
LOAD = LoadCalibration(
    0.95, 1e3, 1.2e-4, 3e-4, 0.008, 8.0, 0.005, 1.5e-3, 0.0, 200.0, 0.01, 1e-3, 0.0, 4.8e-5, -1e-3, 5e-5
)
STEPS: tuple[Procedure, ...] = (BlockedProcedure(), ImposedProcedure(), ValidateProcedure())


def fit_of(network: NortonNetwork, status: Status = Status.VALID) -> FitResult:
    values = {"torque_gain": network.torque_gain, "inertia": network.inertia_kgm2}
    estimates = tuple(Estimate(name, value, 0.01 * value, "", status) for name, value in values.items())
    nothing = np.zeros(0)
    return FitResult(
        estimates, network, True, 0.0, 0.0, 0, 0.0, 0.0, 0.0, 0.0, trace=Trace(nothing, nothing, nothing, "N*m")
    )


def known_of(network: NortonNetwork, rig: Rig = RIG, span: tuple[float, float] = (-0.26, 0.26)) -> Knowledge:
    return Knowledge(rig, calibration=LOAD, actuator=fit_of(network), command_span=span)


def within(segment: Segment, bounds: PlanBounds) -> bool:
    motion = Motion(segment.position_rad, segment.velocity_rad_s, segment.acceleration_rad_s2)
    return bounds.allow(segment.command, motion, SHARE)


@pytest.mark.parametrize("power_w", [20.0, 5.0])
@pytest.mark.parametrize("procedure", STEPS, ids=lambda procedure: procedure.name)
def test_every_imposed_segment_keeps_to_every_limit(procedure: Procedure, power_w: float) -> None:
    known = known_of(STRONG, replace(RIG, limits=replace(RIG.limits, power_w=power_w)))
    bounds = bounds_of(known)
    assert bounds is not None
    driven = [
        segment
        for segment in played(procedure, known)
        if segment.mode is LoadMode.ADMITTANCE and segment.admittance == PRESCRIBED_MOTION
    ]
    assert driven
    assert all(within(segment, bounds) for segment in driven if "release" not in segment.name)


def test_the_usual_plan_would_have_gone_beyond_the_power_limit_and_says_what_less_of_it_costs() -> None:
    rig = replace(RIG, limits=replace(RIG.limits, power_w=10.0))
    known, procedure = known_of(STRONG, rig), ImposedProcedure()
    bounds = bounds_of(known)
    assert bounds is not None
    usual = [segment for segment in played(procedure, replace(known, actuator=None)) if len(segment.velocity_rad_s)]
    torque_nm = STRONG.torque(usual[0].command, usual[0].position_rad, RIG.tick_s)
    assert np.max(np.abs(torque_nm * usual[0].velocity_rad_s)) > rig.limits.power_w
    assert isinstance(procedure, Reducing)
    sentences = procedure.reductions(known)
    assert sentences
    assert all("times wider" in sentence for sentence in sentences)


@pytest.mark.parametrize("procedure", STEPS, ids=lambda procedure: procedure.name)
def test_nothing_is_made_smaller_that_fits(procedure: Procedure) -> None:
    weak = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, command_unit="N*m")
    known = known_of(weak, span=(-0.08, 0.08))
    assert isinstance(procedure, Reducing)
    assert procedure.reductions(known) == ()
    blind = played(procedure, replace(known, actuator=None))
    for segment, other in zip(played(procedure, known), blind, strict=True):
        np.testing.assert_array_equal(segment.command, other.command)
        np.testing.assert_array_equal(segment.velocity_rad_s, other.velocity_rad_s)


# ---- The shakes of a servo ------------------------------------------------------------------------------------------

SERVO_RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-dynamixel-servo.toml")
OF_POSITION = NortonNetwork(3.4, 600.0, 5e-3, 0.06, 0.05, 10.0, 0.1, command_unit="rad", servo=Servo(3.4, 0.05))
OF_VELOCITY = NortonNetwork(0.8, 300.0, 5e-3, 0.06, 0.05, 10.0, 0.1, command_unit="rad/s", servo=Servo(0.0, 0.8))
SERVO_LOAD = replace(LOAD, inertia_kgm2=3e-3, viscous_damping_nms_rad=0.02)


@pytest.mark.long
@pytest.mark.parametrize("network", [OF_POSITION, OF_VELOCITY], ids=["position", "velocity"])
def test_a_shaken_servo_moves_as_its_equations_say(network: NortonNetwork) -> None:
    """Against Radau, but for friction, which is left out."""
    servo, tick_s = network.servo, SERVO_RIG.tick_s
    assert servo is not None
    time_s = np.arange(0.0, 2.0, tick_s)
    fade = np.minimum(1.0, np.minimum(time_s, time_s[-1] - time_s) / 0.3)
    load_nm, command = 1.5 * fade * np.sin(25.0 * time_s), 0.2 * fade * np.sin(18.0 * time_s)
    inertia, damping = network.inertia_kgm2 + SERVO_LOAD.inertia_kgm2, network.viscous_damping_nms_rad + 0.02

    def rates(at_s: float, state: np.ndarray) -> list[float]:
        angle, speed, drive = state
        error = np.interp(at_s, time_s, command) - servo.of_angle * angle - servo.of_velocity * speed
        torque = network.torque_gain * drive + SERVO_LOAD.torque_gain * np.interp(at_s, time_s, load_nm)
        return [speed, (torque - damping * speed) / inertia, network.amplifier_bandwidth_rad_s * (error - drive)]

    expected = solve_ivp(rates, (0.0, 2.0), np.zeros(3), "Radau", time_s, rtol=1e-8, atol=1e-10, max_step=0.01).y
    motion = PlanBounds(SERVO_RIG, network, SERVO_LOAD, inf).pushed_motion(load_nm, command)
    size = np.max(np.abs(expected), axis=1)
    assert np.max(np.abs(motion.velocity_rad_s - expected[1])) < 0.01 * size[1]
    assert np.max(np.abs(motion.position_rad - expected[0])) < 0.01 * size[0]


@pytest.mark.parametrize("procedure", [ImposedProcedure(), ValidateProcedure()], ids=lambda procedure: procedure.name)
def test_a_servo_is_shaken_as_much_as_the_power_limit_allows(procedure: Procedure) -> None:
    rigs = [replace(SERVO_RIG, limits=replace(SERVO_RIG.limits, power_w=power_w)) for power_w in (1e3, 6.0)]
    greatest_w, sentences = [], []
    for rig in rigs:
        known = Knowledge(rig, calibration=SERVO_LOAD, actuator=fit_of(OF_POSITION))
        bounds = bounds_of(known)
        assert bounds is not None
        shaken = [segment for segment in played(procedure, known) if segment.name == "shaken"]
        assert len(shaken) == 2
        motions = [bounds.pushed_motion(segment.load_torque_nm, segment.command) for segment in shaken]
        torques_nm = [
            OF_POSITION.torque(segment.command, motion.position_rad, rig.tick_s)
            for segment, motion in zip(shaken, motions, strict=True)
        ]
        powers_w = [np.abs(nm * motion.velocity_rad_s) for nm, motion in zip(torques_nm, motions, strict=True)]
        greatest_w.append(max(float(np.max(each)) for each in powers_w))
        assert isinstance(procedure, Reducing)
        sentences.append([each for each in procedure.reductions(known) if "shaken" in each])
    assert greatest_w[0] > rigs[1].limits.power_w
    assert 0.9 * SHARE * rigs[1].limits.power_w < greatest_w[1] <= SHARE * rigs[1].limits.power_w
    assert len(sentences[1]) == 1


def test_stairs_of_a_shaft_that_is_slow_to_gain_speed_stay_within_the_velocity_limit() -> None:
    strong = replace(RIG, command=replace(RIG.command, limit=9.0))
    known, procedure = known_of(SLOW, strong), FreeProcedure()
    low, high = procedure._span_within(known, (-1.7, 1.71))
    assert -1.7 < low < -0.9
    assert 0.9 < high < 1.71
    for _, levels in procedure._stairs(low, high):
        command = np.repeat(levels, round(procedure.options.dwell_s / RIG.tick_s))
        speed_rad_s = np.max(np.abs(SLOW.free_motion(command, RIG.tick_s)[1]))
        assert 0.25 * RIG.limits.velocity_rad_s < speed_rad_s <= SHARE * RIG.limits.velocity_rad_s
    assert procedure._span_within(replace(known, actuator=None), (-1.7, 1.71)) == (-1.7, 1.71)


def freed(plan: Plan, network: NortonNetwork) -> tuple[Measured, list[str]]:
    """What a machine does under a plan of zero torque at its port, segment by segment, and their names."""
    velocity_rad_s, command, parts, names = 0.0, 0.0, list[Measured](), list[str]()
    segment = next(plan)
    with suppress(StopIteration):
        while True:
            _, speed_rad_s, _ = network.free_motion(
                segment.command,
                RIG.tick_s,
                velocity_rad_s=velocity_rad_s,
                motor_torque_nm=network.torque_gain * command,
            )
            beyond = np.flatnonzero(np.abs(speed_rad_s) >= segment.stop_at_velocity_rad_s)
            ticks = np.zeros(int(beyond[0]) + 1 if beyond.size else segment.ticks, TICK)
            ticks["velocity_rad_s"], ticks["command"] = speed_rad_s[: len(ticks)], segment.command[: len(ticks)]
            begun_ns = parts[-1].segments[0].end_ns if parts else 0
            ticks["tick_ns"] = begun_ns + np.arange(len(ticks)) * RIG.tick_ns
            info = SegmentInfo.of(segment, len(names), begun_ns, begun_ns + len(ticks) * RIG.tick_ns)
            parts.append(Measured(ticks=ticks, segments=(info,)))
            names.append(segment.name)
            velocity_rad_s, command = float(ticks["velocity_rad_s"][-1]), float(ticks["command"][-1])
            segment = plan.send(parts[-1])
    return join(parts), names


@pytest.mark.parametrize(("taken", "share"), [(None, 0.1), (0.9, 0.3)], ids=["friction unknown", "friction known"])
def test_stairs_that_nobody_foresaw_to_be_too_fast_are_climbed_again_slower(taken: float | None, share: float) -> None:
    """As where friction kept the calibration from moving the shaft by much: there is no fit to foresee them by."""
    strong = replace(RIG, command=replace(RIG.command, limit=9.0))
    tare = Tare(0.0, 1e-3, moving_command=taken)
    known, procedure = replace(known_of(SLOW, strong), actuator=None, tare=tare), FreeProcedure()
    measured, names = freed(procedure.plan(known), SLOW)
    assert TOO_FAST in names
    assert names[names.index(TOO_FAST) + 1] == "approach rising"
    assert names[-8:-2] == [
        f"{part} {way}" for way in ("rising", "falling") for part in ("approach", "staircase", "leave")
    ]
    assert np.max(np.abs(measured.ticks["velocity_rad_s"])) < 0.95 * RIG.limits.velocity_rad_s
    stairs = [segment for segment in measured.segments if segment.name == "staircase falling"][-1]
    climbed = measured.between(stairs.start_ns, stairs.end_ns).ticks
    assert np.max(np.abs(climbed["velocity_rad_s"])) > share * RIG.limits.velocity_rad_s
    found = procedure.conclude(known, measured).command_span
    assert found == (climbed["command"].min(), climbed["command"].max())


def test_a_free_command_that_the_load_cannot_follow_is_made_smaller() -> None:
    bounds = bounds_of(known_of(STRONG, replace(RIG, limits=replace(RIG.limits, load_torque_nm=0.1))))
    assert bounds is not None
    command = 0.3 * np.sin(2 * np.pi * 20.0 * np.arange(1000) * RIG.tick_s)
    assert not bounds.allow_free(command, SHARE)
    assert bounds.allow_free(LEAST * command, SHARE)


def test_gentler_gains_are_said_to_cost_something(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse counts behind a stiff sensor: see the tests of the design."""
    monkeypatch.setattr(design, "DISTRUSTS", ())
    known = replace(known_of(STRONG), calibration=COARSE)
    gentle = [sentence for sentence in ImposedProcedure().reductions(known) if "times gentler" in sentence]
    assert len(gentle) == 1
    assert not [sentence for sentence in ImposedProcedure().reductions(known_of(STRONG)) if "times gentler" in sentence]


def test_a_damping_below_zero_does_not_make_the_motion_foreseen_run_away() -> None:
    command = np.repeat(np.linspace(-0.1, 0.1, 5), 400)
    bounds = bounds_of(known_of(replace(STRONG, presliding_damping_nms_rad=-0.1)))
    assert bounds is not None
    assert bounds.allow_free(command, SHARE)


def test_without_a_fit_to_judge_by_there_are_no_bounds() -> None:
    known = known_of(STRONG)
    assert bounds_of(replace(known, actuator=fit_of(STRONG, Status.RATIO_ONLY))) is None
    assert bounds_of(replace(known, calibration=None)) is None
    bounds = bounds_of(replace(known, records=(Measured(),)))
    assert bounds is not None
    assert bounds.travel_rad == inf


def test_words_only_where_something_was_made_smaller() -> None:
    assert words_for("imposed:", 1.0) == ()
    (sentence,) = words_for("imposed:", 0.5)
    assert sentence.startswith("imposed: at 50% of its usual size")
    assert "2.0 times wider" in sentence
