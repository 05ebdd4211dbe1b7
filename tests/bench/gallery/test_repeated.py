"""Intervals from repetitions, against made-up repetitions whose truth is known."""

import numpy as np
import pytest

from norton_bench.gallery.claim import LEVEL, Estimated, Row, StraightLine, mean, wider

TRIALS = 4000


def coverage(found, true):
    return np.mean([each.interval[0] <= true <= each.interval[1] for each in found])


def test_a_mean_is_where_it_is_said_to_be_as_often_as_it_is_said():
    rng = np.random.default_rng(1)
    held = coverage([mean(3.0 + 0.1 * rng.normal(size=6)) for _ in range(TRIALS)], 3.0)
    assert held == pytest.approx(LEVEL, abs=0.002)


@pytest.mark.parametrize(
    ("of", "true"), [(lambda line: line.slope, -2.0), (lambda line: line.value(0.0), 1.0), (StraightLine.zero, 0.5)]
)
def test_a_line_has_its_slope_its_values_and_its_zero(of, true):
    rng, x = np.random.default_rng(2), np.repeat([0.2, 0.4, 0.6], 4)
    held = coverage([of(StraightLine(x, 1.0 - 2.0 * x + 0.05 * rng.normal(size=x.size))) for _ in range(TRIALS)], true)
    assert held == pytest.approx(LEVEL, abs=0.002)


def test_a_line_that_may_be_level_has_its_zero_anywhere():
    x = np.repeat([0.2, 0.4, 0.6], 2)
    assert StraightLine(x, [1.0, -1.0, 1.1, -0.9, 1.0, -1.2]).zero().interval == (-np.inf, np.inf)


def test_a_tolerance_widens():
    assert wider(Estimated(1.0, (0.9, 1.1)), 0.2).interval == pytest.approx((0.7, 1.3))


@pytest.mark.parametrize(
    ("expected", "rival", "passes"),
    [(1.0, float("nan"), True), (1.3, float("nan"), False), (1.0, 0.95, False), (1.0, 0.0, True)],
)
def test_a_row_passes_where_its_interval_holds_what_is_expected_and_not_its_rival(expected, rival, passes):
    assert Row("claim", "figure", "N*m", expected, 1.01, (0.9, 1.1), rival).passed is passes
