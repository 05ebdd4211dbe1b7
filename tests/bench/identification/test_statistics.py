"""One value out of several: against published results, and against simulated sessions whose truth is known."""

from functools import cache

import numpy as np
import pytest

from norton_bench.distributions import chi2_tail
from norton_bench.identification.statistics import (
    NORMAL_95,
    Combined,
    between_limit,
    combine,
    moderated_std_of_next,
    moved_by_parts,
    reach_of_next,
    shrunk,
    with_lag_as_told,
)

# Thirteen trials of the BCG vaccine, cases and others with it, cases and others without (Colditz et al. 1994, as in
# the R package metadat, dat.bcg): the example on which programs for such analyses are compared.
BCG = np.array(
    [
        (4, 119, 11, 128), (6, 300, 29, 274), (3, 228, 11, 209), (62, 13536, 248, 12619), (33, 5036, 47, 5761),
        (180, 1361, 372, 1079), (8, 2537, 10, 619), (505, 87886, 499, 87892), (29, 7470, 45, 7232),
        (17, 1699, 65, 1600), (186, 50448, 141, 27197), (5, 2493, 3, 2338), (27, 16886, 29, 17825),
    ], dtype=float,
).T  # fmt: skip


def log_risks() -> tuple[np.ndarray, np.ndarray]:
    a, b, c, d = BCG
    return np.log(a / (a + b) / (c / (c + d))), 1 / a - 1 / (a + b) + 1 / c - 1 / (c + d)


def sessions(rng: np.random.Generator, count: int, between_std: float) -> tuple[np.ndarray, np.ndarray]:
    stds = rng.uniform(0.5, 2.0, count)
    return 10.0 + rng.normal(0.0, between_std, count) + stds * rng.normal(size=count), stds


@cache
def draws(count: int, between_std: float, number: int, seed: int) -> list[Combined]:
    rng = np.random.default_rng([seed, count])
    return [combine(*sessions(rng, count, between_std)) for _ in range(number)]


def test_a_published_example_comes_out_as_published() -> None:
    values, variances = log_risks()
    found = combine(values, np.sqrt(variances))
    # metafor 4: rma(yi, vi, data = dat, method = "REML", test = "knha"), Q of the same, and confint() of it.
    assert found.value == pytest.approx(-0.7145, abs=5e-5)
    assert found.between_std**2 == pytest.approx(0.3132, abs=5e-5)
    assert found.q == pytest.approx(152.2330, abs=5e-5)
    assert found.value + NORMAL_95 * found.std == pytest.approx(-0.3206, abs=5e-4)
    assert between_limit(values, variances, 0.975) ** 2 == pytest.approx(1.1115, abs=5e-5)
    assert between_limit(values, variances, 0.025) ** 2 == pytest.approx(0.1197, abs=5e-5)


def test_sessions_that_agree_give_the_weighted_mean() -> None:
    values, stds = np.array([1.00, 1.02, 0.995, 1.01]), np.array([0.02, 0.03, 0.01, 0.05])
    found = combine(values, stds)
    assert found.between_std == 0.0
    assert found.value == pytest.approx(np.average(values, weights=stds**-2), rel=1e-12)
    assert found.std == pytest.approx(np.sum(stds**-2.0) ** -0.5)  # Student's would be narrower, by chance
    assert found.shared_std == 0.0
    assert found.p > 0.5
    assert found.between_std_upper > found.within_std  # four sessions do not tell more


def test_sessions_far_apart_are_a_sample_of_their_own() -> None:
    values = np.array([1.0, 1.4, 0.9, 1.2, 1.1])
    found = combine(values, np.full(5, 1e-4))
    assert found.value == pytest.approx(values.mean(), rel=1e-6)
    assert found.between_std == pytest.approx(values.std(ddof=1), rel=1e-4)
    # Student's interval of a mean: t(4) = 2.776; the deviation's limit: chi-square(4) exceeds 0.711 with 95 %.
    assert NORMAL_95 * found.std == pytest.approx(2.7764 * values.std(ddof=1) / np.sqrt(5), rel=1e-3)
    assert found.between_std_upper == pytest.approx(values.std(ddof=1) * np.sqrt(4 / 0.7107), rel=1e-3)


