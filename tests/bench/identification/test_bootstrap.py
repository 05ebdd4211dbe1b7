"""Simulated records: errors of readings found again, no bias where there are none, and what is made of a scatter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from norton_bench.identification.bootstrap import Readings, Simulation, scatter_of
from norton_bench.identification.counts import NO_STEPS, Resolution
from norton_bench.identification.coupling import LEAST_DAMPING_RATIO, Coupling, least_damping_nms_rad
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.motor_values import PHYSICAL, physical
from norton_bench.identification.reading_errors import NO_ERRORS, ReadingErrors
from norton_bench.identification.scatter import Scatter
from norton_bench.identification.separable import solve, solve_again
from norton_bench.identification.signals import TimeSeries, signals
from norton_bench.identification.simulated_bench import EvenSpline
from norton_bench.identification.statistics import moderated_std_of_next
from norton_bench.models.parameters import Status
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S


def stream(noise: float, step: float, jitter_s: float, seed: int = 3) -> TimeSeries:
    """A motion, now slow, now fast, with errors of readings of these sizes."""
    random = np.random.default_rng(seed)
    time_s = np.arange(60_000) * TICK_S
    at_s = time_s + jitter_s * random.standard_normal(time_s.size)
    value = 20.0 * np.sin(0.2 * at_s) * np.sin(3.0 * at_s) + noise * random.standard_normal(time_s.size)
    return TimeSeries(time_s, np.round(value / step) * step if step else value, TICK_S)


@pytest.mark.parametrize(("noise", "step", "jitter_s"), [(1e-4, 0.0, 0.0), (1e-4, 2e-4, 0.0), (0.0, 2e-4, 3e-5)])
def test_errors_of_readings_are_told_from_the_readings(noise: float, step: float, jitter_s: float) -> None:
    found = ReadingErrors.of(stream(noise, step, jitter_s), Resolution(step))
    # 600 blocks tell each variance to 6 %; a shock-proof median of a hundred squares adds 2 % of bias.
    assert found.noise == pytest.approx(noise, rel=0.1, abs=2e-5)
    assert found.jitter_s == pytest.approx(jitter_s, rel=0.1, abs=3e-6)


@pytest.mark.parametrize(("noise", "jitter_s"), [(1e-4, 0.0), (1e-4, 3e-5)])
def test_motion_too_fast_for_the_readings_is_no_noise_where_it_is_at_times_only(noise: float, jitter_s: float) -> None:
    """A shaft that rings for a quarter of the time, at half the rate of the readings, with thirty times the noise."""
    still = stream(noise, 0.0, jitter_s)
    rings = np.sin(0.02 * still.time_s) > np.sqrt(0.5)
    ringing = np.where(rings, 30.0 * noise * np.cos(np.pi * np.arange(still.value.size)), 0.0)
    found = ReadingErrors.of(replace(still, value=still.value + ringing), NO_STEPS)
    # The line through the quiet blocks has a quarter more of them above it than below: a third of their scatter.
    assert found.noise == pytest.approx(noise, rel=0.15)
    assert found.jitter_s == pytest.approx(jitter_s, rel=0.15, abs=5e-6)


def test_blocks_in_which_counts_hide_all_tell_nothing_of_uneven_instants() -> None:
    """A shaft that rests for a third of the time: no reading differs from the one before."""
    errors, step, random = ReadingErrors(0.0, Resolution(2e-4), 3e-5), 2e-4, np.random.default_rng(3)
    time_s = np.arange(60_000) * TICK_S
    moves = np.sin(0.3 * time_s) > -0.5
    path = np.cumsum(np.where(moves, 20.0 * np.sin(3.0 * time_s), 0.0)) * TICK_S
    read = np.where(moves, errors.drawn(path, np.gradient(path, time_s), random), np.round(path / step) * step)
    found = ReadingErrors.of(TimeSeries(time_s, read, TICK_S), errors.steps)
    # Slow blocks, in which counts alternate, tell less than the average of the others.
    assert found.jitter_s == pytest.approx(3e-5, rel=0.2)


def test_errors_are_no_greater_than_a_variance_allows() -> None:
    errors, rate = ReadingErrors(2e-3, Resolution(1e-3), 1e-4, variance_std=1e-7), np.array([-30.0, 10.0])
    variance = 2e-3**2 + 1e-3**2 / 12 + 1e-4**2 * 500.0
    assert errors.no_more_than(1.01 * variance, rate) is errors
    less = errors.no_more_than(0.3 * variance, rate)
    assert less.noise**2 + less.steps.variance + less.jitter_s**2 * 500.0 == pytest.approx(0.3 * variance)
    assert less.noise / less.jitter_s == pytest.approx(errors.noise / errors.jitter_s)
    assert less.steps == errors.steps  # which readings show
    assert less.variance_std / less.noise**2 == pytest.approx(errors.variance_std / errors.noise**2)
    counted = errors.no_more_than(0.5 * errors.steps.variance, rate)
    assert (counted.noise, counted.jitter_s) == (0.0, 0.0)


@pytest.mark.parametrize("jitter_s", [0.0, 3e-5])
def test_how_well_the_noise_is_known_is_how_much_it_scatters(jitter_s: float) -> None:
    """Over 40 records, whose scatter is known to within 11 %: three deviations."""
    found = [ReadingErrors.of(stream(1e-4, 0.0, jitter_s, seed), NO_STEPS) for seed in range(40)]
    variances = np.array([each.noise**2 for each in found])
    scatter = np.std(variances) / np.mean(variances)
    assert np.mean([each.known_to for each in found]) == pytest.approx(scatter, rel=0.35)


def test_a_spline_on_an_even_grid_is_the_interpolating_one() -> None:
    """What its ends are taken for is forgotten within each step by a factor of 3.7."""
    time_s, random = 7.0 + np.arange(2_000) * TICK_S, np.random.default_rng(2)
    values, at_s = random.standard_normal(time_s.size), np.sort(random.uniform(time_s[40], time_s[-40], 5_000))
    assert EvenSpline.of(time_s, values)(at_s) == pytest.approx(make_interp_spline(time_s, values, k=3)(at_s), abs=1e-9)


def test_readings_have_the_errors_that_they_are_given() -> None:
    errors, random = ReadingErrors(noise=2e-3, steps=Resolution(1e-3), jitter_s=1e-4), np.random.default_rng(5)
    rate = np.full(20_000, 10.0)
    read = errors.drawn(np.linspace(0.0, 50.0, rate.size), rate, random)
    steps = np.diff(read) / errors.steps.count
    assert np.allclose(steps, np.round(steps), atol=1e-6)
    expected = np.sqrt(2e-3**2 + 1e-3**2 / 12 + (1e-4 * 10.0) ** 2)
    assert np.std(read - np.linspace(0.0, 50.0, rate.size)) == pytest.approx(expected, rel=0.02)


@pytest.mark.long
def test_simulated_torque_is_as_rough_as_the_readings_whatever_made_them_so() -> None:
    """What is rough about the torque itself, simulated as well, is not taken for noise of the sensor and added once
    more: the variance would be 1.8 times as great here."""
    measured = synthetic.experiment(4, bench=synthetic.Bench(noise_nm=1e-5, stiffness=1000.0), free=False)
    stretches = signals(measured, TICK_S, Use.IDENTIFY)
    bench = Simulation.of(Readings(measured, TICK_S, Use.IDENTIFY), stretches, solve(stretches))
    simulated = np.asarray(bench.record(np.random.default_rng(1)).torque["torque_nm"], dtype=np.float64)
    seen = ReadingErrors.of(bench.torque, NO_STEPS).noise
    # Medians of some 300 blocks tell each variance to 2 %, and three of them are compared.
    assert ReadingErrors.of(replace(bench.torque, value=simulated), NO_STEPS).noise == pytest.approx(seen, rel=0.06)


@pytest.mark.long
@pytest.mark.parametrize("bench", [synthetic.Bench(counts=2.0**14, can_jitter_s=150e-6, noise_nm=3e-4)])
def test_simulated_records_leave_what_the_real_one_leaves(bench: synthetic.Bench) -> None:
    """What encoder and commands do to the torque is not simulated once more as errors of its readings."""
    measured = synthetic.experiment(4, bench=bench, free=False)
    stretches = signals(measured, TICK_S, Use.IDENTIFY)
    solution = solve(stretches)
    simulated = Simulation.of(Readings(measured, TICK_S, Use.IDENTIFY, draws=6), stretches, solution)
    left = scatter_of(simulated, physical(solution)[0], physical).left
    assert np.mean(left) == pytest.approx(1.0, abs=0.15)
    assert simulated.torque_errors.noise == pytest.approx(bench.noise_nm, rel=0.25)


# A stiff contact with fine encoders and a quiet sensor: readings at 1 kHz do not show how fast this shaft turns round.
STIFF = synthetic.Truth(0.9, 1186.0, 3.63e-5, 3.2e-4, 9e-3, 50.0, 0.031)
FINE_BENCH = synthetic.Bench(
    load=synthetic.Truth(0.72, 1000.0, 1.88e-4, 4.9e-4, 15.7e-3, 32.0, 0.017),
    stiffness=138.0,
    noise_nm=3e-4,
    counts=2.0**20,
    cogging_nm=0.0,
    can_jitter_s=40e-6,
)


@pytest.mark.long
def test_what_the_shaft_does_between_readings_is_no_damping() -> None:
    """Friction along a path that is cut short at turns is late; taken for damping, that is 5 to 8 deviations here."""
    measured = synthetic.experiment(2, STIFF, FINE_BENCH, free=False, blocked=False)
    estimates = fit(measured, command_unit="N*m", tick_s=TICK_S).estimates
    damping = next(each for each in estimates if each.name == "presliding_damping")
    assert damping.status is Status.VALID
    assert damping.std < 0.02 * damping.value
    assert abs(damping.value - STIFF.presliding_damping) < 2.5 * damping.std


@pytest.mark.long
def test_commands_do_not_travel_like_readings_of_an_adapter_that_stood_still() -> None:
    """For 18 ms every 5 s: its readings come all at once then."""
    measured = synthetic.experiment(4, free=False, blocked=False)
    motion = measured.motion.copy()
    for first in range(2000, len(motion) - 18, 5000):
        motion["arrival_ns"][first : first + 18] = motion["arrival_ns"][first + 18]
    stretches = signals(measured, TICK_S, Use.IDENTIFY)
    usual, held_up = (
        Simulation.of(Readings(record, TICK_S, Use.IDENTIFY), stretches, solve(stretches)).travel_s
        for record in (measured, replace(measured, motion=motion))
    )
    assert np.std(held_up) == pytest.approx(np.std(usual), rel=0.1)


# Damping of the contact holds this light shaft more than its inertia does, up to 800 Hz.
DAMPED = synthetic.Truth(0.9, 150.0, 1e-5, 3.4e-3, 6.8e-2, 4.4, 0.05)
COARSE_BENCH = synthetic.Bench(counts=2.0**14)


@pytest.mark.long
@pytest.mark.parametrize(
    ("truth", "bench_read"), [(synthetic.Truth(), synthetic.Bench()), (DAMPED, COARSE_BENCH)], ids=["usual", "damped"]
)
def test_without_errors_of_readings_the_fit_gives_back_what_was_put_in(
    truth: synthetic.Truth, bench_read: synthetic.Bench
) -> None:
    """What is left is the fit's own numerics: far less than noise makes of it."""
    measured = synthetic.experiment(4, truth, bench_read, free=False)
    stretches = signals(measured, TICK_S, Use.IDENTIFY)
    solution = solve(stretches)
    values, covariance = physical(solution)
    bench = Simulation.of(Readings(measured, TICK_S, Use.IDENTIFY), stretches, solution)
    exact = replace(
        bench, encoder=replace(bench.encoder, errors=NO_ERRORS), torque_errors=NO_ERRORS, travel_s=np.zeros(1)
    )
    record = exact.record(np.random.default_rng(0))
    again = solve_again(signals(record, TICK_S, Use.IDENTIFY), solution)
    given = physical(again)[0]
    deviations = (given - values)[:7] / np.sqrt(np.diag(covariance))[:7]
    assert np.all(np.abs(deviations) < 0.5), dict(zip(PHYSICAL, deviations, strict=True))
    assert np.mean(again.innovation**2) < 0.01 * np.mean(solution.innovation**2)


