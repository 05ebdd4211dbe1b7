"""What may stand in an equation of motion beside friction, as linear columns: cogging, slow drift, temperature.

Every column has the sign of what it takes off the exertion, and is on the path's own rate.
"""

import numpy as np

from norton_bench.arrays import FloatArray


def cogging(position: FloatArray, period: float) -> dict[str, FloatArray]:
    """Exertion that repeats with the position, every ``period`` rad or m; arrays (n,)."""
    phase = 2 * np.pi * position / period
    return {"cogging_sine": -np.sin(phase), "cogging_cosine": -np.cos(phase)}


def drift(time_s: FloatArray, spacing_s: float) -> dict[str, FloatArray]:
    """The offset as a broken line of time (n,) with a knot about every ``spacing_s``.

    What the line does in a held-out fold it learns from the rows around, so folds must be shorter than the spacing.
    """
    span_s = float(np.ptp(time_s))
    lines = hats(time_s, max(2, round(span_s / spacing_s) + 1))
    return {f"offset_{knot}": -hat for knot, hat in enumerate(lines, 1)}


def hats(time_s: FloatArray, knots: int) -> FloatArray:
    """Lines that are one at one of equally spaced knots and zero at all others, shape (knots, n)."""
    at_s = np.linspace(np.min(time_s), np.max(time_s), knots)
    return np.stack([np.interp(time_s, at_s, one) for one in np.eye(knots)])


def temperature(velocity: FloatArray, temperature_c: FloatArray) -> dict[str, FloatArray]:
    """What a degree more than the mean adds to friction, viscous and Coulomb: oil thins as it warms; arrays (n,)."""
    warmer = temperature_c - np.mean(temperature_c)
    return {
        "viscous_damping_per_degree": -velocity * warmer,
        "coulomb_torque_per_degree": -np.sign(velocity) * warmer,
    }