@pytest.mark.parametrize("between_std", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("count", [3, 5, 10])
def test_intervals_cover_what_they_promise(count: int, between_std: float) -> None:
    found = draws(count, between_std, 600, seed=3)
    covered = np.mean([abs(each.value - 10.0) <= NORMAL_95 * each.std for each in found])
    below = np.mean([each.between_std_upper >= between_std for each in found])
    # 600 draws: a standard error of 0.9 %. Where nothing differs, the interval is cautious.
    assert 0.92 <= covered <= (0.995 if between_std == 0.0 else 0.98)
    assert below >= 0.92


@pytest.mark.parametrize("count", [2, 5])
def test_chance_alone_alarms_as_often_as_it_says(count: int) -> None:
    # 600 draws, those of the intervals where there are any: a standard error of 0.9 %.
    alarms = np.mean([each.p < 0.05 for each in draws(count, 0.0, 600, seed=3)])
    assert alarms == pytest.approx(0.05, abs=0.025)


def test_the_unit_does_not_matter() -> None:
    values, variances = log_risks()
    found, scaled = combine(values, np.sqrt(variances)), combine(1e-6 * values, 1e-6 * np.sqrt(variances))
    for name in ("value", "std", "within_std", "between_std", "between_std_upper"):
        assert getattr(scaled, name) == pytest.approx(1e-6 * getattr(found, name), rel=1e-5)


def test_equal_values_are_no_spread() -> None:
    found = combine(np.array([2.0, 2.0, 2.0]), np.array([0.1, 0.2, 0.1]))
    assert (found.between_std, found.between_std_upper, found.q) == (0.0, 0.0, 0.0)
    assert found.std == pytest.approx(np.hypot(225.0**-0.5, found.within_std))


def test_an_error_that_all_sessions_share_does_not_average_out() -> None:
    rng = np.random.default_rng(5)
    covered, stds = [], np.full(8, 1.0)
    for _ in range(300):
        shared, own = 0.98 * rng.normal(), 0.2 * rng.normal(size=8)  # 1 together, as the deviations say
        found = combine(10.0 + shared + own, stds)
        covered.append(abs(found.value - 10.0) <= NORMAL_95 * found.std)
    assert 0.90 <= np.mean(covered) <= 0.99
    assert found.std > 0.8 > 2 / np.sqrt(8)


def test_an_error_known_to_be_shared_comes_on_top() -> None:
    values, stds = np.array([1.00, 1.02, 0.995, 1.01]), np.array([0.02, 0.03, 0.01, 0.05])
    without, with_it = combine(values, stds), combine(values, stds, 0.005)
    assert with_it.shared_std == 0.005
    assert with_it.std == pytest.approx(np.hypot(without.std, 0.005))
    assert (with_it.value, with_it.p) == (without.value, without.p)


@pytest.mark.parametrize(
    ("values", "stds"), [([1.0], [0.1]), ([1.0, 2.0], [0.1, 0.0]), ([1.0, np.nan], [0.1, 0.1]), ([1, 2], [0.1, np.inf])]
)
def test_what_cannot_be_combined_is_refused(values: list[float], stds: list[float]) -> None:
    with pytest.raises(ValueError, match="two finite values"):
        combine(np.array(values), np.array(stds))


# ---- A lag behind a delay -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known_to", [0.02, 0.1, 0.2])
def test_a_bandwidth_whose_square_of_time_constant_scatters_is_within_its_interval(known_to: float) -> None:
    """1/β² comes out with such a share of deviation; β and its linear deviation follow from it."""
    rng, true, draws = np.random.default_rng(5), 600.0, 4000
    found = 1.0 / true**2 * (1.0 + known_to * rng.standard_normal(draws))
    inside, linear = [], []
    for square in found:
        bandwidth, std = square**-0.5, 0.5 * square**-1.5 * known_to / true**2
        covariance = np.array([[1.0, 0.5 * std], [0.5 * std, std**2]])
        wider = with_lag_as_told(np.array([1.0, bandwidth]), covariance, 1)
        assert wider[0, 0] == 1.0
        assert wider[0, 1] == pytest.approx(0.5 * np.sqrt(wider[1, 1]))
        inside.append(abs(bandwidth - true) <= 1.96 * np.sqrt(wider[1, 1]))
        linear.append(abs(bandwidth - true) <= 1.96 * std)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.012)
    assert np.mean(inside) >= np.mean(linear)


