"""Regressions on the Gram matrix of the live bank's rows."""

import numpy as np
import pytest

from bench.identification.live.bank import WIDTH, LiveBank
from bench.identification.live.search import Candidate, covariance, evaluate, scan
from bench.identification.live.streams import LiveStreams
from bench.identification.regression import Shape
from tests.bench.identification.live import phases
from tests.bench.identification.live.phases import PART_NS
from tests.bench.identification.synthetic import TICK_S, Truth

SHAPE = Shape(430.0, 350.0, 3e-4, -2e-4)


@pytest.fixture(scope="module")
def rows():
    measured = phases.exciting_for(20.0)
    streams, bank = LiveStreams(TICK_S), LiveBank(TICK_S)
    start, end = int(measured.ticks["tick_ns"][0]), int(measured.ticks["tick_ns"][-1])
    pieces = (streams.add(measured.between(at, at + PART_NS)) for at in range(start, end, PART_NS))
    return np.concatenate([bank.rows(piece)[1] for piece in pieces if piece is not None])


def test_the_best_linear_parameters_are_those_of_least_squares_on_the_rows(rows):
    found = evaluate(rows.T @ rows, SHAPE, TICK_S)
    target = rows @ (found.residual + found.columns @ found.linear)
    expected = np.linalg.lstsq(rows @ found.columns, target, rcond=None)[0]
    assert found.linear == pytest.approx(expected, rel=1e-6)
    assert found.cost(rows.T @ rows) == pytest.approx(np.sum((rows @ found.residual) ** 2), rel=1e-6)


def test_the_gradient_is_that_of_the_prediction(rows):
    linear = evaluate(rows.T @ rows, SHAPE, TICK_S).linear
    here = Candidate.of(SHAPE, linear, TICK_S)
    for k, step in enumerate((1e-3, 1e-3, 1e-6, 1e-6)):
        side = np.eye(4)[k] * step
        up, down = (Candidate.of(Shape.of(SHAPE.as_array() + each), linear, TICK_S) for each in (side, -side))
        slope = rows @ (down.residual - up.residual) / (2 * step)
        assert rows @ here.gradient()[:, k] == pytest.approx(slope, abs=0.05 * np.abs(slope).max())


def test_a_scan_from_nothing_ends_at_the_truth(rows):
    found = scan(rows.T @ rows, TICK_S)
    truth = Truth()
    assert found.shape.bandwidth_rad_s == pytest.approx(truth.amplifier_bandwidth, rel=0.05)
    assert found.shape.s_per_rad == pytest.approx(truth.presliding_stiffness / truth.coulomb_torque, rel=0.05)
    assert found.linear[:4] == pytest.approx(truth.array()[[0, 2, 3, 4]], rel=0.02)


def test_the_deviations_are_those_that_blocks_of_data_show(rows):
    """Against the scatter of fits to ten parts of the data, each alone."""
    whole = scan(rows.T @ rows, TICK_S)
    parts = np.array_split(rows, 10)
    alone = np.array([evaluate(part.T @ part, whole.shape, TICK_S).linear[0] for part in parts])
    blocks = [block.T @ block for block in np.array_split(rows, 40)]
    given = np.sqrt(covariance(whole, blocks, len(rows), 3.0)[4, 4])
    assert 0.4 < given / (np.std(alone) / np.sqrt(len(parts))) < 4.0


def test_the_counts_noise_in_a_row_is_what_a_counting_encoder_gives():
    """A speed that hardly changes, counted: whatever accelerates is noise."""
    bank, rng = LiveBank(TICK_S), np.random.default_rng(1)
    step = 2 * np.pi / 131072
    measured = phases.exciting_then("one speed", 2.0, 10.0)
    start, end = int(measured.ticks["tick_ns"][0]), int(measured.ticks["tick_ns"][-1])
    time_s = np.arange(len(measured.motion)) * TICK_S
    position = 20.0 * time_s + 0.05 * np.sin(np.pi * time_s) + rng.uniform(0.0, step)
    measured.motion["position_rad"] = np.floor(position / step) * step
    # At such a speed no reading tells how large a count is.
    streams, found = LiveStreams(TICK_S, resolution=step), []
    for at in range(start, end, PART_NS):
        piece = streams.add(measured.between(at, at + PART_NS))
        if piece is not None:
            found.append(bank.rows(piece)[1])
            noise = bank.noise(piece.count_variance_rad2)
    acceleration = np.concatenate(found)[:, 1]
    assert noise.shape == (WIDTH, WIDTH)
    assert np.mean(acceleration**2) == pytest.approx(noise[1, 1], rel=0.3)
