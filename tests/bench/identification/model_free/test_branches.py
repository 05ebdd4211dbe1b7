"""The branches of a source map, against closed forms and known statistics."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from norton_bench.errors import ExperimentError
from norton_bench.identification.branches import dead_zone, hysteresis, monotone
from norton_bench.identification.results import SourceMap

LEVELS = np.linspace(-1.0, 1.0, 11)
BREAKAWAY, SLOPE, STD = 0.3, 50.0, 0.1


def steady(command):
    return SLOPE * np.sign(command) * np.maximum(np.abs(command) - BREAKAWAY, 0.0)


def drawn(seed, falling_offset=0.0, resamples=400):
    """Both branches measured with noise of STD, and resamples of the same scatter about what was measured."""
    rng = np.random.default_rng(seed)
    command = np.concatenate([LEVELS, LEVELS[::-1]])
    rising = np.arange(22) < 11
    moving = np.abs(command) > BREAKAWAY
    truth = steady(command) + np.where(rising | ~moving, 0.0, falling_offset)
    velocity = truth + np.where(moving, STD, 1e-4) * rng.normal(size=22)
    resampled = velocity + np.where(moving, STD, 1e-4) * rng.normal(size=(resamples, 22))
    return SourceMap(command, velocity, np.where(moving, STD, 1e-4), rising, resampled)


def test_between_levels_the_curve_is_monotonic_whatever_the_noise():
    rng = np.random.default_rng(1)
    curve = monotone(LEVELS, steady(LEVELS) + 3.0 * rng.normal(size=11))
    assert np.all(np.diff(curve(np.linspace(-1, 1, 2001))) >= -1e-12)


def test_a_branch_that_is_monotonic_is_met_exactly_and_interpolated_as_scipy_does():
    at = np.linspace(-1, 1, 101)
    np.testing.assert_allclose(monotone(LEVELS, steady(LEVELS))(at), PchipInterpolator(LEVELS, steady(LEVELS))(at))
    np.testing.assert_allclose(monotone(LEVELS[::-1], -steady(LEVELS[::-1]))(LEVELS), -steady(LEVELS), atol=1e-12)


def test_velocity_and_band_are_unknown_beyond_the_levels():
    source = drawn(0)
    assert np.isnan(source.velocity([-1.1, 1.1], rising=True)).all()
    assert np.isnan(source.band(1.1, rising=True)).all()
    low, high = source.band(0.7, rising=False)
    assert low < source.velocity(0.7, rising=False) < high


@pytest.mark.long
def test_the_band_covers_the_truth_nineteen_times_in_twenty():
    inside = []
    at = np.array([-0.8, -0.6, 0.6, 0.8])
    for seed in range(40):
        low, high = drawn(seed, resamples=150).band(at, rising=True)
        inside.append((low < steady(at)) & (steady(at) < high))
    # 160 trials at 0.95 have a standard deviation of 0.017; few resamples narrow the band a little.
    assert np.mean(inside) == pytest.approx(0.95, abs=0.055)


def test_the_dead_zone_and_its_intervals():
    inside, widths = [], []
    for seed in range(100):
        zone = drawn(seed).dead_zone(rising=True)
        inside += [
            zone.low_interval[0] <= -BREAKAWAY <= zone.low_interval[1],
            zone.high_interval[0] <= BREAKAWAY <= zone.high_interval[1],
            zone.width_interval[0] <= 2 * BREAKAWAY <= zone.width_interval[1],
        ]
        widths.append(zone.width)
    assert np.mean(inside) > 0.9
    assert np.mean(widths) == pytest.approx(2 * BREAKAWAY, abs=0.01)


def test_a_negative_gain_has_a_dead_zone_too():
    zone = dead_zone(LEVELS, -steady(LEVELS), np.empty((0, 11)))
    assert (zone.low, zone.high) == (pytest.approx(-BREAKAWAY), pytest.approx(BREAKAWAY))


def test_without_friction_the_dead_zone_is_empty():
    zone = dead_zone(np.linspace(-1, 1, 10), np.linspace(-1, 1, 10), np.empty((0, 10)))
    assert zone.width == pytest.approx(0.0, abs=1e-12)


def test_one_moving_level_tells_no_more_than_its_gap():
    zone = dead_zone(np.array([-1.0, 0.0, 1.0]), np.array([-5.0, 0.0, 5.0]), np.tile([-5.0, 0.0, 5.0], (99, 1)))
    assert zone.high == 0.5
    assert zone.high_interval == (pytest.approx(0.025, abs=0.02), pytest.approx(0.975, abs=0.02))


def test_a_shaft_that_turns_one_way_only_shows_no_dead_zone():
    assert dead_zone(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.0, 5.0]), np.empty((0, 3))) is None


def test_hysteresis_is_seldom_seen_where_there_is_none_and_always_where_it_is_large():
    alarms = np.mean([drawn(seed).hysteresis().significant for seed in range(200)])
    assert alarms < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 200)
    found = [drawn(seed, falling_offset=8 * STD).hysteresis() for seed in range(20)]
    assert all(each.significant and each.difference_rad_s < 0 for each in found)


def test_branches_without_a_common_level_have_no_hysteresis():
    rising = (np.array([0.0, 1.0]), np.zeros(2), np.zeros((5, 2)))
    falling = (np.array([0.5, 1.5]), np.zeros(2), np.zeros((5, 2)))
    assert hysteresis(rising, falling) is None


def test_a_branch_that_was_not_measured_is_named():
    source = SourceMap(LEVELS, steady(LEVELS), np.zeros(11), np.ones(11, bool))
    with pytest.raises(ExperimentError, match="falling branch"):
        source.velocity(0.0, rising=False)
    assert source.dead_zone(rising=False) is None
    assert source.hysteresis() is None
