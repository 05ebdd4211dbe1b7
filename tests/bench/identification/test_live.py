"""Identification part by part."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.identification.live import LiveIdentifier
from bench.identification.live_bank import BANDWIDTH_NODES, lagrange
from bench.identification.tracking import Tracker
from bench.models.parameters import Status
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import NAMES, TICK_S, Truth

PART_NS = 100_000_000


def feed(identifier, measured):
    start, end = int(measured.ticks["tick_ns"][0]), int(measured.ticks["tick_ns"][-1])
    return [identifier.update(measured.between(at, at + PART_NS)) for at in range(start, end, PART_NS)]


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
    from bench.segments import Use

    unseen = tuple(replace(segment, use=Use.VALIDATE) for segment in experiment.segments)
    assert feed(LiveIdentifier("N*m", TICK_S), replace(experiment, segments=unseen))[-1].samples == 0


def test_parts_without_torque_are_survived(without_torque):
    assert feed(LiveIdentifier("N*m", TICK_S), without_torque)[-1].estimates == ()


@given(st.floats(40.0, 5000.0))
@settings(max_examples=30)
def test_members_between_the_nodes_are_interpolated(bandwidth):
    weights = lagrange(np.log(BANDWIDTH_NODES), np.log(bandwidth), 4)
    time_s = np.linspace(0, 0.05, 200)
    between = weights @ np.exp(-np.outer(BANDWIDTH_NODES, time_s))
    assert np.max(np.abs(between - np.exp(-bandwidth * time_s))) < 0.02


def information_of(rows):
    return rows.T @ rows


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_what_is_not_excited_is_neither_moved_nor_better_known(seed):
    rng = np.random.default_rng(seed)
    truth = rng.uniform(0.5, 2.0, 3)
    tracker = Tracker(np.ones(3))
    everything = rng.standard_normal((200, 3)) * 10
    tracker.update(information_of(everything), everything.T @ (everything @ truth + rng.standard_normal(200)), 0.5)
    value, variance = tracker.values[2], tracker.covariance[2, 2]
    for _ in range(20):
        rows = rng.standard_normal((50, 3)) * [10, 10, 0]
        tracker.update(information_of(rows), rows.T @ (rows @ truth + rng.standard_normal(50)), 0.5)
    # The third was correlated with the others by chance: what is learned of them tells a little of it, no more.
    assert abs(tracker.values[2] - value) < 3 * np.sqrt(variance)
    assert tracker.covariance[2, 2] > 0.5 * variance
    assert np.all(np.linalg.eigvalsh(tracker.covariance) > 0)


def test_slow_drift_is_followed():
    rng = np.random.default_rng(5)
    tracker = Tracker(np.ones(2))
    for block in range(400):
        truth = np.array([1.0 + 2e-5 * block, 1.0])
        rows = rng.standard_normal((100, 2)) * 200
        tracker.update(information_of(rows), rows.T @ (rows @ truth + rng.standard_normal(100)), 0.5)
    assert tracker.values[0] == pytest.approx(1.0 + 2e-5 * 399, abs=1e-3)
    assert tracker.values[1] == pytest.approx(1.0, abs=1e-3)


def test_tracking_agrees_with_least_squares_where_nothing_drifts():
    rng = np.random.default_rng(6)
    truth, rows = np.array([1.2, 0.7]), rng.standard_normal((500, 2)) * 20
    target = rows @ truth + rng.standard_normal(500)
    tracker = Tracker(np.ones(2))
    for part in np.array_split(np.arange(500), 5):
        tracker.update(information_of(rows[part]), rows[part].T @ target[part], 0.0)
    assert tracker.values == pytest.approx(np.linalg.lstsq(rows, target, rcond=None)[0], rel=1e-6)


def test_the_names_are_the_tables(history):
    assert tuple(estimate.name for estimate in history[-1].estimates) == NAMES
    assert synthetic.TICK_S == TICK_S