@pytest.mark.long
def test_the_same_recording_gives_the_same_scatter_and_the_size_that_residuals_give() -> None:
    measured = synthetic.experiment(4, free=False, blocked=False)
    stretches = signals(measured, TICK_S, Use.IDENTIFY)
    solution = solve(stretches)
    values = physical(solution)[0]
    bench = Simulation.of(Readings(measured, TICK_S, Use.IDENTIFY, draws=6), stretches, solution)
    scatter = scatter_of(bench, values, physical)
    assert np.array_equal(scatter.drawn, scatter_of(bench, values, physical).drawn)
    # The torque gain is blurred by the torque's noise alone, which residuals show: six draws tell it to a third.
    raw = float(np.std(scatter.drawn[:, 0], ddof=1))
    assert 0.4 < raw / scatter.stated_std[0] < 2.0


def test_a_bias_is_taken_off_and_what_simulation_does_not_explain_is_added() -> None:
    draws = np.array([[1.1, 10.0], [1.3, 10.4], [1.2, 9.6], [1.2, 10.0]])
    stated = np.outer([0.9, 1.1, 1.0, 1.0], [0.05**2, 0.1**2])
    scatter = Scatter(draws, put_in=np.array([1.0, 10.0]), stated=stated, left=np.ones(len(draws)))
    values, covariance = scatter.applied(np.array([1.0, 10.0]), np.diag([0.05**2, 0.5**2]))
    assert values == pytest.approx([0.8, 10.0])
    first, second = moderated_std_of_next(draws, scatter.stated_std)
    chance = np.var(draws[:, 0], ddof=1) / 4
    more = 0.5**2 - 0.1**2
    by_chance = np.var(stated[:, 1], ddof=1) * 1.25 / more
    expected = [first**2 + (0.2**2 - chance) / 3, second**2 + more - by_chance]
    assert np.diag(covariance) == pytest.approx(expected)


