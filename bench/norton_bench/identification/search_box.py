"""The box in which the unknowns that are not linear are searched, and steps in it."""

from collections.abc import Iterator

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.regression import Regression
from norton_bench.identification.shape import BANDWIDTH, COMMAND_DELAY, MOTION_DELAY, Shape
from norton_bench.models.terms import TermParameter, parameters_of

# Sides of the box.
BANDWIDTH_RAD_S = (20.0, 6000.0)
S_PER_RAD = (5.0, 5e4)
DELAY_TICKS = 8.0

# Of (log β, log s, d_c, d_m), as tangents; a step that is not better is tried again with these shares of it.
LONGEST_STEP = np.array([0.7, 0.7, 5e-4, 5e-4])
STEP_SHARES = (1.0, 0.5, 0.2, 0.05)
# The share of a time constant that one step leaves of it, at least.
LEAST_LAG = 0.25
# Of the rms velocity: slow sliding. A search begins at these, so that one of any width is near to some.
SLOW_SHARES = (0.025, 0.05, 0.1, 0.2, 0.4)
# What is searched: a narrower fall of friction lies within a reading, a wider one looks like less damping.
STRIBECK_VELOCITIES = (1e-3, 3.0)


def velocity_starts(regression: Regression, shape: Shape) -> Iterator[Shape]:
    """One for each of some velocities where a term has a Stribeck velocity, as shares of the rms velocity."""
    places = [place for place, one in enumerate(parameters_of(shape.terms), MOTION_DELAY + 1) if _is_velocity(one)]
    if not places:
        yield shape
        return
    for share in SLOW_SHARES:
        at = shape.as_array()
        at[places] = np.log(share * regression.rms_velocity)
        yield shape.at(at)


def _is_velocity(parameter: TermParameter) -> bool:
    """Whether it is a Stribeck velocity; a joint's stiffness is logarithmic, too."""
    return parameter.logarithmic and parameter.unit == "rad/s"


def box(regression: Regression, shape: Shape) -> tuple[FloatArray, FloatArray]:
    """The box searched, terms included."""
    low, high = limits(regression.rows[0].signals.tick_s)
    spans = [span_of(regression, each) for each in parameters_of(shape.terms)]
    return np.array([*low, *(span[0] for span in spans)]), np.array([*high, *(span[1] for span in spans)])


def span_of(regression: Regression, parameter: TermParameter) -> tuple[float, float]:
    """Between which values one parameter of a term that is no joint is searched; logarithms where it is logarithmic."""
    if not _is_velocity(parameter):
        return parameter.low, parameter.high
    low, high = (float(np.log(share * regression.rms_velocity)) for share in STRIBECK_VELOCITIES)
    return low, high


def of_terms_too(steps: FloatArray, regression: Regression) -> FloatArray:
    """Of a length such as CONVERGED_STEP, with the terms' parameters: as long as log β's, on their own scales."""
    return np.concatenate([steps, steps[0] * regression.scales])


def limits(tick_s: float) -> tuple[FloatArray, FloatArray]:
    """The box searched: (log β, log s, d_c, d_m)."""
    delay_s = DELAY_TICKS * tick_s
    low = np.array([np.log(BANDWIDTH_RAD_S[0]), np.log(S_PER_RAD[0]), -delay_s, -delay_s])
    high = np.array([np.log(BANDWIDTH_RAD_S[1]), np.log(S_PER_RAD[1]), delay_s, delay_s])
    return low, high


def shortened(step: FloatArray, longest: FloatArray = LONGEST_STEP) -> Iterator[FloatArray]:
    """Each unknown held to its longest step; and, where that leads nowhere, all of them in the step's own direction:
    a lag and a delay that stand for each other must be moved together."""
    clipped = np.clip(step, -longest, longest)
    straight = step / max(1.0, float(np.max(np.abs(step) / longest)))
    for direction in (clipped, straight):
        for share in STEP_SHARES:
            yield share * direction


def stepped(place: FloatArray, step: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Where in the box a step from ``place`` leads, all (unknowns,): straight on in 1/β² and in the delay d_c + 1/β.

    That delay is what the lowest frequencies tell of an amplifier, and the square of its time constant is what the next
    ones do: log (1 + jω/β) = jω/β + ω²/2β² + ... Straight on in log β a step would leave the valley in which lag and
    delay stand for each other, and a fast amplifier would take dozens of them.
    """
    result, lag_s = place + step, float(np.exp(-place[BANDWIDTH]))
    left = max(float(np.sqrt(max(1.0 - 2.0 * step[BANDWIDTH], 0.0))), LEAST_LAG)
    result[BANDWIDTH] = np.clip(place[BANDWIDTH] - np.log(left), low[BANDWIDTH], high[BANDWIDTH])
    left = float(np.exp(place[BANDWIDTH] - result[BANDWIDTH]))
    # The series is one for fast amplifiers: a slow one's delay would be led astray.
    result[COMMAND_DELAY] += min(0.5 * lag_s * (1.0 - left) ** 2, LONGEST_STEP[COMMAND_DELAY])
    return np.clip(result, low, high)


def inside(step: FloatArray, place: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """As much of a step from ``place`` as stays in the box; all (unknowns,)."""
    room = np.where(step > 0.0, high - place, place - low)
    shares = np.divide(room, np.abs(step), out=np.ones_like(step), where=np.abs(step) > room)
    return np.asarray(step * np.min(shares))
