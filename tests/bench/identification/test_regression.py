"""What stands between the readings and the normal equations."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.identification.bands import NARROWEST_CUTOFF, told, worthwhile_band
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.regression import Memory, Regression
from norton_bench.identification.rows import Rows
from norton_bench.identification.search_box import LONGEST_STEP, shortened
from norton_bench.identification.separable import (
    LOW_BAND,
    _At,  # a step of the search,
    normal_solution,
    solve,
)
from norton_bench.identification.shape import INERTIA, VISCOUS, Shape
from norton_bench.identification.signals import FINE, TimeSeries, signals
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, Bench, Truth


@given(st.integers(0, 1000), st.integers(1, 5))
def test_what_friction_may_remember_is_taken_off_exactly(seed: int, rests: int):
    """As if every rest had an unknown of its own in the least squares."""
    rng = np.random.default_rng(seed)
    left, rest = rng.uniform(0.1, 1.0, 60), np.sort(rng.integers(0, rests, 60))
    columns, target = rng.standard_normal((3, 60)), rng.standard_normal(60)
    memory = Memory.of(left, rest)
    own = np.stack([np.where(rest == number, left, 0.0) for number in np.unique(rest)])
    every = np.linalg.lstsq(np.concatenate([columns, own]).T, target, rcond=None)[0]
    seen = memory.taken_off(columns)
    assert np.linalg.lstsq(seen.T, memory.taken_off(target), rcond=None)[0] == pytest.approx(every[:3])


def test_errors_in_a_column_no_longer_shrink_its_coefficient():
    rng = np.random.default_rng(2)
    true = rng.standard_normal((2, 20_000))
    target = np.array([3.0, -2.0]) @ true + 0.1 * rng.standard_normal(20_000)
    read = true + np.array([[0.5], [0.0]]) * rng.standard_normal((2, 20_000))
    plain = normal_solution(read, read @ target)
    mended = normal_solution(read, read @ target, np.array([0.25 * 20_000, 0.0]))
    assert plain[0] == pytest.approx(3.0 / 1.25, rel=0.03)
    assert mended == pytest.approx([3.0, -2.0], abs=0.07)


def read_by(counts: float):
    """The same motion, read by an encoder of so many counts."""
    measured = synthetic.experiment(4, bench=Bench(counts=counts, cogging_nm=0.0), blocked=False)
    return signals(measured, TICK_S, Use.IDENTIFY)


@pytest.fixture(scope="module")
def coarse():
    return read_by(2048.0)


@pytest.mark.long
def test_contamination_is_what_the_counts_add_to_the_squares(coarse):
    fine = read_by(2.0**23)
    shape = Shape(600.0, 500.0, 1.41e-3, -0.91e-3)
    squares = []
    for stretches in (coarse, fine):
        # The same rows of both.
        pairs = zip(stretches, coarse, strict=True)
        regression = Regression.of(tuple(replace(one, usable=other.usable) for one, other in pairs), FULL_BAND)
        squares.append(np.sum(regression.columns(shape)[0][:5] ** 2, axis=1))
    added = Regression.of(coarse, FULL_BAND).contamination()
    assert squares[0][INERTIA] - squares[1][INERTIA] == pytest.approx(added[INERTIA], rel=0.1)
    assert squares[0][VISCOUS] - squares[1][VISCOUS] == pytest.approx(added[VISCOUS], rel=0.5)


@pytest.mark.long
def test_the_band_ends_where_a_coarse_encoder_drowns_the_torque(coarse):
    solution = solve(coarse)
    band = solution.regression.rows[0].kernel
    # (S_τ / S_θ)^(1/4) / (2π √Im), with 1 mN·m and 2π/2048/√12 a reading.
    corner_hz = np.sqrt(1e-3 / (2 * np.pi / 2048 / np.sqrt(12))) / (2 * np.pi * np.sqrt(Truth().inertia))
    assert band.cutoff == pytest.approx(corner_hz * TICK_S, rel=0.15)
    assert NARROWEST_CUTOFF < band.cutoff < FULL_BAND.cutoff
    assert solution.linear[INERTIA] == pytest.approx(Truth().inertia, rel=0.02)


@pytest.mark.long
def test_a_fine_encoder_leaves_the_full_band(experiment):
    stretches = signals(experiment, TICK_S, Use.IDENTIFY)
    solution = solve(stretches)
    assert worthwhile_band(solution.regression, solution.linear) == FULL_BAND


def test_the_widest_band_is_what_the_slowest_sensor_tells(experiment):
    (stretch,) = signals(experiment, TICK_S, Use.IDENTIFY)[:1]
    assert told([stretch], FULL_BAND) == FULL_BAND
    slow = told([stretch, replace(stretch, torque_period_s=5 * TICK_S)], FULL_BAND)
    assert (slow.cutoff, slow.half_width) == pytest.approx((FULL_BAND.cutoff / 5, FULL_BAND.half_width * 5))
    assert told([replace(stretch, torque_period_s=5 * TICK_S)], LOW_BAND).cutoff <= LOW_BAND.cutoff


@given(st.lists(st.floats(-20, 20), min_size=4, max_size=4).map(np.array))
def test_a_step_that_is_too_long_is_tried_clipped_and_then_straight(share):
    step = share * LONGEST_STEP
    tried = list(shortened(step))
    half = len(tried) // 2
    assert all(np.all(np.abs(each) <= LONGEST_STEP * (1 + 1e-12)) for each in tried)
    assert tried[0] == pytest.approx(np.clip(step, -LONGEST_STEP, LONGEST_STEP))
    assert tried[half] * max(1.0, np.max(np.abs(share))) == pytest.approx(step)
    assert [np.abs(b).max() <= np.abs(a).max() for a, b in pairwise(tried[:half])] == [True] * (half - 1)


@pytest.mark.long
def test_what_a_slow_sensor_hardly_tells_is_settled_all_the_same():
    """A lag and a delay that stand for each other in so low a band: clipped each for itself, no step went downhill."""
    unsettled = []
    for seed in range(3):
        measured = synthetic.experiment(seed, blocked=False, imposed=False)
        torque = measured.torque[::6]
        torque["sequence"] = np.arange(len(torque))
        stretches = signals(replace(measured, torque=torque), TICK_S, Use.IDENTIFY)
        unsettled += [seed] * (not solve(stretches).converged)
    assert unsettled == []


@pytest.mark.long
def test_the_slopes_are_those_of_the_cost(experiment):
    """Against differences of what is minimised: delays that move cogging, jerk and friction's memory included."""
    solution = solve(signals(experiment, TICK_S, Use.IDENTIFY))
    assert solution.regression.cogging
    assert solution.regression.whitening is not None
    at, steps = solution.shape.as_array(), np.array([1e-2, 1e-2, 2e-6, 2e-6])
    beside = at + 2 * steps
    here = _At.of(solution.regression, Shape.of(beside))
    slopes = -2.0 * here.slopes @ here.innovation
    for index, step in enumerate(steps):
        costs = []
        for side in (1.0, -1.0):
            moved = beside.copy()
            moved[index] += side * step
            costs.append(_At.of(solution.regression, Shape.of(moved)).cost)
        assert slopes[index] == pytest.approx((costs[0] - costs[1]) / (2 * step), rel=0.03)