def test_a_bandwidth_that_may_be_infinite_is_not_known() -> None:
    covariance = with_lag_as_told(np.array([500.0]), np.array([[160.0**2]]), 0)
    assert np.sqrt(covariance[0, 0]) == pytest.approx(500.0)


# ---- Parts of one record --------------------------------------------------------------------------------------------

PARTS, ROWS = 4, 600
TIME_S = np.arange(PARTS * ROWS) * 0.05  # blocks of 2 s are many in a part


def in_one_part_only(rng: np.random.Generator) -> np.ndarray:
    """Columns (n, 3): the second is excited in the last part alone, the third is there throughout."""
    columns = rng.standard_normal((PARTS * ROWS, 3))
    columns[: 3 * ROWS, 1] = 0.0
    return columns


def test_parts_that_tell_a_value_equally_move_it_by_their_own_less_the_mean() -> None:
    rng = np.random.default_rng(1)
    columns = np.tile(rng.standard_normal((ROWS, 2)), (PARTS, 1))
    target = columns @ [2.0, -1.0] + rng.standard_normal(PARTS * ROWS)
    whole = np.linalg.lstsq(columns, target, rcond=None)[0]
    moved = moved_by_parts(columns, target - columns @ whole, TIME_S, parts=PARTS)
    own = [
        np.linalg.lstsq(*each, rcond=None)[0] for each in zip(np.split(columns, 4), np.split(target, 4), strict=True)
    ]
    np.testing.assert_allclose(moved.values, (np.array(own) - whole) / PARTS, atol=1e-12)


def test_what_a_part_does_not_excite_it_does_not_move() -> None:
    rng = np.random.default_rng(2)
    columns = in_one_part_only(rng)
    target = columns @ [2.0, -1.0, 0.5] + rng.standard_normal(PARTS * ROWS)
    residual = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
    moved = moved_by_parts(columns, residual, TIME_S, parts=PARTS)
    np.testing.assert_allclose(np.sum(moved.values, axis=0), 0.0, atol=1e-12)
    assert np.max(np.abs(moved.values[:, 1])) < 0.2 * np.max(np.abs(moved.stds[:, 1]))


@pytest.mark.parametrize("change", [0.0, 0.5])
def test_parts_differ_by_chance_as_often_as_they_should_and_by_a_change_nearly_always(change: float) -> None:
    """For the two values that every part tells, in 200 records; of 400 chances of 5 %, 9 to 33 but once in 500."""
    rng, seen = np.random.default_rng(3), []
    for _ in range(200):
        columns = in_one_part_only(rng)
        true = np.array([2.0, -1.0, 0.5]) + change * np.repeat(np.arange(PARTS) % 2, ROWS)[:, None]
        target = np.sum(columns * true, axis=1) + rng.standard_normal(PARTS * ROWS)
        residual = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
        moved = moved_by_parts(columns, residual, TIME_S, parts=PARTS)
        q = np.sum(moved.values**2, axis=0) / np.mean(moved.stds**2, axis=0)
        seen += [chi2_tail(float(q[at]), PARTS - 1) < 0.05 for at in (0, 2)]
    assert 9 <= sum(seen) <= 33 if change == 0.0 else sum(seen) > 390


