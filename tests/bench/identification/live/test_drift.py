"""What moves while the record is taken, and what does not."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.live import MAY_MOVE, RATES, _Record, drift_of
from norton_bench.identification.sanity_checks import BLOCK_ROWS, Blocks
from norton_bench.identification.separable import solve
from norton_bench.identification.shape import COULOMB, GAIN, INERTIA, VISCOUS
from norton_bench.identification.signals import signals
from norton_bench.segments import Use
from tests.bench.identification.live.phases import drifting, exciting_for
from tests.bench.identification.synthetic import TICK_S, Truth


@pytest.fixture(scope="module")
def still():
    return solve(signals(exciting_for(40.0, 3), TICK_S, Use.IDENTIFY))


@pytest.fixture(scope="module")
def moving():
    measured = drifting(exciting_for(60.0, 4), damping_share=0.2, from_s=0.0)
    return solve(signals(measured, TICK_S, Use.IDENTIFY))


def test_a_machine_that_stays_the_same_does_not_move(still):
    assert drift_of(still) is None


def test_a_record_of_less_than_a_block_tells_of_no_change(still):
    rows = BLOCK_ROWS - 1
    assert drift_of(replace(still, jacobian=still.jacobian[:rows], innovation=still.innovation[:rows])) is None


def test_only_what_moved_is_followed_and_the_rest_stays(moving):
    drift = drift_of(moving)
    assert drift is not None
    assert VISCOUS in drift.moved
    assert GAIN not in drift.moved
    std = np.sqrt(np.diag(drift.covariance))
    now = moving.linear[VISCOUS] + drift.change[VISCOUS]
    assert now == pytest.approx(1.2 * Truth().viscous_damping, rel=0.02)
    assert abs(now - 1.2 * Truth().viscous_damping) < 4.0 * std[VISCOUS]
    # The fit of all has the mean of it, far from the end.
    assert moving.linear[VISCOUS] < 1.15 * Truth().viscous_damping
    for column, truth in ((INERTIA, Truth().inertia), (COULOMB, Truth().coulomb_torque)):
        assert abs(moving.linear[column] + drift.change[column] - truth) < 4.0 * std[column] + 0.005 * truth


def test_a_filter_of_constants_is_least_squares(still):
    """Without a walk the last state is that of the normal equations, its covariance their inverse."""
    record = _Record.of(Blocks.of(still))
    end = record.filtered(np.zeros(record.unit.size))
    information = sum(root.T @ root for root in record.roots)
    score = sum(root.T @ z for root, z in zip(record.roots, record.z, strict=True))
    assert end.values == pytest.approx(np.linalg.solve(information, score), abs=1e-3)
    assert np.sqrt(np.diag(end.covariance)) == pytest.approx(np.sqrt(np.diag(np.linalg.inv(information))), rel=1e-2)


def test_constants_are_likelier_than_walks_where_nothing_moves(still):
    record = _Record.of(Blocks.of(still))
    constant = record.filtered(np.zeros(record.unit.size)).likelihood
    for column in MAY_MOVE:
        walks = np.zeros(record.unit.size)
        walks[column] = RATES[1] * abs(still.linear[column]) / record.unit[column]
        assert record.filtered(walks).likelihood < constant
