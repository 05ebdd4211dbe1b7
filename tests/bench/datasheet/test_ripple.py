"""Lines by angle: found with the right size and interval, and none where there is nothing."""

import numpy as np
import pytest

from norton_bench.datasheet.ripple import Samples, folded, orders

COUNT, TICK_S = 20_000, 1e-3
CHANCE_OF_FAILING = 1e-3


def samples(seed: int, cogging_nm: float = 0.0, ripple: float = 0.0, periods: float = 42.0) -> Samples:
    """A shaft that wanders, under a torque that swings, with noise that remembers itself for ten samples."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(COUNT) * TICK_S
    velocity = 5.0 * np.sin(1.3 * time_s) + 3.0 * np.sin(0.31 * time_s + seed)
    position = np.cumsum(velocity) * TICK_S
    drive = 0.05 * np.sin(2.9 * time_s)
    white = rng.standard_normal(COUNT + 9)
    noise = 1e-3 * np.convolve(white, np.ones(10) / np.sqrt(10), mode="valid")
    residual = cogging_nm * np.cos(periods * position + 0.7) + ripple * drive * np.sin(periods * position) + noise
    return Samples(time_s, position, velocity, drive, residual, TICK_S)


def lines(of: Samples, *periods: float) -> dict[float, np.ndarray]:
    return {each: np.stack([np.cos(each * of.position_rad), np.sin(each * of.position_rad)]) for each in periods}


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


def test_where_nothing_stands_out_nothing_is_told() -> None:
    """Of 40 records without a line, each has two chances of 1 %: six or more come once in a thousand times."""
    told = sum(bool(orders(made, lines(made, 42.0))) for made in map(samples, range(40)))
    assert told < 6
    assert orders(samples(1), {}) == ()


def test_one_period_shows_the_wave() -> None:
    made = samples(1, cogging_nm=2e-3)
    found = folded(made, 42.0)
    wave = 2e-3 * np.cos(42.0 * found.angle_rad + 0.7)
    assert np.mean(np.abs(found.mean_nm - wave) <= 1.5 * found.half_width_nm) > 0.9