def test_values_brought_nearer_to_their_mean_are_nearer_to_the_truth() -> None:
    """By the share that chance has: the mean square error is that of Bayes' rule with the truth's own spread, and
    what is left of it hardly goes with the value: as far as 40 values do not tell the spread (over 200 sets)."""
    rng = np.random.default_rng(4)
    errors, products, squares = [], [], []
    for _ in range(200):
        stds = rng.uniform(0.5, 2.0, 40)
        true = 3.0 + rng.normal(0.0, 1.0, 40)
        brought = shrunk(true + stds * rng.normal(size=40), stds**2)
        errors.append(np.mean((brought - true) ** 2))
        products.append(np.sum((true - brought) * (brought - np.mean(brought))))
        squares.append(np.sum((brought - np.mean(brought)) ** 2))
    best = np.mean([s**2 / (1 + s**2) for s in np.linspace(0.5, 2.0, 1000)])
    assert np.mean(errors) == pytest.approx(best, rel=0.15)
    assert abs(np.sum(products)) < 0.15 * np.sum(squares)


def test_values_that_differ_by_chance_alone_are_all_the_mean() -> None:
    values = np.array([1.00, 1.02, 0.99, 1.01])
    assert shrunk(values, np.full(4, 0.1)) == pytest.approx(np.full(4, np.mean(values)))


def test_values_that_are_known_stay() -> None:
    values = np.array([1.0, 5.0, -2.0])
    assert shrunk(values, np.full(3, 1e-9)) == pytest.approx(values, rel=1e-6)


def shares_within(worth: float, trials: int = 800, parameters: int = 7, count: int = 12) -> tuple[float, float]:
    """How often one more draw lies within 1.96 deviations, and how wide these are beside the truth, where what is
    stated is worth so many draws."""
    rng = np.random.default_rng(8)
    within, widths = [], []
    for _ in range(trials):
        stated = np.geomspace(1e-6, 1e3, parameters)
        std = stated * np.sqrt(worth / rng.chisquare(worth, parameters)) if np.isfinite(worth) else stated
        drawn = std * rng.normal(size=(count, parameters))
        moderated = moderated_std_of_next(drawn, stated)
        off = std * rng.normal(size=parameters) - np.mean(drawn, axis=0)
        within.append(np.abs(off) < NORMAL_95 * moderated)
        widths.append(np.log(moderated / std))
    return float(np.mean(within)), float(np.exp(np.mean(widths)))


@pytest.mark.parametrize("worth", [2.0, 8.0, 30.0, np.inf])
def test_one_more_draw_lies_within_moderated_deviations_as_often_as_it_says(worth: float) -> None:
    # 5600 draws tell the share to 0.3 %. How many draws the stated deviations are worth is estimated from seven.
    assert shares_within(worth)[0] == pytest.approx(0.95, abs=0.01)


def test_deviations_that_are_stated_rightly_make_few_draws_enough() -> None:
    assert 1.0 < shares_within(np.inf)[1] < 1.08
    few = reach_of_next(np.random.default_rng(3).normal(size=(12, 20_000)), 0.975) / NORMAL_95
    assert np.mean(few) > 1.13


def test_deviations_that_are_stated_far_too_small_count_for_nothing() -> None:
    draws = np.random.default_rng(4).normal(size=(12, 7)) * np.geomspace(1e2, 1e6, 7)
    moderated = moderated_std_of_next(draws, np.ones(7))
    assert moderated == pytest.approx(reach_of_next(draws, 0.975) / NORMAL_95, rel=0.1)


def test_a_parameter_without_a_deviation_leaves_those_of_the_others() -> None:
    draws = np.random.default_rng(5).normal(size=(12, 4))
    stated = np.array([1.0, np.nan, 1.0, 1.0])
    moderated = moderated_std_of_next(draws, stated)
    assert np.isnan(moderated[1])
    assert moderated[[0, 2, 3]] == pytest.approx(moderated_std_of_next(draws[:, [0, 2, 3]], np.ones(3)))