@pytest.mark.parametrize(("wrong", "coverage"), [(1.0, 0.95), (1.5, 0.93), (3.0, 0.93)])
def test_intervals_hold_as_often_as_they_say_where_the_bench_is_as_simulated_and_nearly_where_it_is_not(
    wrong: float, coverage: float
) -> None:
    """Seven parameters with a deviation of 1, or ``wrong`` on the real bench, of which a fit states the variance with
    20 degrees of freedom. 1500 experiments tell the coverage to 0.3 %."""
    random, held = np.random.default_rng(4), []
    for _ in range(1500):
        drawn, stated = random.standard_normal((12, 7)), random.chisquare(20, (12, 7)) / 20
        own = wrong**2 * random.chisquare(20, 7) / 20
        values, covariance = Scatter(drawn, np.zeros(7), stated, np.ones(12)).applied(
            100.0 + wrong * random.standard_normal(7), np.diag(own)
        )
        held.append(np.abs(values - 100.0) < 1.96 * np.sqrt(np.diag(covariance)))
    assert coverage - 0.01 < np.mean(held) < 0.975


def test_a_bias_as_large_as_the_value_is_not_taken_off_but_leaves_nothing_known() -> None:
    drawn = np.array([[3.0], [3.1], [2.9]])
    scatter = Scatter(drawn, put_in=np.array([1.0]), stated=np.full((3, 1), 0.01), left=np.ones(3))
    values, covariance = scatter.applied(np.array([1.0]), np.array([[0.01]]))
    assert values == pytest.approx([1.0])
    assert covariance[0, 0] > 1.0


