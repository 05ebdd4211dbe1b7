"""A joint that gives between motor and link, where both positions and what it transmits are known: its spring.

τ = K δ + D dδ/dt + constant, with the twist δ = motor position − link position (Spong 1987). Where neither a sensor nor
a known load tells τ, K and D are unknowns of the motor's own equation instead.
"""

from collections.abc import Mapping

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.separable import normal_solution
from norton_bench.identification.statistics import sandwich
from norton_bench.logs.basic_equation import UNEXPLAINED
from norton_bench.logs.delays import EXERTION
from norton_bench.logs.equation import LINK_DAMPING, LINK_STIFFNESS, Problem
from norton_bench.logs.results import HARMONIC
from norton_bench.logs.totals import status_of
from norton_bench.models.parameters import Estimate


def spring_of(
    problem: Problem, fit: FrictionFit, units: Mapping[str, str], *, believed: bool
) -> tuple[tuple[Estimate, ...], tuple[str, ...]]:
    """Stiffness and damping in ``units``, and what the spring leaves; nothing where no twist or torque is known."""
    twist, transmitted = problem.joined("twist"), problem.transmitted
    if twist is None or transmitted is None:
        return (), ()
    rows, process = problem.train, problem.equation.process
    columns = process(np.concatenate([twist, _constants(problem)]))[:, rows]
    columns = columns[[*range(2), *(2 + np.flatnonzero(np.any(columns[2:] != 0, axis=1)))]]
    target = process((transmitted + _gravity(problem, fit))[None])[0][rows]
    noise = np.concatenate([target.size * _twist_noise(problem) ** 2, np.zeros(len(columns) - 2)])
    values = normal_solution(columns, columns @ target, noise)
    residual = target - values @ columns
    stds = np.sqrt(np.diag(sandwich(columns.T, residual, problem.equation.time_s[rows], noise, values)))
    if EXERTION in fit.names:
        # A torque that is read so much later looks like damping.
        stds[1] = np.hypot(stds[1], values[0] * fit.deviation(EXERTION))
    left = float(np.std(residual) / max(np.std(target), 1e-300))
    # What leaves most of a torque is no spring of it.
    believed = believed and left <= UNEXPLAINED
    estimates = tuple(
        Estimate(name, float(value), float(std), units[name], status_of(max(value, 0.0), std, believed=believed))
        for name, value, std in zip((LINK_STIFFNESS, LINK_DAMPING), values[:2], stds[:2], strict=True)
    )
    return estimates, (f"A linear spring between motor and link leaves {left:.1%} of what it transmits.",)


def _constants(problem: Problem) -> FloatArray:
    """One for each log, at the samples' rate: encoders are set to zero anew when they are switched on."""
    lengths = [len(part.time_s) for part in problem.stretches]
    place = np.repeat([part.log.place for part in problem.stretches], lengths)
    return np.stack([place == each for each in dict.fromkeys(place)]).astype(np.float64)


def _gravity(problem: Problem, fit: FrictionFit) -> FloatArray:
    """What is fitted of the link's weight, which a known load does not hold; at the samples' rate."""
    total = np.zeros(problem.known.size)
    if problem.terms[0].port is None:
        for name, column in problem.columns.items():
            if name.startswith(HARMONIC):
                total = total - fit.value(name) * column
    return total


def _twist_noise(problem: Problem) -> FloatArray:
    """The deviations of twist and twist rate in a row, by what encoders count and readings scatter, (2,)."""
    white = [problem.readings.white_noise(name) for name in ("position", "link_position")]
    return np.array([problem.filters.in_rows(order) for order in (0, 1)]) * float(np.linalg.norm(white))
