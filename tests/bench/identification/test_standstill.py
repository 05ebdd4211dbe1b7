"""What stands still at the end of its range: a sensor that is saturated, or a shaft that came to rest there."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from norton_bench.identification.standstill import flat_tops

COUNT = 2 * np.pi / 2**17
RATE_HZ = 500.0


def counted(values: np.ndarray) -> np.ndarray:
    return np.round(values / COUNT) * COUNT


@given(st.floats(20.0, 300.0), st.floats(0.0, 1.0), st.integers(5, 50))
def test_a_shaft_that_brakes_and_sticks_is_not_saturated(braking_rad_s2, phase, rows):
    """Friction stops it with a constant deceleration, holds it, and lets it go the way it came."""
    away_s = np.abs(np.arange(-40, 40) + phase) / RATE_HZ - rows / RATE_HZ / 2
    values = counted(2.0 - 0.5 * braking_rad_s2 * np.maximum(away_s, 0.0) ** 2)
    assert np.count_nonzero(values == values.max()) >= 5
    assert flat_tops(values) == []


@given(st.floats(0.5, 0.9), st.floats(0.3, 3.0), st.floats(0.0, 6.0), st.sampled_from([100.0, 250.0, 500.0]))
def test_a_sine_that_is_cut_off_is_saturated(end, hertz, phase, rate_hz):
    time_s = np.arange(3000) / rate_hz
    values = counted(np.minimum(np.sin(2 * np.pi * hertz * time_s + phase), end))
    found = flat_tops(values)
    assert sum(length for _, length in found) > 0.6 * np.count_nonzero(values == values.max())
