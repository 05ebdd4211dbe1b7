"""What few sessions can tell, against made-up sessions whose truth is known."""

import numpy as np
import pytest

from benchmarks.verdicts import ENOUGH, Figure, every, rms, share

TRIALS = 1000


@pytest.mark.parametrize("count", [2, 10, 50])
def test_an_rms_interval_holds_the_deviation_as_often_as_it_is_said(count: int) -> None:
    rng = np.random.default_rng(1)
    found = [rms(1.2 * rng.normal(size=count)) for _ in range(TRIALS)]
    assert np.mean([low <= 1.2 <= high for low, high in (each.interval for each in found)]) == pytest.approx(
        0.95, abs=0.025
    )


def test_chance_is_shared_between_figures_that_are_looked_at_together() -> None:
    ratios = np.random.default_rng(2).normal(size=10)
    alone, among = rms(ratios), rms(ratios, among=7)
    assert among.value == alone.value
    assert among.interval[0] < alone.interval[0] < alone.value < alone.interval[1] < among.interval[1]


@pytest.mark.parametrize("count", [14, 70])
def test_a_share_is_held_at_least_as_often_as_it_is_said(count: int) -> None:
    rng = np.random.default_rng(3)
    found = [share(rng.random(count) < 0.9).interval for _ in range(TRIALS)]
    assert np.mean([low <= 0.9 <= high for low, high in found]) >= 0.94
    assert share(np.ones(count, bool)).interval[1] == 1.0
    assert share(np.zeros(count, bool)).interval[0] == 0.0


@pytest.mark.parametrize(
    ("interval", "few", "many"),
    [
        ((0.5, 1.1), True, True),
        ((0.5, 1.9), None, True),  # what was found, 1.0, lies within
        ((1.4, 1.9), False, True),
        ((np.nan, np.nan), None, True),
    ],
)
def test_few_sessions_tell_by_their_interval_and_many_by_the_figure(
    interval: tuple[float, float], few: bool | None, many: bool
) -> None:
    figure = Figure(1.0, interval)
    assert figure.within(0.0, 1.3, ENOUGH - 1) is few
    assert figure.within(0.0, 1.3, ENOUGH) is many
    assert Figure(np.nan, interval).within(0.0, 1.3, ENOUGH) is None


def test_two_good_sessions_do_not_tell_and_two_bad_ones_do() -> None:
    assert rms(np.array([0.4, -1.1])).within(0.0, 1.3, 2) is None
    assert rms(np.array([40.0, -35.0])).within(0.0, 1.3, 2) is False


def test_all_are_reached_where_each_is_and_not_where_one_is_not() -> None:
    assert every([True, True]) is True
    assert every([True, None]) is None
    assert every([True, None, False]) is False
