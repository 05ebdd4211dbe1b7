"""Rows whitened by what counts leave unknown at every turn, against dense algebra and against chance."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.identification import loops
from norton_bench.identification.counts import NO_STEPS, Resolution
from norton_bench.identification.expansion import Excitation, planned_signals
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.separable import solve
from norton_bench.identification.signals import FINE, signals
from norton_bench.identification.turns import UNKNOWN_COUNTS, Turns, Whitening, is_new, strongest_period
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, Bench, Truth

ROWS = 4000
S_PER_RAD = 400.0
COUNT_RAD = 4.8e-5
NO_ROWS = np.empty(0, dtype=np.int64)
REACH_TICKS = 8.0


def back_and_forth(amplitude_rad: float = 0.004, frequency_hz: float = 7.0):
    """Of a shaft that swings, as planned signals."""
    time_s = np.arange(ROWS) * TICK_S
    position_rad = amplitude_rad * np.sin(2 * np.pi * frequency_hz * time_s)
    return planned_signals(Excitation(TICK_S, np.zeros(ROWS), position_rad), 0.0)


def made_residual(rng: np.random.Generator, turns: Turns, unknown_rad: float) -> np.ndarray:
    """White noise of deviation 1, and an error that every turn kicks and that fades with the way."""
    kept, kicks = np.exp(-S_PER_RAD * turns.way_rad), unknown_rad * np.sqrt(turns.kicks)
    error, state = np.empty(ROWS), 0.0
    for k in range(ROWS):
        state = kept[k] * state + kicks[k] * rng.standard_normal()
        error[k] = state
    return error + rng.standard_normal(ROWS)


def test_an_error_at_a_turn_leaves_what_two_paths_differ_by():
    """Two paths, one of which turned 2 µrad further on: what the friction differs by is what the kick predicts."""
    ways = np.concatenate([np.full(500, 1e-5), np.full(500, -1e-5)])
    later = ways.copy()
    later[500] += 2e-6
    there, beyond = (np.cumsum(each) for each in (ways, later))
    share, other = (loops.friction_path(path, S_PER_RAD, NO_ROWS)[0] for path in (there, beyond))
    fine = np.repeat(there, 4)
    turns = Turns.of(replace(back_and_forth(), path_rad=fine), S_PER_RAD, REACH_TICKS)
    at = 500 + int(np.argmax(turns.kicks[500:503]))
    assert turns.kicks[at] > 0.9 * np.sum(turns.kicks[490:510]), "one kick, at the turn"
    assert abs(other[502] - share[502]) == pytest.approx(2e-6 * np.sqrt(turns.kicks[at]), rel=0.1)


@given(st.integers(0, 10_000), st.integers(2, 30))
def test_the_innovations_are_those_of_the_whole_covariance(seed: int, rows: int):
    """Cholesky's factor of the covariance whitens as well, and in the same order."""
    rng = np.random.default_rng(seed)
    way, kicks = rng.uniform(0.0, 2.0 / S_PER_RAD, rows), rng.uniform(0.0, 9.0, rows) * (rng.random(rows) < 0.3)
    kept = np.exp(-S_PER_RAD * way)
    reach = np.array([[np.prod(kept[b + 1 : a + 1]) if a >= b else 0.0 for b in range(rows)] for a in range(rows)])
    covariance = np.eye(rows) + reach @ np.diag(kicks) @ reach.T
    values = rng.standard_normal((3, rows))
    expected = np.linalg.solve(np.linalg.cholesky(covariance), values.T).T
    found = Whitening.of_known(Turns(way, kicks, np.zeros(rows, dtype=bool)), NO_ROWS, S_PER_RAD, 1.0).of(values)
    # Equal to machine precision, row by row.
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("unknown_counts", [0.0, 0.35, 1.4])
def test_what_is_unknown_is_found_from_the_residual(unknown_counts: float):
    rng, turns = np.random.default_rng(3), Turns.of(back_and_forth(), S_PER_RAD, REACH_TICKS)
    width = 40.0  # of a count's friction, in deviations of the noise
    residual = made_residual(rng, turns, unknown_counts * width * COUNT_RAD)
    found = Whitening.likeliest(turns, NO_ROWS, S_PER_RAD, residual, width * COUNT_RAD)
    expected = Whitening.of_known(turns, NO_ROWS, S_PER_RAD, unknown_counts * width * COUNT_RAD)
    steps = [Whitening.of_known(turns, NO_ROWS, S_PER_RAD, each * width * COUNT_RAD).energy for each in UNKNOWN_COUNTS]
    # The neighbours of the true value in what is tried, at most.
    assert abs(steps.index(found.energy) - steps.index(expected.energy)) <= 1


