"""Identification part by part."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.judged_fit import changes, fit
from norton_bench.identification.live import LATEST_S, LiveIdentifier
from norton_bench.models.parameters import Status
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.live.phases import PART_NS, drifting, exciting_for, exciting_then, feed
from tests.bench.identification.synthetic import NAMES, TICK_S, Departs, Truth

# Before and after the deviations were worked out once more.
SEARCHED_S, TRACKED_S = 12.0, 26.0
# Each part of this length causes a fit of all so far.
LONG_S = 10.0
# One that ends soon after either: with what tells something, and a few seconds more.
LONGER_S, DULL_S = 13.3, 14.5


@pytest.fixture(scope="module")
def varied():
    return synthetic.varied(1)


@pytest.fixture(scope="module")
def history(varied):
    """In short parts as long as nothing may be concluded, then in long ones."""
    identifier, imposed_ns = LiveIdentifier("N*m", TICK_S), first_imposed_ns(varied)
    before = varied.between(int(varied.ticks["tick_ns"][0]), imposed_ns)
    after = varied.between(imposed_ns, int(varied.ticks["tick_ns"][-1]) + 1)
    return feed(identifier, before) + feed(identifier, after, LONG_S)


def first_imposed_ns(measured):
    """When motion is first imposed."""
    return next(segment.start_ns for segment in measured.segments if segment.procedure == "imposed")


@pytest.fixture(scope="module")
def excited():
    return exciting_for(SEARCHED_S)


def test_all_is_found_from_nothing(history):
    last = history[-1]
    assert last.network is not None
    for estimate in last.estimates:
        truth = getattr(Truth(), estimate.name)
        assert estimate.status is Status.VALID
        assert abs(estimate.value - truth) < 3 * estimate.std + 0.01 * truth, estimate


def test_a_network_comes_only_with_imposed_motion(varied, history):
    """The free experiment sets no scale: not one network before motion is imposed."""
    before = [state for state in history if state.stamp_ns < first_imposed_ns(varied)]
    assert before[-1].estimates
    assert all(state.network is None for state in before)
    assert history[0].estimates == ()


def test_validation_segments_are_not_learned_from(varied):
    unseen = tuple(replace(segment, use=Use.VALIDATE) for segment in varied.segments)
    assert feed(LiveIdentifier("N*m", TICK_S), replace(varied, segments=unseen))[-1].samples == 0


@pytest.mark.long
def test_without_torque_there_are_ratios_alone(varied):
    seen = replace(varied, torque=varied.torque[:0])
    assert {"free", "imposed"} <= {segment.procedure for segment in seen.segments}
    free_s = 1e-9 * (first_imposed_ns(seen) - int(seen.ticks["tick_ns"][0]))
    history = feed(LiveIdentifier("N*m", TICK_S), seen, free_s)
    assert all(state.network is None for state in history)
    free = at(history, seen, free_s)
    assert free["inertia"].status is Status.RATIO_ONLY
    assert free["amplifier_bandwidth"].status is Status.VALID


def test_the_names_are_the_tables(history):
    assert tuple(estimate.name for estimate in history[-1].estimates) == NAMES
    assert synthetic.TICK_S == TICK_S


def at(history, measured, time_s):
    """By name, what was known at that time."""
    stamp_ns = measured.ticks["tick_ns"][0] + time_s * 1e9
    state = next(state for state in reversed(history) if state.stamp_ns <= stamp_ns)
    return {estimate.name: estimate for estimate in state.estimates}


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "excited_s", "untold"),
    [
        ("held", SEARCHED_S, NAMES),
        ("held", TRACKED_S, NAMES),
        ("left alone", TRACKED_S, NAMES),
        # An encoder's counts look like acceleration: a long constant speed must not pull the inertia to zero.
        ("one speed", TRACKED_S, ("amplifier_bandwidth", "inertia", "presliding_damping")),
    ],
)
def test_data_that_say_nothing_of_a_parameter_neither_move_nor_sharpen_it(kind, excited_s, untold):
    measured = exciting_then(kind, excited_s, DULL_S)
    history = feed(LiveIdentifier("N*m", TICK_S), measured, LONGER_S)
    # The first fit that has seen all of what tells something, and the last one.
    before, after = at(history, measured, excited_s + LATEST_S), at(history, measured, np.inf)
    for name in untold:
        # The bootstrap may have been repeated meanwhile: six draws know a deviation to within 30 %.
        assert abs(after[name].value - before[name].value) < 1.0 * before[name].std, name
        assert after[name].std > 0.4 * before[name].std, name
    for name in NAMES:
        assert after[name].status is Status.VALID
        assert abs(after[name].value - getattr(Truth(), name)) < 3 * after[name].std, name


@pytest.mark.long
def test_a_constant_speed_does_not_pull_the_inertia_to_zero_while_searching():
    measured = exciting_then("one speed", SEARCHED_S, DULL_S)
    history = feed(LiveIdentifier("N*m", TICK_S), measured, LONGER_S)
    before, after = at(history, measured, SEARCHED_S + LATEST_S)["inertia"], at(history, measured, np.inf)["inertia"]
    assert abs(after.value - before.value) < 2.0 * before.std  # six draws know a deviation to within 30 %
    assert abs(after.value - Truth().inertia) < 3 * after.std


@pytest.mark.long
def test_slow_drift_is_followed_and_the_rest_stays():
    measured = drifting(exciting_for(100.0), damping_share=0.3, coulomb_share=0.2)
    history = feed(LiveIdentifier("N*m", TICK_S), measured, 60.0)
    changed = {"viscous_damping": 1.3, "coulomb_torque": 1.2, "presliding_stiffness": 1.2}
    for estimate in history[-1].estimates:
        truth = getattr(Truth(), estimate.name) * changed.get(estimate.name, 1.0)
        assert estimate.status is Status.VALID
        assert estimate.value == pytest.approx(truth, rel=0.06 if estimate.name == "presliding_damping" else 0.025)
    half = at(history, measured, 60.0)
    assert half["viscous_damping"].value == pytest.approx(1.15 * Truth().viscous_damping, rel=0.025)
    assert half["coulomb_torque"].value == pytest.approx(1.1 * Truth().coulomb_torque, rel=0.025)
    overall = fit(measured, command_unit="N*m", tick_s=TICK_S, draws=0)
    moved = [change.final.name for change in changes(history[-1].estimates, overall) if change.significant]
    assert {"viscous_damping", "coulomb_torque"} <= set(moved) <= set(changed)


def spoilt(part, how, rng):
    motion, torque, ticks = part.motion.copy(), part.torque.copy(), part.ticks.copy()
    if how == "not a number":
        motion["position_rad"][10:30] = np.nan
        torque["torque_nm"][40:60] = np.inf
        ticks["command"][70:75] = np.nan
    elif how == "spikes":
        motion["position_rad"][rng.integers(1, 99, 3)] += 1e3
        torque["torque_nm"][rng.integers(1, 99, 3)] = -50.0
    elif how == "garbage":
        torque["torque_nm"] = rng.normal(0.0, 5.0, len(torque))
    elif how == "stamps":
        motion["arrival_ns"][20] += 10**15
        torque["arrival_ns"][30] -= 10**15
    elif how == "later":
        ticks["tick_ns"][50] += 10**13
    elif how == "nothing":
        motion, torque, ticks = motion[:0], torque[:0], ticks[:0]
    return replace(part, motion=motion, torque=torque, ticks=ticks)


@pytest.mark.long
@pytest.mark.parametrize("how", ["not a number", "spikes", "garbage", "stamps", "later", "nothing"])
def test_bad_parts_never_poison(excited, how):
    """From the very first on, and again when everything is known."""
    # Of garbage a little more, until the fit has settled.
    measured, rng = exciting_for(20.0) if how == "garbage" else excited, np.random.default_rng(3)
    identifier = LiveIdentifier("N*m", TICK_S)
    start, end = int(measured.ticks["tick_ns"][0]), int(measured.ticks["tick_ns"][-1])
    for number, at_ns in enumerate(range(start, end, PART_NS)):
        part = measured.between(at_ns, at_ns + PART_NS)
        last = identifier.update(spoilt(part, how, rng) if number % 47 == 3 else part)
        assert all(np.isfinite([estimate.value, estimate.std]).all() for estimate in last.estimates)
    # What is left of torques of any size, no model explains.
    status = Status.INADEQUATE if how == "garbage" else Status.VALID
    for estimate in last.estimates:
        assert estimate.status is status, estimate
        truth = getattr(Truth(), estimate.name)
        assert abs(estimate.value - truth) < 3 * estimate.std + 0.01 * truth, estimate


@pytest.mark.long
def test_an_actuator_that_is_not_the_papers_motor_gets_its_term_while_the_session_runs():
    """Friction that is 30 % greater at rest: half a minute of unlike motions is enough to tell it from all else."""
    measured = synthetic.varied(4, synthetic.Bench(departs=Departs(stribeck_drop=0.3)))
    last = feed(LiveIdentifier("N*m", TICK_S), measured, 23.0)[-1]
    coulomb = Truth().coulomb_torque
    true = {"coulomb_torque": 0.7 * coulomb, "stribeck_torque": 0.3 * coulomb, "stribeck_velocity": 5.0}
    assert [term.name for term in last.network.relative_terms] == ["stribeck"]
    for estimate in last.estimates:
        value = true.get(estimate.name, getattr(Truth(), estimate.name, None))
        assert estimate.status is Status.VALID
        assert abs(estimate.value - value) < 3 * estimate.std + 0.01 * value, estimate


@pytest.mark.long
def test_one_motion_does_not_tell_what_is_missing_but_that_something_is():
    measured = exciting_for(SEARCHED_S, departs=Departs(stribeck_drop=0.3))
    last = feed(LiveIdentifier("N*m", TICK_S), measured, SEARCHED_S)[-1]
    assert last.network is None
    assert {estimate.status for estimate in last.estimates} == {Status.INADEQUATE}


@pytest.mark.long
def test_a_clock_set_back_is_survived(excited):
    identifier = LiveIdentifier("N*m", TICK_S)
    first = feed(identifier, excited, LONG_S)[-1]
    again = feed(identifier, excited, LONG_S)[-1]
    assert again.estimates == first.estimates


@pytest.mark.long
def test_another_machine_is_found_anew(excited):
    """What fits nothing known any more, for seconds, is not averaged with what was."""
    second = drifting(exciting_for(SEARCHED_S, 2), 2.0, 2.0, from_s=-1e9)
    identifier = LiveIdentifier("N*m", TICK_S)
    feed(identifier, excited, LONG_S)
    last = feed(identifier, second, LONG_S)[-1]
    for name, factor in (("viscous_damping", 3.0), ("coulomb_torque", 3.0), ("inertia", 1.0), ("torque_gain", 1.0)):
        value = next(estimate.value for estimate in last.estimates if estimate.name == name)
        assert value == pytest.approx(factor * getattr(Truth(), name), rel=0.03)
