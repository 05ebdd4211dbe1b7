"""Rows hold what is seen of a motion: coarse encoders at any rate give back the machine that made the log."""

from pathlib import Path

import numpy as np
import pytest
from numba import njit

from norton_bench.logs.equation import make_problem
from norton_bench.logs.grid import stretches
from norton_bench.logs.log import read_log
from norton_bench.logs.readings import Readings
from norton_bench.models.parameters import Status
from tests.bench.logs.machines import FREE, Columns, Machine, column_map, estimate, fit_of, write_csv

RATE_HZ = 500.0
BEHIND_SENSOR = """
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "q", unit = "rad" }
command = { name = "i", unit = "A" }
exertion = { name = "tau", unit = "N*m" }
"""
TRUE = {"torque_gain": 1.2, "inertia": 0.06, "viscous_damping": 0.15, "coulomb_torque": 0.3}


def readings_of(folder: Path, position: np.ndarray, text: str = FREE) -> Readings:
    t = np.arange(position.size) / RATE_HZ
    log = read_log(write_csv(folder / "log.csv", {"t": t, "q": position, "u": np.sin(t)}), column_map(text))
    (part,), _ = stretches(log, 1 / RATE_HZ, None)
    every = np.ones(t.size, dtype=bool)
    return Readings.of(column_map(text), (part,), [(every, ~every)])


def wandering(seed: int, corner_hz: float, seconds: float = 40.0) -> np.ndarray:
    """A motion of 0.3 rad rms that falls with the fourth power of the frequency from the corner on."""
    rng = np.random.default_rng(seed)
    hertz = np.fft.rfftfreq(int(seconds * RATE_HZ), 1 / RATE_HZ)
    spectrum = np.fft.rfft(rng.standard_normal(int(seconds * RATE_HZ))) / (1 + (hertz / corner_hz) ** 4)
    motion = np.fft.irfft(spectrum)
    return np.asarray(0.3 * motion / np.std(motion))


@pytest.mark.parametrize("noise_rad", [1e-3, 1e-4])
def test_rows_end_where_the_motion_sinks_into_its_noise(tmp_path: Path, noise_rad: float) -> None:
    motion = wandering(1, 1.0)
    noise = noise_rad * np.random.default_rng(2).standard_normal(motion.size)
    readings = readings_of(tmp_path, motion + noise)
    # White noise of the same length has the density noise²; that of the motion falls from its plateau.
    hertz = np.linspace(0.1, 100, 10_000)
    plateau = 0.3 / np.sqrt(np.sum(1 / (1 + np.fft.rfftfreq(motion.size, 1 / RATE_HZ) ** 4) ** 2) * 2 / motion.size)
    twice = hertz[np.argmax(plateau / (1 + hertz**4) < 2 * noise_rad)]
    assert readings.fastest_hz == pytest.approx(twice, rel=0.15)
    assert 1 / (readings.filters.dt_s * readings.filters.factor) == pytest.approx(2.5 * twice, rel=0.2)


def test_a_clean_motion_and_a_map_that_says_the_rate_have_the_usual_rows(tmp_path: Path) -> None:
    assert readings_of(tmp_path, wandering(1, 1.0) + 1e-9 * np.arange(20_000) ** 0.5).filters.factor == 5
    text = f'{FREE}[filter]\nrate = "50 Hz"\n'
    coarse = np.round(wandering(1, 1.0) / 1e-3) * 1e-3
    assert readings_of(tmp_path, coarse, text).filters.factor == 10
    assert readings_of(tmp_path, coarse).filters.factor > 20


def test_no_acceleration_no_limit(tmp_path: Path) -> None:
    """Friction alone needs no second derivative."""
    coarse = np.round(wandering(1, 1.0) / 1e-3) * 1e-3
    text = FREE.replace("[model]", "[model]\ninertia = false")
    assert readings_of(tmp_path, coarse, text).filters.factor == 5


@pytest.mark.parametrize("count_rad", [2 * np.pi / 2**12, 2 * np.pi / 2**16])
def test_the_noise_of_the_acceleration_is_that_of_the_counts(tmp_path: Path, count_rad: float) -> None:
    """Slower than a count in a sample for much of the time, so that it is not white."""
    motion = wandering(3, 0.5)
    exact, read = (readings_of(tmp_path, each) for each in (motion, np.round(motion / count_rad) * count_rad))
    problem = make_problem(column_map(FREE), read)
    same = make_problem(column_map(FREE), Readings(exact.stretches, exact.splits, read.filters))
    error = problem.equation.others[0] - same.equation.others[0]
    assert problem.equation.names[0] == "inertia"
    assert np.mean(problem.equation.noise["inertia"]) == pytest.approx(np.mean(error**2), rel=0.25)


@njit(cache=True)
def moved(goal: np.ndarray, every: int, step_s: float, gravity: float, motor: tuple) -> np.ndarray:
    """Position and current (2, n) at the steps, of a motor that follows ``goal`` (n,)."""
    gain, inertia, viscous, coulomb = motor
    slower = 1 + step_s * viscous / inertia
    most = step_s * coulomb / inertia / slower
    q, v, held, log = 0.0, 0.0, 0.0, np.empty((2, goal.size))
    for k in range(goal.size):
        if k % every == 0:
            held = 15.0 * (goal[k] - q) - 1.0 * v
        free = (v + step_s * (gain * held - gravity * np.sin(q)) / inertia) / slower
        v = np.sign(free) * max(abs(free) - most, 0.0)
        q += step_s * v
        log[0, k], log[1, k] = q, held
    return log


