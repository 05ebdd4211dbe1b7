"""What the guard leans on, read from made-up measurements."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.guard.check import amperes_per_command, still_swing_nm, torque_readings
from norton_bench.records import CURRENT, MOTION, NO_DEVICE_TIME, TICK, TORQUE, Measured

TICK_NS = 1_000_000


def torque(values: np.ndarray, period_ns: int = TICK_NS, valid: np.ndarray | None = None) -> Measured:
    table = np.zeros(len(values), TORQUE)
    table["arrival_ns"] = 10**9 + np.arange(len(values)) * period_ns
    table["device_ns"] = NO_DEVICE_TIME
    table["torque_nm"] = values
    table["valid"] = True if valid is None else valid
    return Measured(torque=table)


def test_habits_of_a_noisy_sensor() -> None:
    values = np.random.default_rng(1).normal(0.003, 0.001, 2000)
    shaken = np.array([0.0, 0.1, 0.15, 0.05, 0.06])
    found = torque_readings(torque(values), torque(shaken))
    assert found is not None
    assert found.bias_nm == pytest.approx(0.003, abs=1e-4)
    assert found.noise_nm == pytest.approx(0.001, rel=0.1)
    assert (found.period_s, found.longest_repeat) == (pytest.approx(1e-3), 1)
    assert found.greatest_step_nm == pytest.approx(0.1)


def readings(noise: float, middle: float, count: int = 2000, seed: int = 3) -> np.ndarray:
    """Of a sensor with steps of 1 N m, whose noise is given in steps."""
    return np.round(middle + noise * np.random.default_rng(seed).normal(size=count))


def longest_run(values: np.ndarray) -> int:
    changes = np.flatnonzero(np.diff(values))
    return int(np.max(np.diff(np.concatenate([[-1], changes, [len(values) - 1]]))))


@pytest.mark.parametrize("noise", [0.35, 0.45, 0.7, 1.5])
@pytest.mark.parametrize("middle", [0.0, 0.25, 0.5])
def test_the_longest_run_of_equal_readings_does_not_depend_on_where_the_torque_was(noise: float, middle: float) -> None:
    """At rest between two steps readings change all the time; in the middle of one they do not."""
    found = torque_readings(torque(readings(noise, middle)), None)
    assert found is not None
    assert found.longest_repeat is not None
    assert found.greatest_step_nm is None
    unlucky = max(longest_run(readings(noise, 0.0, 200_000, seed)) for seed in range(5))
    assert unlucky / 5 < found.longest_repeat < 2.5 * unlucky


@pytest.mark.parametrize("values", [[1, 2], [5, 5, 5, 5, 5], [1] * 50 + [2] + [1] * 50])
def test_a_sensor_coarser_than_its_noise_may_stand_still_for_ever(values: list[float]) -> None:
    found = torque_readings(torque(np.array(values, float)), None)
    assert found is not None
    assert found.longest_repeat is None


@pytest.mark.parametrize("off", [2.0, 5.0, 1000.0])
def test_a_knock_in_the_tare_is_no_noise(off: float) -> None:
    values = readings(0.05, 0.5)
    values[700:702] += off
    found = torque_readings(torque(values), None)
    assert found is not None
    assert found.longest_repeat is None


@pytest.mark.parametrize("middle", [0.0, 0.5])
def test_a_sensor_that_sends_each_value_ten_times_repeats_itself_ten_times_as_long(middle: float) -> None:
    found = torque_readings(torque(np.repeat(readings(0.6, middle), 10)), None)
    assert found is not None
    assert found.longest_repeat is not None
    unlucky = max(longest_run(np.repeat(readings(0.6, 0.0, 20_000, seed), 10)) for seed in range(5))
    assert unlucky / 5 < found.longest_repeat < 2.5 * unlucky


@pytest.mark.parametrize("middle", [0.0, 0.3, 0.5])
def test_a_torque_between_two_steps_shows_changes_and_no_noise(middle: float) -> None:
    """Readings that take either value half of the time deviate by half a step, however little the noise."""
    found = torque_readings(torque(readings(0.1, middle)), None)
    assert found is not None
    assert found.longest_repeat is None


def test_readings_that_are_invalid_or_apart_are_no_neighbours() -> None:
    rest = torque(np.random.default_rng(2).normal(size=100))
    shaken = torque(np.array([0.0, 9.0, 0.1, 0.2, 5.0]), valid=np.array([True, False, True, True, True]))
    shaken.torque["arrival_ns"][4:] += 5 * TICK_NS
    found = torque_readings(rest, shaken)
    assert found is not None
    assert found.greatest_step_nm == pytest.approx(0.1)


def test_without_readings_there_are_no_habits() -> None:
    assert torque_readings(Measured(), None) is None
    found = torque_readings(torque(np.arange(5.0)), Measured())
    assert found is not None
    assert found.greatest_step_nm is None


def encoder(positions: list[float]) -> np.ndarray:
    table = np.zeros(len(positions), MOTION)
    table["arrival_ns"] = 10**9 + np.arange(len(positions)) * TICK_NS
    table["position_rad"] = positions
    return table


@pytest.mark.parametrize(
    ("positions", "swing_nm"),
    [
        ([0, 0, 0, 1, 1, 1], 0.3),
        ([0, 1, 2, 3, 4, 5], 0.0),
        ([7, 7, 7, 7, 7, 7], 0.8),
        ([0, 1, 1, 1, 1, 2], 0.5),
        ([], 0.0),
    ],
)
def test_how_far_the_torque_swings_while_the_encoder_stands(positions: list[float], swing_nm: float) -> None:
    measured = replace(torque(np.array([0.0, 0.1, 0.2, 0.5, 0.6, 0.8])), motion=encoder(positions))
    assert still_swing_nm(measured) == pytest.approx(swing_nm)


def test_readings_that_are_invalid_swing_nothing() -> None:
    shaken = torque(np.array([0.0, 9.0, 0.1]), valid=np.array([True, False, True]))
    assert still_swing_nm(replace(shaken, motion=encoder([0, 0, 0]))) == pytest.approx(0.1)
    assert still_swing_nm(Measured(motion=encoder([0, 0, 0]))) == 0.0


def test_motion_that_outlasts_the_torque_is_left_alone() -> None:
    measured = replace(torque(np.array([0.0, 0.2])), motion=encoder([0, 0, 1, 2, 3]))
    assert still_swing_nm(measured) == pytest.approx(0.2)


def pushed(amperes: float, noise_a: float, *, readings: int = 300, command: np.ndarray | None = None) -> tuple:
    ticks = np.zeros(3000, TICK)
    ticks["tick_ns"] = 10**9 + np.arange(3000) * TICK_NS
    ticks["command"] = np.linspace(0, 0.05, 3000) if command is None else command
    current = np.zeros(readings, CURRENT)
    current["arrival_ns"] = 10**9 + np.arange(readings) * 10 * TICK_NS
    acting = ticks["command"][np.arange(readings) * 10]
    current["current_a"] = amperes * acting + 0.1 + np.random.default_rng(3).normal(0, noise_a, readings)
    return ticks, current


@pytest.mark.parametrize("amperes", [18.0, -3.0])
def test_the_slope_of_current_over_command(amperes: float) -> None:
    ticks, current = pushed(amperes, 0.01)
    assert amperes_per_command(ticks, "command", current) == pytest.approx(amperes, rel=0.02)


@pytest.mark.parametrize(
    ("ticks", "current"),
    [
        pushed(18.0, 0.01, readings=2),
        (np.zeros(0, TICK), pushed(18.0, 0.01)[1]),
        pushed(0.0, 0.01),
        pushed(18.0, 50.0),
        pushed(18.0, 0.01, command=np.zeros(3000)),
    ],
)
def test_a_slope_that_cannot_be_seen_is_none(ticks: np.ndarray, current: np.ndarray) -> None:
    assert amperes_per_command(ticks, "command", current) is None
