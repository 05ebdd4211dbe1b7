"""Where a shaft sticks or turns, friction is no law of velocity: these rows count for less, values come out right."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.logs.equation import make_problem
from norton_bench.logs.grid import stretches
from norton_bench.logs.log import read_log
from norton_bench.logs.near_rest import NearRest, likeliest_excess, one_sided
from norton_bench.logs.readings import Readings
from tests.bench.logs.machines import FREE, Columns, Machine, column_map, estimate, fit_of, write_csv

TRUE = {"inertia": 0.02, "viscous_damping": 0.15, "coulomb_torque": 0.5}
GAIN, PULL = 1.5, 1.2
# A pendulum driven at 1.5 N·m/A; several laws to choose from.
STICKS = FREE.replace('"2 N*m/A"', '"1.5 N*m/A"\n[load]\ngravity = "1.2 N*m"').replace(
    '["coulomb-viscous"]', '["coulomb-viscous", "film", "stribeck", "dahl"]'
)


def sticking(seed: int, duration_s: float = 12.0, step_s: float = 1e-4) -> Columns:
    """A pendulum in a loop of position, with friction that stops it and holds it (Moreau's time stepping)."""
    rng = np.random.default_rng(seed)
    wave, reach, phase = np.array([1.1, 2.6, 6.1, 14.5]), np.array([1.2, 0.7, 0.35, 0.12]), rng.uniform(0, 6, 4)
    time_s = np.arange(int(duration_s / step_s)) * step_s
    goal = reach @ np.sin(wave[:, None] * time_s + phase[:, None])
    q, v, log = goal[0], 0.0, np.empty((2, time_s.size))
    for k, wished in enumerate(goal.tolist()):
        current = 18.0 * (wished - q) - 0.7 * v
        log[:, k] = q, current
        push = GAIN * current - PULL * np.sin(q) - TRUE["viscous_damping"] * v
        free, most = v + step_s * push / TRUE["inertia"], step_s * TRUE["coulomb_torque"] / TRUE["inertia"]
        v = float(np.sign(free) * max(abs(free) - most, 0.0))
        q += step_s * v
    every = slice(0, None, round(2e-3 / step_s))
    position, current = log[:, every]
    turn = 2 * np.pi / 2**17
    noise = 0.01 * rng.standard_normal(current.size)
    return {"t": time_s[every], "q": np.round(position / turn) * turn, "u": current + noise}


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_machine_that_sticks_gives_its_own_values_and_law(tmp_path: Path, seed: int) -> None:
    log = sticking(seed)
    resting = np.mean(np.diff(log["q"]) == 0.0)
    assert resting > 0.02
    fit = fit_of(tmp_path, log, STICKS, model="best")
    assert fit.model == "coulomb-viscous"
    for name, true in TRUE.items():
        found = estimate(fit, name)
        assert abs(found.value - true) < 4 * found.std
        assert found.value == pytest.approx(true, rel=0.01)
    assert any("Near rest" in said and "count for less" in said for said in fit.verdict)
    rows = fit.predictions
    assert rows is not None
    off = (rows.measured - rows.predicted) / rows.deviation
    near = rows.deviation > 2 * np.min(rows.deviation)
    for part in (near, ~near):
        assert 0.5 < np.sqrt(np.mean(off[part] ** 2)) < 2.0


def test_a_log_that_never_rests_has_no_such_rows(tmp_path: Path) -> None:
    machine = Machine(duration_s=6.0)
    log = machine.log()
    log["q"] = log["q"] + 20.0 * log["t"]
    speed = machine.motion(log["t"])[1] + 20.0
    log["u"] = log["u"] + (machine.damping * 20.0 + machine.coulomb * (1.0 - np.sign(speed - 20.0))) / machine.gain
    fit = fit_of(tmp_path, log)
    assert estimate(fit, "inertia").value == pytest.approx(machine.inertia, rel=0.02)
    assert not any("Near rest" in said for said in fit.verdict)


def test_a_test_at_rest_is_no_alarm(tmp_path: Path) -> None:
    """Friction holds what pulls at it, and no law of velocity says how strongly."""
    log = sticking(1)
    rest = {name: np.full(2000, values[-1]) for name, values in log.items()}
    rest["t"] = log["t"][-1] + 2e-3 * np.arange(1, 2001)
    rest["u"] = log["u"][-1] + 0.01 * np.random.default_rng(2).standard_normal(2000)
    rest["q"][::2] += 2 * np.pi / 2**17  # the count flickers
    fit = fit_of(tmp_path, {name: np.append(log[name], rest[name]) for name in log}, STICKS, test="12: s")
    assert fit.test.exertion is not None
    assert fit.test.exertion.rms > 3 * fit.predictions.deviation.min()
    assert not fit.alarms


def test_shares_are_of_the_rows_beside_turns(tmp_path: Path) -> None:
    time_s = np.arange(5000) / 500
    columns = {"t": time_s, "q": np.sin(2 * np.pi * 0.5 * time_s), "u": np.cos(time_s)}
    text = column_map(FREE)
    (part,), _ = stretches(read_log(write_csv(tmp_path / "log.csv", columns), text), 2e-3, None)
    problem = make_problem(text, Readings.of(text, (part,), [(np.ones(5000, dtype=bool), np.zeros(5000, dtype=bool))]))
    near = NearRest.of(problem)
    since_turn_s = (problem.equation.time_s - 0.5 + 0.5) % 1.0 - 0.5
    assert near.share[np.abs(since_turn_s) < 5e-3] == pytest.approx(1.0, abs=0.1)
    assert np.all(near.share[np.abs(since_turn_s) > 0.1] < 1e-3)
    path = near.weighted(100.0).equation.path
    # Of q = sin πt, what is left of half a wave without a period of the low-pass, ten milliseconds, at either end.
    later_s = np.linspace(0.01, 0.99, 1000)
    assert path.slowest == pytest.approx(np.quantile(np.pi * np.sin(np.pi * later_s), 0.05) / 3, rel=0.05)
    assert path.shortest == pytest.approx(np.quantile(1 - np.cos(np.pi * later_s), 0.05), rel=0.05)
    # A contact is seen where these rows are nearly as good as others.
    assert near.weighted(0.1).equation.path.shortest == 0.0


@pytest.mark.parametrize("excess", [0.0, 5.0, 300.0])
def test_the_excess_is_found_to_within_its_scatter(excess: float) -> None:
    rng = np.random.default_rng(int(excess))
    share = np.where(rng.random(6000) < 0.2, rng.random(6000), 0.0)
    residual = 0.3 * np.sqrt(1 + excess * share) * rng.standard_normal(6000)
    found = likeliest_excess(residual, share)
    # The logarithm of a variance of n values scatters by √(2/n).
    assert np.log1p(found) == pytest.approx(np.log1p(excess), abs=5 * np.sqrt(2 / 1200 + 2 / 4800))


def test_without_rows_near_rest_there_is_no_excess() -> None:
    assert likeliest_excess(np.random.default_rng(0).standard_normal(100), np.zeros(100)) == 0.0


@pytest.mark.parametrize(("excess", "rows"), [(5.0, 500), (30.0, 3000), (1e5, 20000)])
def test_errors_of_one_sign_near_rest_move_no_mean_by_much(excess: float, rows: int) -> None:
    rng = np.random.default_rng(rows)
    share = np.where(rng.random(rows) < 0.4, rng.random(rows) ** 4, 0.0)
    weight = one_sided(excess, share)
    assert excess <= weight <= rows * excess
    scale, error = 1 / (1 + weight * share), np.sqrt(excess * share)
    shift, deviation = np.sum(scale * error) / np.sum(scale), 1 / np.sqrt(np.sum(scale))
    assert shift < 0.8 * deviation  # of all rows' mean 0.5, and 0.65 where 0.6 of them are left
    assert np.sum(error / (1 + 0.8 * weight * share)) > 0.5 * np.sqrt(rows)  # no more than it takes


def test_few_rows_near_rest_have_the_weight_of_their_variance() -> None:
    share = np.zeros(10_000)
    share[:3] = 1.0
    assert one_sided(4.0, share) == 4.0
