"""How far predictions are off: bounds that hold as often as they say, whatever noise and model do."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.prediction_error import LEVEL, Pieces, bound

COUNT, RECORDS, NETWORKS = 50, 4, 12
# Independent samples in a stretch, and their mean square.
SAMPLES, NOISE = 400, 1.0


@pytest.mark.parametrize("count", [5, 30, 60])
def test_the_bound_holds_the_next_as_often_as_it_says(count):
    """Whatever the distribution: here a skewed one."""
    rng = np.random.default_rng(count)
    draws = rng.exponential(size=(4000, count + 1)) ** 2
    levels = [bound(draw[:-1]) for draw in draws]
    held = np.mean([draw[-1] <= at for draw, (at, _) in zip(draws, levels, strict=True)])
    said = levels[0][1]
    assert said == pytest.approx(min(LEVEL, count / (count + 1)))
    assert said - 3 * np.sqrt(said * (1 - said) / 4000) < held < said + 1 / (count + 1) + 0.012


def test_values_known_by_draws_are_bounded_as_one_known_value_each():
    """Every draw the same: no more is told than by one."""
    values = np.random.default_rng(1).exponential(size=30)
    assert bound(np.tile(values, (7, 1))) == bound(values)


def session(seed, of_equations, *, level=1.0, values=0.01, known_to=0.0, in_common=0.0):
    """Mean squares of a session whose equations err by ``of_equations`` (stretches,), and its values by ``values``;
    the noise is ``level`` times what the records have, and all stretches of each differ together by ``in_common``."""
    rng = np.random.default_rng(seed)

    def noise(shape):
        together = 1.0 + in_common * rng.standard_normal((*shape[:-1], 1))
        return NOISE * together * rng.chisquare(SAMPLES, shape) / SAMPLES

    drawn = values * rng.chisquare(3, (NETWORKS, 1)) / 3 * np.ones(COUNT)
    return Pieces(of_equations + level * noise((COUNT,)), noise((RECORDS, COUNT)), drawn, known_to)


def test_noise_alone_is_hardly_ever_taken_for_an_error_of_the_equations():
    """The errors of the values are then all that is stated."""
    alone = [np.quantile(session(seed, 0.0).drawn, LEVEL) for seed in range(200)]
    stated = [session(seed, 0.0).bound()[0] ** 2 for seed in range(200)]
    more = np.mean([square > 1.5 * own for square, own in zip(stated, alone, strict=True)])
    assert more < 1 - LEVEL + 3 * np.sqrt(LEVEL * (1 - LEVEL) / 200)


@pytest.mark.parametrize("share", [0.0, 0.03])
def test_noise_that_is_a_little_more_than_thought_is_no_error_where_it_is_not_known_better(share):
    """3 % more, where it is known to 3 %: chance makes it so in one of six sessions."""
    stated = [session(seed, 0.0, level=1.03, known_to=share).bound()[0] ** 2 for seed in range(100)]
    taken_for_error = np.mean(np.array(stated) > 0.05)
    assert (taken_for_error < 0.3) if share else (taken_for_error > 0.6)


def test_what_all_stretches_of_a_record_have_in_common_is_no_error_of_the_equations():
    """2 % of their noise: four records hardly tell how much that is, so chance passes a little more often."""
    stated = [session(seed, 0.0, in_common=0.02).bound()[0] ** 2 for seed in range(300)]
    assert np.mean(np.array(stated) > 0.05) < 0.15


def test_records_that_do_not_differ_leave_all_that_was_seen():
    pieces = Pieces(np.array([1.0, 4.0]), np.zeros((RECORDS, 2)), np.zeros((NETWORKS, 2)))
    assert pieces.bound()[0] == 2.0


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_an_error_of_the_equations_is_bounded_as_often_as_is_said(size):
    """Of all stretches, and unlike in each: those not seen are from the same distribution."""
    held = []
    for seed in range(100):
        rng = np.random.default_rng([seed, 1])
        errors = size * rng.exponential(size=2 * COUNT)
        rms, level = session(seed, errors[:COUNT]).bound()
        held.append(np.mean(errors[COUNT:] <= rms**2))
    assert level == pytest.approx(LEVEL, abs=0.01)
    assert level - 0.03 < np.mean(held) < 0.995


def test_what_changes_in_time_is_stated_however_small_beside_noise():
    """The fit knows it better than the scatter of the stretches shows it."""
    changed = np.linspace(0.0, 0.04, COUNT)
    for seed in range(20):
        none, stated = (replace(session(seed, 0.0), changed=each).bound()[0] ** 2 for each in (np.zeros(1), changed))
        assert stated >= 0.95 * 0.04
        assert stated <= none + 0.04


def test_an_error_in_a_few_stretches_is_not_spread_over_all():
    """Four of fifty, and more than the level leaves out: the bound reaches them."""
    errors = np.where(np.arange(COUNT) < 4, 2.0, 0.0)
    stated = [session(seed, errors).bound()[0] ** 2 for seed in range(20)]
    assert np.median(stated) == pytest.approx(2.0, rel=0.15)
