"""Segments that go from where the setpoints are to where they are wanted: no step, no gap, never past a bound."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.jog.hands import Bounds, LoadDoes, Setpoints, bounds_of
from norton_bench.jog.script import RAMP_S, SEGMENT_S, Course, approach
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.records import TICK, Measured
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Admittance, LoadMode, Segment

RIGS = Path(__file__).parents[3] / "rigs"
RIG = load_rig(RIGS / "sim-odrive.toml")
BOUNDS = bounds_of(RIG)


def measured(segment: Segment, velocity_rad_s: float = 0.0, ticks: int | None = None) -> Measured:
    rows = np.zeros(segment.ticks if ticks is None else ticks, TICK)
    rows["velocity_rad_s"] = rows["load_velocity_rad_s"] = velocity_rad_s
    return Measured(ticks=rows)


def course(rig: Rig = RIG) -> Course:
    return Course(bounds_of(rig), Knowledge(rig))


def test_bounds_are_the_rigs() -> None:
    assert Bounds("N*m", (-0.5, 0.5), 1.0, 0.9 * 40.0, 40.0) == BOUNDS
    assert bounds_of(load_rig(RIGS / "sim-free-shaft.toml")).load_torque_nm == 0.0
    low, _ = bounds_of(replace(RIG, command=replace(RIG.command, lowest=0.0))).command
    assert low == 0.0


@pytest.mark.parametrize("speed_rad_s", [0.0, -1.0, 73.0, float("nan"), float("inf")])
def test_a_speed_at_which_the_guard_would_stop_is_refused(speed_rad_s: float) -> None:
    with pytest.raises(UsageError, match="90% of \\[limits\\] velocity"):
        bounds_of(RIG, speed_rad_s)


@pytest.mark.parametrize(
    ("wanted", "within", "said"),
    [
        (Setpoints(0.4), Setpoints(0.4), ""),
        (Setpoints(0.6), Setpoints(0.5), "actuator stays at +0.5 N*m"),
        (Setpoints(-0.6), Setpoints(-0.5), "actuator stays at -0.5 N*m"),
        (Setpoints(0, LoadDoes.TORQUE, 1.2), Setpoints(0, LoadDoes.TORQUE, 1.0), "load stays at +1 N*m"),
        (Setpoints(0, LoadDoes.VELOCITY, -38), Setpoints(0, LoadDoes.VELOCITY, -36), "load stays at -36 rad/s"),
    ],
)
def test_what_is_beyond_a_bound_is_clamped_and_told(wanted: Setpoints, within: Setpoints, said: str) -> None:
    assert BOUNDS.clamped(wanted)[0] == within
    assert said in BOUNDS.clamped(wanted)[1]
    assert bool(said) == bool(BOUNDS.clamped(wanted)[1])


@pytest.mark.parametrize(("start", "goal"), [(0.0, 0.3), (0.3, -0.2), (-0.1, -0.1), (0.2, 0.0)])
def test_an_approach_has_no_step_and_ends_at_its_goal(start: float, goal: float) -> None:
    way = approach(start, goal, 0.01, 100)
    assert np.max(np.abs(np.diff(way, prepend=start))) <= 0.01 * (1 + 1e-9)
    assert way[-1] == goal
    assert approach(0.0, 1.0, 0.01, 10)[-1] == pytest.approx(0.1)


BODY = Setpoints(0.3, LoadDoes.BODY, law=Admittance(5e-4, 2e-2, 0.5))


def acted() -> Course:
    """With a body that acts, and a command."""
    jog = course()
    for _ in range(6):
        segment = jog.towards(BODY)
        assert (segment.mode, segment.admittance) == (LoadMode.ADMITTANCE, BODY.law)
        jog.went(segment, measured(segment))
    assert jog.at.command == BODY.command
    return jog


def test_a_body_acts_until_the_actuator_does_not_push_any_more() -> None:
    """Without it the actuator alone would fling the shaft."""
    jog, modes, commands = acted(), [], []
    while not jog.at.at_zero:
        segment = jog.towards(BODY.zeroed())
        jog.went(segment, measured(segment))
        modes.append(segment.mode)
        commands.append(np.max(np.abs(segment.command)))
    assert modes == [LoadMode.ADMITTANCE] * (len(modes) - 1) + [LoadMode.UNDRIVEN]
    assert commands[-1] == 0.0
    assert len(modes) * SEGMENT_S <= RAMP_S + SEGMENT_S


def test_a_body_is_let_go_of_at_once_where_the_shaft_is_too_fast() -> None:
    jog = acted()
    segment = jog.towards(BODY)
    jog.went(segment, measured(segment, velocity_rad_s=1.01 * BOUNDS.speed_rad_s))
    segment = jog.towards(BODY)
    assert segment.mode is LoadMode.UNDRIVEN
    assert not segment.command.any()


def test_an_operator_may_let_go_of_a_body_alone() -> None:
    jog = acted()
    segment = jog.towards(replace(BODY, load=LoadDoes.COAST))
    assert segment.mode is LoadMode.UNDRIVEN
    assert segment.command == pytest.approx(BODY.command)


def test_segments_go_on_from_each_other() -> None:
    jog, wanted = course(), Setpoints(0.5, LoadDoes.TORQUE, -1.0)
    commands, torques = [], []
    for _ in range(8):
        segment = jog.towards(wanted)
        jog.went(segment, measured(segment))
        commands.append(segment.command)
        torques.append(segment.load_torque_nm)
    command, torque_nm = np.concatenate(commands), np.concatenate(torques)
    tick_s = RIG.tick_s
    assert np.max(np.abs(np.diff(command, prepend=0.0))) <= 0.5 / RAMP_S * tick_s * (1 + 1e-9)
    assert np.max(np.abs(np.diff(torque_nm, prepend=0.0))) <= 1.0 / RAMP_S * tick_s * (1 + 1e-9)
    assert (command[-1], torque_nm[-1]) == (0.5, -1.0)
    assert jog.elapsed_s == pytest.approx(8 * SEGMENT_S)


def test_the_rigs_own_command_rate_counts_where_it_is_slower() -> None:
    slow = course(replace(RIG, limits=replace(RIG.limits, command_rate_per_s=0.1)))
    command = slow.towards(Setpoints(0.5)).command
    assert np.max(np.diff(command)) <= 0.1 * RIG.tick_s * (1 + 1e-9)


def test_an_imposed_motion_takes_the_shaft_over_as_it_turns() -> None:
    jog = course()
    coasting = jog.towards(Setpoints())
    jog.went(coasting, measured(coasting, velocity_rad_s=10.0))
    segment = jog.towards(Setpoints(0.0, LoadDoes.VELOCITY))
    rate = BOUNDS.velocity_rad_s / RAMP_S
    assert segment.mode is LoadMode.ADMITTANCE
    assert segment.velocity_rad_s[0] == pytest.approx(10.0 - rate * RIG.tick_s)
    assert np.allclose(segment.acceleration_rad_s2, -rate)
    assert np.allclose(np.diff(segment.position_rad), segment.velocity_rad_s[1:] * RIG.tick_s)
    jog.went(segment, measured(segment, 10.0 - rate * SEGMENT_S))
    assert jog.towards(Setpoints(0.0, LoadDoes.COAST)).mode is LoadMode.UNDRIVEN


def test_a_shaft_that_is_too_fast_is_let_go_of_at_once_and_until_it_is_slow() -> None:
    jog, wanted = course(), Setpoints(0.5, LoadDoes.TORQUE, 0.5)
    segment = jog.towards(wanted)
    assert segment.stop_at_velocity_rad_s == 40.0
    jog.went(segment, measured(segment, 41.0, ticks=50))
    assert jog.too_fast
    assert jog.at == Setpoints(0.0, LoadDoes.TORQUE, 0.0)
    after = jog.towards(wanted)
    assert not after.command.any()
    assert not after.load_torque_nm.any()
    assert np.isinf(after.stop_at_velocity_rad_s)  # it would end with its first tick
    jog.went(after, measured(after, 39.0))
    assert jog.towards(wanted).command[-1] > 0.0


def test_one_that_is_driven_is_braked_by_the_motion_imposed() -> None:
    jog = course()
    jog.at = Setpoints(0.1, LoadDoes.VELOCITY, 30.0)
    segment = jog.towards(Setpoints(0.1, LoadDoes.VELOCITY, 30.0))
    jog.went(segment, measured(segment, 41.0, ticks=50))
    after = jog.towards(Setpoints(0.0, LoadDoes.VELOCITY, 0.0))
    assert not after.command.any()
    assert 29.9 < after.velocity_rad_s[0] < 30.0
