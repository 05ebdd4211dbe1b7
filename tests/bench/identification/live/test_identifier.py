"""Identification part by part."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.identification.live.bank import BANDWIDTH_NODES, lagrange
from bench.identification.live.identifier import LiveIdentifier
from bench.identification.live.streams import LiveStreams
from bench.models.parameters import Status
from bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.live.phases import PART_NS, drifting, exciting_for, exciting_then, feed
from tests.bench.identification.synthetic import NAMES, TICK_S, Truth

# While everything is still sought in all data, and after the handing over.
SEARCHED_S, TRACKED_S = 12.0, 26.0


@pytest.fixture(scope="module")
def history(experiment):
    return feed(LiveIdentifier("N*m", TICK_S), experiment)


def test_all_is_found_from_nothing(history):
    last = history[-1]
    assert last.network is not None
    for estimate in last.estimates:
        truth = getattr(Truth(), estimate.name)
        assert estimate.status is Status.VALID
        assert abs(estimate.value - truth) < 3 * estimate.std + 0.01 * truth, estimate


def test_a_network_comes_only_with_imposed_motion(experiment, history):
    """The free experiment sets no scale: not one network before motion is imposed."""
    imposed_ns = next(s.start_ns for s in experiment.segments if s.procedure == "blocked")
    assert all(state.network is None for state in history if state.stamp_ns < imposed_ns)
    assert history[0].estimates == ()


def test_validation_segments_are_not_learned_from(experiment):
    unseen = tuple(replace(segment, use=Use.VALIDATE) for segment in experiment.segments)
    assert feed(LiveIdentifier("N*m", TICK_S), replace(experiment, segments=unseen))[-1].samples == 0


def test_a_constant_speed_is_not_taken_for_the_encoders_step():
    streams = LiveStreams(TICK_S)
    measured = exciting_then("one speed", SEARCHED_S, 4.0)
    start, end = int(measured.ticks["tick_ns"][0]), int(measured.ticks["tick_ns"][-1])
    backwards = [measured.between(at, at + PART_NS) for at in range(end - 3 * 10**9, end, PART_NS)]
    for part in backwards:
        streams.add(part)
    for at_ns in range(start, end, PART_NS):
        streams.add(measured.between(at_ns, at_ns + PART_NS))
    assert streams.resolution == pytest.approx(2 * np.pi / 131072, rel=1e-3)


def test_parts_without_torque_are_survived(without_torque):
    assert feed(LiveIdentifier("N*m", TICK_S), without_torque)[-1].estimates == ()


@given(st.floats(40.0, 5000.0))
@settings(max_examples=30)
def test_members_between_the_nodes_are_interpolated(bandwidth):
    weights = lagrange(np.log(BANDWIDTH_NODES), np.log(bandwidth), 4)
    time_s = np.linspace(0, 0.05, 200)
    between = weights @ np.exp(-np.outer(BANDWIDTH_NODES, time_s))
    assert np.max(np.abs(between - np.exp(-bandwidth * time_s))) < 0.02


def test_the_names_are_the_tables(history):
    assert tuple(estimate.name for estimate in history[-1].estimates) == NAMES
    assert synthetic.TICK_S == TICK_S


def at(history, measured, time_s):
    """By name, what was known at that time."""
    stamp_ns = measured.ticks["tick_ns"][0] + time_s * 1e9
    state = next(state for state in reversed(history) if state.stamp_ns <= stamp_ns)
    return {estimate.name: estimate for estimate in state.estimates}


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
    measured = exciting_then(kind, excited_s, 30.0)
    history = feed(LiveIdentifier("N*m", TICK_S), measured)
    # A second for the data still on their way, and for the change of speed.
    before, after = at(history, measured, excited_s + 1.5), at(history, measured, np.inf)
    for name in untold:
        assert abs(after[name].value - before[name].value) < 0.1 * before[name].std, name
        assert after[name].std > 0.99 * before[name].std, name
    for name in NAMES:
        assert after[name].status is Status.VALID
        assert abs(after[name].value - getattr(Truth(), name)) < 3 * after[name].std, name


def test_a_constant_speed_does_not_pull_the_inertia_to_zero_while_searching():
    measured = exciting_then("one speed", SEARCHED_S, 30.0)
    history = feed(LiveIdentifier("N*m", TICK_S), measured)
    before, after = at(history, measured, SEARCHED_S + 1.5)["inertia"], at(history, measured, np.inf)["inertia"]
    assert abs(after.value - before.value) < before.std
    assert abs(after.value - Truth().inertia) < 3 * after.std


def test_slow_drift_is_followed_and_the_rest_stays():
    measured = drifting(exciting_for(100.0), damping_share=0.3, coulomb_share=0.2)
    history = feed(LiveIdentifier("N*m", TICK_S), measured)
    changed = {"viscous_damping": 1.3, "coulomb_torque": 1.2, "presliding_stiffness": 1.2}
    for estimate in history[-1].estimates:
        truth = getattr(Truth(), estimate.name) * changed.get(estimate.name, 1.0)
        assert estimate.status is Status.VALID
        assert estimate.value == pytest.approx(truth, rel=0.06 if estimate.name == "presliding_damping" else 0.025)
    half = at(history, measured, 60.0)
    assert half["viscous_damping"].value == pytest.approx(1.15 * Truth().viscous_damping, rel=0.025)
    assert half["coulomb_torque"].value == pytest.approx(1.1 * Truth().coulomb_torque, rel=0.025)


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


@pytest.mark.parametrize("how", ["not a number", "spikes", "garbage", "stamps", "later", "nothing"])
def test_bad_parts_never_poison(how):
    """From the very first on, and again when everything is known."""
    measured, rng = exciting_for(20.0), np.random.default_rng(3)
    identifier = LiveIdentifier("N*m", TICK_S)
    start, end = int(measured.ticks["tick_ns"][0]), int(measured.ticks["tick_ns"][-1])
    for number, at_ns in enumerate(range(start, end, PART_NS)):
        part = measured.between(at_ns, at_ns + PART_NS)
        last = identifier.update(spoilt(part, how, rng) if number % 47 == 3 else part)
        assert all(np.isfinite([estimate.value, estimate.std]).all() for estimate in last.estimates)
    for estimate in last.estimates:
        assert estimate.status is Status.VALID, estimate
        truth = getattr(Truth(), estimate.name)
        assert abs(estimate.value - truth) < 3 * estimate.std + 0.01 * truth, estimate


def test_a_clock_set_back_is_survived(experiment):
    whole = exciting_for(20.0)
    identifier = LiveIdentifier("N*m", TICK_S)
    feed(identifier, whole)
    assert feed(identifier, whole)[-1].samples > 1.8 * 18_000


def test_another_machine_is_found_anew():
    """What fits nothing known any more, for seconds, is not averaged with what was."""
    first, second = exciting_for(40.0, 1), drifting(exciting_for(40.0, 2), 2.0, 2.0, from_s=-1e9)
    identifier = LiveIdentifier("N*m", TICK_S)
    feed(identifier, first)
    last = feed(identifier, second)[-1]
    for name, factor in (("viscous_damping", 3.0), ("coulomb_torque", 3.0), ("inertia", 1.0), ("torque_gain", 1.0)):
        value = next(estimate.value for estimate in last.estimates if estimate.name == name)
        assert value == pytest.approx(factor * getattr(Truth(), name), rel=0.03)