def behind_sensor(seed: int, rate_hz: int, bits: int, late_s: tuple[float, float], gravity: float) -> Columns:
    """A motor in a loop of position drives a pendulum through a sensor; friction stops it and holds it (Moreau)."""
    rng = np.random.default_rng(seed)
    step_s, seconds = 1e-4, 20.0
    wave, reach, phase = np.array([0.9, 2.4, 5.9, 13.0]), np.array([0.8, 0.4, 0.2, 0.08]), rng.uniform(0, 6, 4)
    time_s = np.arange(int(seconds / step_s)) * step_s
    goal, every = reach @ np.sin(np.outer(wave, time_s) + phase[:, None]), round(1 / rate_hz / step_s)
    log = moved(goal, every, step_s, gravity, tuple(TRUE.values()))
    count = int((seconds - 0.1) * rate_hz)
    at = 0.05 + (np.arange(count) + 0.5) / rate_hz
    position, before = (np.interp(at - late, time_s, log[0]) for late in (0.0, late_s[1]))
    turn = 2 * np.pi / 2**bits
    return {
        "t": at,
        "q": np.round(position / turn) * turn,
        "i": log[1][((at - late_s[0]) / step_s).astype(int)] + 0.01 * rng.standard_normal(count),
        "tau": gravity * np.sin(before) + 0.005 * rng.standard_normal(count),
    }


@pytest.mark.long
@pytest.mark.parametrize(
    ("rate_hz", "bits", "late_s", "gravity"),
    [
        (1000, 12, (0.002, 0.006), 1.0),
        (500, 12, (0.0, 0.006), 0.6),
        (200, 14, (0.0, 0.0), 2.0),
        (100, 17, (0.0, 0.008), 1.0),
    ],
)
def test_coarse_encoders_and_late_sensors_give_the_machine(
    tmp_path: Path, rate_hz: int, bits: int, late_s: tuple[float, float], gravity: float
) -> None:
    fit = fit_of(tmp_path, behind_sensor(1, rate_hz, bits, late_s, gravity), BEHIND_SENSOR)
    assert fit.model == "coulomb-viscous"
    assert not fit.doubtful
    for name, true in TRUE.items():
        found = estimate(fit, name)
        assert abs(found.value - true) < 4 * found.std
        if name != "viscous_damping":
            # Gravity of small swings moved in time looks like damping.
            assert found.status is Status.VALID
            assert found.value == pytest.approx(true, rel=0.02)
    late = estimate(fit, "exertion_shift")
    assert abs(late.value + late_s[1]) < 4 * late.std
    assert late.std < 5e-3


@pytest.mark.parametrize("late_s", [0.002, -0.003])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_late_command_of_an_uneven_log_with_coarse_counts(tmp_path: Path, late_s: float, seed: int) -> None:
    """What noise does to the slopes with the delay would make it shorter, and the inertia smaller by so much."""
    machine = Machine(inertia=0.03, damping=0.15, coulomb=0.3, offset=0.0, rate_hz=200.0, duration_s=40.0, seed=seed)
    rng = np.random.default_rng(seed)
    t = np.arange(8000) / 200.0
    t += rng.uniform(-0.001, 0.001, t.size)
    count_rad = 2 * np.pi / 2**15
    current = machine.needed(t - late_s) / machine.gain
    log = {
        "t": t,
        "q": np.round(machine.motion(t)[0] / count_rad) * count_rad,
        "u": current + 0.005 * np.std(current) * rng.standard_normal(t.size),
    }
    fit = fit_of(tmp_path, log, FREE)
    true = {"inertia": 0.03, "viscous_damping": 0.15, "coulomb_torque": 0.3, "command_shift": -late_s}
    for name, value in true.items():
        each = estimate(fit, name)
        assert abs(each.value - value) < 3.5 * each.std, (name, each, value)
    assert estimate(fit, "command_shift").std < 4e-4


def test_noise_of_an_uneven_log_is_that_of_its_readings(tmp_path: Path) -> None:
    """A spline through them takes most of it off halfway between two."""
    rng = np.random.default_rng(3)
    t = np.arange(20_000) / RATE_HZ
    motion = wandering(4, 1.0) + 1e-3 * rng.standard_normal(t.size)
    # Stamps that slide through the grid, by half of a sample in all.
    stamps = t + 0.5 / RATE_HZ * t / t[-1] + rng.uniform(-2e-4, 2e-4, t.size)
    log = read_log(write_csv(tmp_path / "log.csv", {"t": stamps, "q": motion, "u": np.sin(t)}), column_map(FREE))
    (part,), _ = stretches(log, 1 / RATE_HZ, None)
    every = np.ones(part.time_s.size, dtype=bool)
    readings = Readings.of(column_map(FREE), (part,), [(every, ~every)])
    assert part.logged_s is not None
    assert readings.white_noise("position") == pytest.approx(1e-3, rel=0.05)