def test_two_inertias_on_a_spring_answer_as_their_equations_do() -> None:
    inertia, load, stiffness, damping = 5e-5, 1.2e-4, 200.0, 0.01
    none = np.empty(0)
    coupling = Coupling(stiffness, 2.0, damping, 0.0, load, 1.0, 1000.0, 0.0, none, none)
    # States: twist and its rate; input: the difference of the accelerations that drive the two ends.
    mobility = 1 / inertia + 1 / load
    dynamics = np.array([[0.0, 1.0], [-stiffness * mobility, -damping * mobility]])
    frequency_hz = np.array([10.0, 380.0, 850.0, 1500.0])
    s = 2j * np.pi * frequency_hz[:, None, None]
    states = np.linalg.solve(s * np.eye(2) - dynamics, np.broadcast_to([[0.0], [1.0]], (4, 2, 1)))
    expected = (np.array([stiffness, damping]) @ states)[:, 0]
    assert coupling.response(frequency_hz, inertia) == pytest.approx(expected, rel=1e-9)
    bare = replace(coupling, damping_nms_rad=-0.01)
    least = least_damping_nms_rad(stiffness, mobility)
    assert least == pytest.approx(2 * LEAST_DAMPING_RATIO * np.sqrt(stiffness / mobility))
    assert bare.response(frequency_hz, inertia) == pytest.approx(
        replace(coupling, damping_nms_rad=least).response(frequency_hz, inertia)
    )


def test_springs_are_drawn_as_uncertain_as_the_calibration_left_them() -> None:
    none, random = np.empty(0), np.random.default_rng(1)
    coupling = Coupling(1000.0, 20.0, 0.01, 0.004, 1e-4, 1.0, 1000.0, 0.0, none, none)
    drawn = [coupling.drawn(random) for _ in range(2000)]
    # 2000 draws tell a deviation to 1.6 %.
    assert np.std([each.stiffness_nm_rad for each in drawn]) == pytest.approx(20.0, rel=0.06)
    assert np.std([each.damping_nms_rad for each in drawn]) == pytest.approx(0.004, rel=0.06)