def test_waves_are_searched_over_the_angles_that_their_columns_have(experiment):
    """Torque that comes 3 ms late acted 0.1 rad before the angle that is read with it: a third of a period at 42."""
    regression = Regression.of(signals(experiment, TICK_S, Use.IDENTIFY), FULL_BAND)
    late = replace(solve(signals(experiment, TICK_S, Use.IDENTIFY)).shape, motion_delay_s=-3e-3)
    cosine, sine = regression.chosen([rows.cogging(late, 1.0) for rows in regression.rows])
    error_rad = np.angle(np.exp(1j * regression.position(late)) / (cosine + 1j * sine))
    assert np.max(np.abs(error_rad)) < 1e-3


def test_noise_in_the_delays_slope_is_known(experiment):
    """Of readings of a shaft at rest, all that there is of a slope is their noise."""
    stretch = signals(experiment, TICK_S, Use.IDENTIFY)[0]
    read_rad = 1e-5 * np.random.default_rng(1).standard_normal(stretch.time_s.size)
    fine_s = stretch.time_s[0] + np.arange(stretch.path_rad.size) * (TICK_S / FINE)
    noisy = TimeSeries(stretch.time_s, read_rad, TICK_S).at(fine_s)
    rows = Rows(replace(stretch, position_rad=noisy, position_noise=1e-10 * TICK_S), FULL_BAND)
    jerk = rows.of_fine_signal(noisy, (3,), 0.0)[0][50:-50]
    assert float(np.mean(jerk**2)) == pytest.approx(rows.motion_noise(3), rel=0.05)
