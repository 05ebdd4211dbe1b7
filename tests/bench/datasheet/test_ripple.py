"""Lines by angle: found with the right size and interval, and none where there is nothing."""

import numpy as np
import pytest

from norton_bench.datasheet.ripple import OrderWave, Samples, folded, orders
from norton_bench.identification.residual_tests import looked_at

COUNT, TICK_S = 60_000, 1e-3
INERTIA_KGM2, DAMPING_NMS_RAD = 5e-5, 1e-3


def samples(
    seed: int, cogging_nm: float = 0.0, ripple: float = 0.0, error_rad: float = 0.0, periods: float = 42.0
) -> Samples:
    """A shaft that wanders, under a torque that swings, with noise that remembers itself for ten samples."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(COUNT) * TICK_S
    velocity = 5.0 * np.sin(1.3 * time_s) + 3.0 * np.sin(0.31 * time_s + seed)
    position = np.cumsum(velocity) * TICK_S
    drive = 0.05 * np.sin(2.9 * time_s)
    white = rng.standard_normal(COUNT + 9)
    noise = 1e-3 * np.convolve(white, np.ones(10) / np.sqrt(10), mode="valid")
    wave = np.cos(periods * position + 0.7)
    error = INERTIA_KGM2 * np.gradient(np.gradient(wave, TICK_S), TICK_S) + DAMPING_NMS_RAD * np.gradient(wave, TICK_S)
    residual = cogging_nm * wave + ripple * drive * np.sin(periods * position) + error_rad * error + noise
    return Samples(time_s, position, velocity, drive, residual, TICK_S)


def lines(of: Samples, *periods: float) -> dict[float, OrderWave]:
    """Derivatives along the motion, as the equation has them: not those of the samples."""
    velocity = of.velocity_rad_s
    rate = np.gradient(velocity, TICK_S)
    told = {}
    for each in periods:
        wave = np.stack([np.cos(each * of.position_rad), np.sin(each * of.position_rad)])
        slope = each * np.stack([-wave[1], wave[0]])
        change = slope * velocity
        told[each] = OrderWave(
            wave, INERTIA_KGM2 * (slope * rate - (each * velocity) ** 2 * wave) + DAMPING_NMS_RAD * change
        )
    return told


def searched(of: Samples) -> float:
    """The order of the greatest line of all that are looked at, where there is none."""
    bins = ((of.position_rad - np.min(of.position_rad)) / (2 * np.pi) * 2048).astype(int)
    sums = np.bincount(bins, of.residual_nm)
    power = np.abs(np.fft.rfft(sums, 4 * sums.size))
    periods = np.arange(power.size) * 2048 / (4 * sums.size)
    return float(periods[np.argmax(np.where((periods >= 1.0) & (periods <= 400.0), power, 0.0))])


@pytest.mark.long
def test_the_interval_holds_the_amplitude() -> None:
    held = 0
    for seed in range(40):
        made = samples(seed, cogging_nm=5e-4)
        (order,) = orders(made, lines(made, 42.0))
        held += abs(order.cogging_nm.amplitude - 5e-4) <= order.cogging_nm.half_width
    # Binomial: of 40 with a chance of 95 % each, 33 or fewer come once in a thousand times.
    assert held >= 34


def test_ripple_goes_with_the_torque_and_cogging_does_not() -> None:
    made = samples(3, ripple=0.05)
    (order,) = orders(made, lines(made, 42.0))
    assert order.ripple.shows
    assert order.ripple.amplitude == pytest.approx(0.05, abs=2 * order.ripple.half_width)
    assert not order.cogging_nm.shows


def test_an_error_of_the_angle_is_no_cogging() -> None:
    """It grows with the square of the velocity; without columns of its own it would be told as a torque."""
    made = samples(2, error_rad=5e-4)
    (order,) = orders(made, lines(made, 42.0))
    assert not order.is_torque
    assert order.angle_error_rad.shows
    assert order.angle_error_rad.amplitude == pytest.approx(5e-4, abs=2 * order.angle_error_rad.half_width)


@pytest.mark.long
def test_where_nothing_stands_out_nothing_is_told() -> None:
    """Of 30 records without a line, in each of which the greatest of all lines was looked for."""
    assert looked_at(samples(1).position_rad) > 400
    told = sum(bool(orders(made, lines(made, searched(made)))) for made in map(samples, range(30)))
    # Binomial: of 30 with a chance of 1 % each, four or more come less than once in a thousand times.
    assert told < 4
    assert orders(samples(1), {}) == ()


def test_one_period_shows_the_wave() -> None:
    made = samples(1, cogging_nm=2e-3)
    found = folded(made, 42.0)
    wave = 2e-3 * np.cos(42.0 * found.angle_rad + 0.7)
    assert np.mean(np.abs(found.mean_nm - wave) <= 1.5 * found.half_width_nm) > 0.9
