"""The Kalman filter over parameters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.identification.live.tracking import BEYOND_DRIFT, Tracker

UNKNOWN = 1e6
STILL = 0.0
UPDATES = 8_000


def tracker(size, variance=UNKNOWN, drift_per_s=STILL, start=1.0):
    return Tracker(np.full(size, start), variance * np.eye(size), np.full(size, drift_per_s))


def told(tracker, rows, target, duration_s=0.5, feigned=None):
    """One block, whose noise is 1."""
    return tracker.update(rows.T @ rows, rows.T @ (target - rows @ tracker.values), duration_s, feigned)


def test_it_agrees_with_least_squares_where_nothing_drifts():
    rng = np.random.default_rng(6)
    truth, rows = np.array([1.2, 0.7]), rng.standard_normal((500, 2)) * 20
    target = rows @ truth + rng.standard_normal(500)
    found = tracker(2)
    for part in np.array_split(np.arange(500), 5):
        assert told(found, rows[part], target[part])
    # Surprise makes all of a block count for less: a share of the deviation, no more.
    exact = np.linalg.lstsq(rows, target, rcond=None)[0]
    assert found.values == pytest.approx(exact, abs=0.1 * np.sqrt(found.covariance[0, 0]))
    assert np.diag(found.covariance) == pytest.approx(np.diag(np.linalg.inv(rows.T @ rows)), rel=0.3)


@given(st.integers(0, 10_000))
@settings(max_examples=50, deadline=None)
def test_a_direction_that_is_not_excited_is_neither_moved_nor_better_or_worse_known(seed):
    rng = np.random.default_rng(seed)
    excited, hidden = np.split(np.linalg.qr(rng.standard_normal((5, 5)))[0], [3], axis=1)
    found = tracker(5, variance=1e-2, drift_per_s=1e-2)
    for _ in range(20):
        rows = rng.standard_normal((50, 3)) * 10 @ excited.T + 1e-3 * rng.standard_normal((50, 5))
        told(found, rows, rows @ np.ones(5) + 0.3 * excited.sum() + rng.standard_normal(50))
    assert hidden.T @ (found.values - 1.0) == pytest.approx(0.0, abs=0.02 * 0.1)
    assert hidden.T @ found.covariance @ hidden == pytest.approx(1e-2 * np.eye(2), abs=1e-2 * 0.02)


def test_what_noise_in_the_regressors_feigns_is_not_information():
    """The second column is noise: what it seems to say of its factor is taken off, and the rest not believed."""
    rng = np.random.default_rng(4)
    found, noise = tracker(2, variance=1e-4, drift_per_s=1e-3), np.diag([0.0, 500 * 0.25])
    for _ in range(200):
        rows = np.stack([rng.standard_normal(500) * 10.0, rng.standard_normal(500) * 0.5], axis=1)
        target = rows[:, 0] + rng.standard_normal(500)
        score = rows.T @ (target - rows @ found.values) + noise @ found.values
        found.update(rows.T @ rows - noise, score, 0.5, noise)
    assert found.values == pytest.approx([1.0, 1.0], abs=1e-3)
    assert found.covariance[1, 1] == pytest.approx(1e-4, rel=0.02)


def test_slow_drift_is_followed():
    rng = np.random.default_rng(5)
    found = tracker(2, drift_per_s=5e-3)
    for block in range(400):
        truth = np.array([1.0 + 1e-3 * block, 1.0])
        rows = rng.standard_normal((100, 2)) * 20
        told(found, rows, rows @ truth + rng.standard_normal(100))
    assert found.values == pytest.approx([1.4, 1.0], abs=0.01)


def test_innovations_greater_than_the_noise_widen_the_deviations():
    rng = np.random.default_rng(7)
    calm, rough = tracker(2, variance=1.0, drift_per_s=1e-3), tracker(2, variance=1.0, drift_per_s=1e-3)
    for _ in range(200):
        rows = rng.standard_normal((100, 2))
        noise = rng.standard_normal(100)
        told(calm, rows, rows @ np.ones(2) + noise)
        told(rough, rows, rows @ np.ones(2) + 3.0 * noise)
    assert np.sqrt(rough.covariance[0, 0] / calm.covariance[0, 0]) > 1.3
    assert rough.inflation == pytest.approx(9.0, rel=0.4)
    assert calm.inflation < 1.5


def test_garbage_is_not_believed_and_leaves_all_as_it_was():
    rng = np.random.default_rng(8)
    found = tracker(3, variance=1e-4)
    values, covariance = found.values.copy(), found.covariance.copy()
    rows = rng.standard_normal((100, 3))
    assert not told(found, rows, rows @ np.ones(3) + 10 * BEYOND_DRIFT * np.sign(rows[:, 0]))
    told(found, np.where(rows > 2, np.nan, rows), rows @ np.ones(3))
    assert np.array_equal(found.values, values)
    assert np.array_equal(found.covariance, covariance)


def test_the_covariance_stays_symmetric_and_positive_over_many_updates():
    """From next to nothing known to six digits, with directions that come and go."""
    rng = np.random.default_rng(9)
    found = tracker(4, variance=1e8, drift_per_s=1e-6)
    blocks = [rng.standard_normal((6, 4)) * 10.0 ** rng.uniform(-2, 5, 4) for _ in range(50)]
    for number in range(UPDATES):
        rows = blocks[number % len(blocks)] * (rng.random(4) < 0.7)
        told(found, rows, rows @ np.ones(4) + rng.standard_normal(6))
        if number % 1000 == 999:
            assert np.array_equal(found.covariance, found.covariance.T)
            assert np.all(np.linalg.eigvalsh(found.covariance) > 0.0)
    assert found.values == pytest.approx(np.ones(4), abs=1e-3)
