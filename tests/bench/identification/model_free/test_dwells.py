"""Where a velocity settles: against made-up approaches with known ends."""

import numpy as np
import pytest

from norton_bench.identification.branches import PIECES, pieces_of, settled

SPAN_S, TICK_S, LEVELS = 0.3, 1e-3, np.linspace(-50.0, 50.0, 11)


def dwells(seed, settling_s, noise, wander):
    """Velocities in pieces: an exponential approach, and a first-order wander with the same time constant."""
    rng = np.random.default_rng(seed)
    count = round(SPAN_S / TICK_S)
    time_s = np.arange(count) * TICK_S
    pieces = []
    for level in LEVELS:
        velocity = level + noise * rng.normal(size=count)
        if settling_s:
            kept, state = np.exp(-TICK_S / settling_s), wander * rng.normal()
            for k in range(count):
                state = kept * state + wander * np.sqrt(1 - kept**2) * rng.normal()
                velocity[k] += state + 2.0 * np.exp(-(time_s[k] + 0.1) / settling_s)
        pieces.append(pieces_of(time_s, np.cumsum(velocity) * TICK_S))
    return settled(np.array(pieces), np.full(LEVELS.size, SPAN_S))


def test_pieces_are_slopes():
    time_s = np.arange(320) * TICK_S
    np.testing.assert_allclose(pieces_of(time_s, 7.0 * time_s + 100.0), np.full(PIECES, 7.0), rtol=1e-9)


@pytest.mark.parametrize(("settling_s", "noise", "wander"), [(0.0, 0.3, 0.0), (0.05, 0.01, 0.2)])
def test_intervals_cover_the_end_that_was_approached(settling_s, noise, wander):
    inside = []
    for seed in range(40):
        found = dwells(seed, settling_s, noise, wander)
        low, high = np.quantile(found.resampled, [0.025, 0.975], axis=0)
        inside.append((low < LEVELS) & (high > LEVELS))
    assert 0.90 < np.mean(inside) < 0.99


def test_the_end_is_extrapolated_not_averaged():
    found = dwells(3, 0.06, 1e-3, 0.0)
    assert found.settling_s == pytest.approx(0.06, rel=0.15)
    np.testing.assert_allclose(found.velocity, LEVELS, atol=0.01)


def test_a_shaft_that_has_settled_is_not_said_to_settle():
    assert sum(dwells(seed, 0.0, 0.3, 0.0).settling_s > 0 for seed in range(40)) <= 4


def test_the_same_data_give_the_same_resamples():
    assert np.array_equal(dwells(1, 0.05, 0.1, 0.1).resampled, dwells(1, 0.05, 0.1, 0.1).resampled)