def test_nothing_is_carried_over_a_rest():
    turns = Turns.of(back_and_forth(), S_PER_RAD, REACH_TICKS)
    again = np.array([0, ROWS // 2])
    whitening = Whitening.of_known(turns, again, S_PER_RAD, COUNT_RAD * 40.0)
    values = np.random.default_rng(1).standard_normal((1, ROWS))
    late = whitening.of(np.where(np.arange(ROWS) < ROWS // 2, 100.0, values))
    assert late[0, ROWS // 2 :] == pytest.approx(whitening.of(values)[0, ROWS // 2 :])


def test_near_a_turn_is_what_its_place_decides():
    """The contact slides within a thousandth seven presliding lengths after it; a filter sees it from either side."""
    signals = back_and_forth(amplitude_rad=0.2, frequency_hz=1.0)
    near, position_rad = Turns.of(signals, S_PER_RAD, REACH_TICKS).near, signals.position_rad[::FINE]
    turn = int(np.argmax(position_rad)) + 1  # the first tick on the way back
    assert near[turn - int(REACH_TICKS) + 1 : turn].all()
    assert not near[turn - int(REACH_TICKS) - 1]
    gone_rad = position_rad[turn] - position_rad[turn : turn + 250]
    first = int(np.argmax(gone_rad > 7.0 / S_PER_RAD))
    assert near[turn : turn + first].all()
    assert not near[turn + first + 1]
    hidden = Turns.of(replace(signals, counts=Resolution(0.01)), S_PER_RAD, REACH_TICKS).near[turn : turn + 250]
    assert int(np.argmin(hidden)) == int(np.argmax(gone_rad > 7.0 / S_PER_RAD + 3 * 0.01))


def test_rows_near_turns_count_for_as_much_as_they_are_known():
    rng, turns = np.random.default_rng(6), Turns.of(back_and_forth(0.2, 1.0), S_PER_RAD, REACH_TICKS)
    residual = rng.standard_normal(ROWS) * np.where(turns.near, 3.0, 1.0)
    plain = Whitening.of_known(turns, NO_ROWS, S_PER_RAD, 0.0)
    weighed = plain.weighed(turns.near, residual)
    # Of some 600 and 3400 rows the widths are known to 3 and 1 %.
    assert weighed.wider == pytest.approx(3.0, rel=0.1)
    assert np.std(weighed.of(residual[None, :])[0][turns.near]) == pytest.approx(1.0, rel=0.05)
    assert plain.weighed(turns.near, np.where(turns.near, 0.3, 1.0) * residual).wider == 1.0


@pytest.mark.long
def test_what_coarse_counts_hide_about_turns_does_not_reach_the_inertia():
    """Counts of 0.77 mrad, a contact that slides within 0.46: the rest of the motion tells the inertia."""
    truth = Truth(viscous_damping=4e-4, coulomb_torque=0.0146, presliding_stiffness=32.0, presliding_damping=0.0136)
    bench = Bench(counts=8192.0, noise_nm=0.4e-3, cogging_nm=0.0)
    errors = []
    for seed in range(3):
        measured = synthetic.experiment(seed=seed, truth=truth, bench=bench)
        inertia = fit(measured, command_unit="N*m", tick_s=TICK_S, draws=0).estimate("inertia")
        errors.append((inertia.value - truth.inertia) / inertia.std)
        assert inertia.std < 0.1e-2 * truth.inertia
    # All rows alike give 2.6, 2.0 and 2.3 deviations: the mean of three is known to 0.58.
    assert abs(np.mean(errors)) < 3 * 0.58


def test_rows_left_out_pass_on_what_lay_in_them():
    turns = Turns.of(back_and_forth(), S_PER_RAD, REACH_TICKS)
    some = np.sort(np.random.default_rng(2).choice(ROWS, 300, replace=False))
    picked = turns.at(some)
    assert np.sum(picked.way_rad) == pytest.approx(np.sum(turns.way_rad[some[0] + 1 : some[-1] + 1]))
    assert np.sum(picked.kicks) == pytest.approx(np.sum(turns.kicks[some[0] + 1 : some[-1] + 1]))


def test_least_squares_of_whitened_rows_errs_less():
    """What is wanted goes as the friction's own transients do, where errors at the turns hide it most."""
    rng, turns = np.random.default_rng(5), Turns.of(back_and_forth(), S_PER_RAD, REACH_TICKS)
    unknown_rad = 40.0 * COUNT_RAD
    column = np.exp(-S_PER_RAD * np.abs(np.cumsum(turns.way_rad) % 0.016))
    whitening = Whitening.of_known(turns, NO_ROWS, S_PER_RAD, unknown_rad)
    errors = []
    for _ in range(200):
        both = np.stack([column, made_residual(rng, turns, unknown_rad)])
        errors.append([x @ y / (x @ x) for x, y in (both, whitening.of(both))])
    plain, white = np.std(errors, axis=0)
    bound = 1.0 / np.linalg.norm(whitening.of(column[None, :]))
    assert white == pytest.approx(bound, rel=0.15)
    assert white < 0.9 * plain


def scattering(values: np.ndarray) -> float:
    """Of the means of a tenth of a second, over that of white noise."""
    means = np.mean(values[: values.size // 100 * 100].reshape(-1, 100), axis=1)
    return float(100 * np.var(means) / np.var(values))


def test_a_coarse_encoder_leaves_a_memory_that_the_innovations_have_not():
    measured = synthetic.experiment(4, bench=Bench(counts=2.0**14), blocked=False)
    solution = solve(signals(measured, TICK_S, Use.IDENTIFY))
    assert solution.converged
    assert scattering(solution.innovation) < 0.85 * scattering(solution.residual)


def test_without_counts_nothing_is_whitened():
    stretches = signals(synthetic.experiment(4, blocked=False), TICK_S, Use.IDENTIFY)
    solution = solve(tuple(replace(each, counts=NO_STEPS) for each in stretches))
    assert solution.regression.whitening is None
    assert solution.innovation == pytest.approx(solution.residual, abs=1e-12)


def swinging(reach_rad: float) -> np.ndarray:
    time_s = np.arange(20_000) * TICK_S
    return reach_rad * (0.7 * np.sin(2 * np.pi * 0.31 * time_s) + 0.3 * np.sin(2 * np.pi * 1.7 * time_s + 1.0))


@pytest.mark.parametrize(
    ("reach_rad", "periods", "expected"),
    [(30.0, 42, 42.0), (30.0, 1, 1.0), (1.0, 42, 42.0), (1.0, 15, 15.0), (1.0, 6, None)],
)
@pytest.mark.parametrize("seed", range(3))
def test_a_wave_is_found_that_returns_three_times_on_the_way(reach_rad, periods, expected, seed):
    """A servo goes to and fro within a third of a turn: two waves there may be what friction does at its ends."""
    angle = swinging(reach_rad)
    residual = 0.3 * np.cos(periods * angle + 0.4) + np.random.default_rng(seed).standard_normal(angle.size)
    assert strongest_period(angle, residual, 1.0) == expected


def near_turns(angle):
    """Weights of rows that deviate ten times as much where the shaft is slow."""
    return np.where(np.abs(np.gradient(angle)) < 0.2 * np.max(np.abs(np.gradient(angle))), 0.01, 1.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_wave_is_found_beside_errors_near_turns_where_those_count_less(seed):
    angle = swinging(30.0)
    weight = near_turns(angle)
    noise = np.random.default_rng(seed).standard_normal(angle.size) / np.sqrt(weight)
    residual = 0.15 * np.cos(23 * angle + 0.4) + noise
    assert strongest_period(angle, residual, 1.0) is None
    assert strongest_period(angle, residual, 1.0, weight) == 23.0


@pytest.mark.parametrize("reach_rad", [30.0, 1.0])
@pytest.mark.parametrize("weighted", [False, True])
def test_noise_alone_has_no_wave(reach_rad, weighted):
    rng = np.random.default_rng(0)
    angle = swinging(reach_rad)
    weight = near_turns(angle) if weighted else np.ones(angle.size)
    noise = (rng.standard_normal(angle.size) / np.sqrt(weight) for _ in range(200))
    assert {strongest_period(angle, each, 1.0, weight) for each in noise} == {None}


def test_a_wave_that_the_way_cannot_tell_from_a_known_one_is_not_new():
    """Twenty turns resolve a twentieth of a period a turn."""
    angle = np.linspace(0.0, 40 * np.pi, 100)
    assert not is_new(29.89, (29.9,), angle)
    assert is_new(29.89, (30.0,), angle)
    assert is_new(29.89, (), angle)


def test_a_shaft_that_stands_still_shows_no_wave():
    residual = np.random.default_rng(0).standard_normal(1000)
    assert strongest_period(np.full(1000, 0.3), residual, 1.0) is None
