"""What may be added to an equation of motion beside friction: cogging, slow drift, temperature."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from bench.errors import UsageError
from bench.identification.cogging import EVIDENCE
from bench.identification.friction.equation import Equation
from bench.identification.friction.fit import FrictionFit

FloatArray = npt.NDArray[np.float64]

# Of the spectrum over position: lines for each 1/range, and the most periods that the range is taken to hold.
OVERSAMPLING = 4
MOST_PERIODS = 400
LINES_AT_ONCE = 64


def with_columns(equation: Equation, names: tuple[str, ...], columns: FloatArray) -> Equation:
    """The equation with further linear columns at its rows, shape (names, n)."""
    return replace(equation, names=equation.names + names, others=np.concatenate([equation.others, columns]))


def with_cogging(equation: Equation, period: float, harmonics: int = 2) -> Equation:
    """With sines and cosines of position; ``period`` is that of the first harmonic, in rad or m."""
    phase = 2 * np.pi / period * (equation.path.position - equation.path.position[0])
    orders = range(1, harmonics + 1)
    waves = [wave(order * phase) for order in orders for wave in (np.cos, np.sin)]
    names = tuple(f"cogging_{wave}_{order}" for order in orders for wave in ("cosine", "sine"))
    return with_columns(equation, names, equation.process(np.stack(waves)))


def with_drift(equation: Equation, spacing_s: float) -> Equation:
    """With a slow change of the offset: a broken line of time that begins at zero, its knots ``spacing_s`` apart.

    What the line does in a fold it learns from the rows around, so folds must be shorter than the spacing.
    """
    time_s = equation.time_s - equation.time_s[0]
    knots = np.linspace(0.0, time_s[-1], max(round(time_s[-1] / spacing_s), 1) + 1)
    hats = np.stack([np.interp(time_s, knots, row) for row in np.eye(len(knots))[1:]])
    return with_columns(equation, tuple(f"drift_{knot + 1}" for knot in range(len(hats))), hats)


def with_temperature(equation: Equation) -> Equation:
    """With what velocity's exertion changes a degree, about the mean temperature: oil thins as it warms.

    Raises UsageError where no temperature is known.
    """
    path = equation.path
    if path.temperature_c is None:
        raise UsageError("the temperature is not known: map a column to it")
    warmer = path.temperature_c - np.mean(path.temperature_c)
    effects = np.stack([-path.velocity * warmer, -np.sign(path.velocity) * warmer])
    names = ("viscous_damping_per_degree", "coulomb_torque_per_degree")
    return with_columns(equation, names, equation.process(effects))


def cogging_period(equation: Equation, fit: FrictionFit) -> float | None:
    """The period in position, in rad or m, of the strongest line in what ``fit`` leaves; None where none stands out.

    For strokes of any length, also of less than a turn: periods from the whole stroke down to a few samples' travel.
    """
    position = equation.process(equation.path.position[None, :])[0][fit.rows]
    residual = fit.residual[fit.rows] - np.mean(fit.residual[fit.rows])
    reach = float(np.ptp(position))
    # Faster lines than twice a row's travel are not sampled.
    travel = float(np.median(np.abs(np.diff(position)))) or reach
    most = int(min(MOST_PERIODS, max(reach / (2 * travel), 1.0)) * OVERSAMPLING)
    frequencies = np.arange(OVERSAMPLING, most + OVERSAMPLING) / (OVERSAMPLING * reach)
    power = _power(position - position[0], residual, frequencies)
    best = int(np.argmax(power))
    return float(1.0 / frequencies[best]) if power[best] > EVIDENCE * _colour(residual) else None


def _power(position: FloatArray, residual: FloatArray, frequencies: FloatArray) -> FloatArray:
    """Periodogram over position, in squared residuals: white noise gives its variance, shape (frequencies,)."""
    power = np.empty(frequencies.size)
    for first in range(0, frequencies.size, LINES_AT_ONCE):
        some = frequencies[first : first + LINES_AT_ONCE]
        waves = np.exp(2j * np.pi * np.outer(some, position))
        power[first : first + LINES_AT_ONCE] = np.abs(waves @ residual) ** 2 / position.size
    return power


def _colour(residual: FloatArray) -> float:
    """The variance that coloured noise shows at its strongest: variance times the neighbours that move together."""
    variance = float(np.mean(residual**2))
    alike = float(np.mean(residual[1:] * residual[:-1])) / variance if variance > 0 else 0.0
    alike = min(max(alike, 0.0), 0.99)
    return variance * (1 + alike) / (1 - alike)
