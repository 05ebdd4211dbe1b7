"""What the tables of exertion say of springs, backlash and friction, and where they say nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.identification.averages import BLOCKS, Mean, Swept, line_amplitudes, mean_of, swept
from norton_bench.identification.exertion_table import ExertionTable, Held, shake_lines
from norton_bench.records import TICK
from tests.bench.identification.tables.springs import HELD, NOISE_NM, backlash, table


@settings(max_examples=40, deadline=None)
@given(st.floats(1.0, 50.0), st.floats(0.0, 0.01), st.integers(0, 1000))
def test_a_spring_has_its_stiffness_and_no_range_without_torque(stiffness, friction_nm, seed):
    (line,) = table(lambda away: -stiffness * away, friction_nm, seed=seed).lines()
    assert line.stiffness.value == pytest.approx(stiffness, abs=4 * line.stiffness.half_width)
    assert line.stiffness.half_width < 0.1 * stiffness + 0.1
    assert line.hysteresis_nm == pytest.approx(friction_nm, abs=4 * NOISE_NM + 2e-4 * stiffness)
    if friction_nm == 0.0:
        assert line.zeros is None or line.zeros.width.value < 2 * line.zeros.width.half_width + 3e-4


@pytest.mark.parametrize("width_rad", [0.02, 0.04])
def test_backlash_is_found_with_its_width_and_what_holds_beyond_it(width_rad):
    (line,) = table(backlash(8.0, width_rad)).lines()
    assert line.zeros is not None
    assert line.zeros.width.value == pytest.approx(width_rad, abs=1.5 * line.zeros.width.half_width)
    assert line.zeros.width.half_width < 3e-3
    assert line.stiffness.value == pytest.approx(8.0, abs=max(2 * line.stiffness.half_width, 0.3))


def soft(away, gap_rad=0.0):
    """As a muscle against a spring, which stiffens to one side; with a gap it is beyond that."""
    beyond = away - min(max(away, -gap_rad / 2), gap_rad / 2)
    return -(0.15 * beyond + 0.4 * beyond**2)


def swept_with_noise(exerted, seed):
    """Both ways across, with friction and noise that are a fifth and a twentieth of the greatest torque."""
    random, places = np.random.default_rng(seed), np.linspace(-0.05, 0.05, 38)
    ways = tuple(
        Swept(
            HELD,
            rising,
            0.03,
            (
                places,
                np.array([exerted(away) for away in places]) + sign * 1.2e-3 + 4e-4 * random.standard_normal(38),
                np.full(38, 8e-4),
            ),
        )
        for rising, sign in ((True, -1.0), (False, 1.0))
    )
    return replace(table(exerted, 1.2e-3, seed=seed), swept=ways)


def test_a_soft_spring_swept_in_noise_has_no_backlash():
    gaps = [line.zeros for seed in range(60) for line in swept_with_noise(soft, seed).lines()]
    assert not any(zeros.is_gap for zeros in gaps)
    assert np.median([zeros.width.half_width for zeros in gaps]) < 0.02


def test_backlash_swept_in_noise_is_found_all_the_same():
    gaps = [
        line.zeros
        for seed in range(20)
        for line in swept_with_noise(lambda away: 6.0 * soft(away, gap_rad=0.02), seed).lines()
    ]
    assert all(zeros.is_gap for zeros in gaps)
    assert [zeros.width.value for zeros in gaps] == pytest.approx([0.02] * 20, abs=2e-3)


def test_beyond_what_was_held_nothing_is_claimed():
    held = table(lambda away: -3.0 * away)
    assert held.exertion_nm(HELD, 0.02) == pytest.approx(-0.06, abs=3 * NOISE_NM)
    assert np.isnan(held.exertion_nm(HELD, 0.2))


def test_one_direction_alone_tells_no_hysteresis():
    both = table(lambda away: -3.0 * away)
    rising = ExertionTable(tuple(held for held in both.held if held.rising), (), both.sources)
    (line,) = rising.lines()
    assert np.isnan(line.hysteresis_nm)
    assert line.stiffness.value == pytest.approx(3.0, rel=0.1)


def test_too_few_places_tell_no_stiffness():
    few = ExertionTable((Held(HELD, 0.01, True, Mean(0.1, 1e-3)),), (), {HELD: Mean(0.5, 1e-5)})
    (line,) = few.lines()
    assert np.isnan(line.stiffness.value)
    assert line.zeros is None


def test_lines_stay_below_what_the_loop_carries():
    frequency_hz, amplitude = shake_lines(1e-3)
    assert frequency_hz.max() <= 100
    assert amplitude.sum() == pytest.approx(1.0)
    assert len(shake_lines(1 / 200)[0]) == 3


@settings(max_examples=50, deadline=None)
@given(st.floats(-3, 3), st.floats(-3, 3), st.integers(0, 10_000))
def test_sines_are_found_in_readings_that_come_when_they_like(cosine, sine, seed):
    random = np.random.default_rng(seed)
    time_s = np.sort(random.uniform(0, 2, 1500))
    omega = 2 * np.pi * np.array([2.0, 11.0])
    values = cosine * np.cos(omega[0] * time_s) - sine * np.sin(omega[0] * time_s) + 0.7 + 0.1 * time_s
    found, deviation = line_amplitudes(time_s, values + 0.05 * random.standard_normal(1500), omega)
    assert found[0] == pytest.approx(complex(cosine, sine), abs=6 * deviation)
    assert abs(found[1]) < 6 * deviation
    assert 1e-3 < deviation < 3e-3


def test_means_are_as_wide_as_what_lasts():
    random = np.random.default_rng(0)
    white = random.standard_normal(600)
    wander = np.repeat(random.standard_normal(BLOCKS), 100)
    assert mean_of(wander).half_width > 3 * mean_of(white).half_width
    assert mean_of(np.ones(600), least=1e-3) == Mean(1.0, 1e-3)
    assert np.isnan(mean_of(np.ones(3)).value)


def test_two_ways_that_have_no_place_in_common_are_no_sweep():
    ways = tuple(
        Swept(HELD, rising, 0.05, (np.linspace(low, low + 0.01, 5), np.zeros(5), np.full(5, 1e-3)))
        for rising, low in ((True, 0.0), (False, 0.02))
    )
    apart = replace(table(lambda away: -3.0 * away), swept=ways)
    assert apart.sweep(HELD) is None
    assert apart.lines()[0].sweep is None


def test_a_way_across_is_read_without_its_ends_where_the_port_hardly_moves():
    ticks = np.zeros(2400, TICK)
    ticks["tick_ns"] = np.arange(2400) * 1_000_000
    moving = np.clip((np.arange(2400) - 200) / 2000, 0.0, 1.0)
    ticks["position_rad"] = 0.5 - 0.05 + 0.1 * moving
    ticks["torque_nm"] = -3.0 * (ticks["position_rad"] - 0.5) + 0.01 * np.cos(np.arange(2400))
    way = swept(ticks, HELD, True, 0.5)
    assert way is not None
    places, torque_nm, _ = way.branch
    assert 30 <= places.size <= 38
    assert np.diff(places).min() > 0.5e-3
    assert torque_nm == pytest.approx(-3.0 * places, abs=1e-3)
    assert way.speed_rad_s == pytest.approx(0.1 / 2.4, rel=0.01)
    assert swept(ticks[:40], HELD, True, 0.5) is None
