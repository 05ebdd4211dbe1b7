"""From the unknowns that a fit solves for to the motor's parameters: values, and their covariance."""

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.separable import Solution
from norton_bench.identification.shape import COULOMB, DAMPING, GAIN, INERTIA, MOTOR_VALUES, VISCOUS
from norton_bench.identification.statistics import sandwich
from norton_bench.identification.term_estimates import terms_in_torque
from norton_bench.models.parameters import MOTOR_PARAMETERS
from norton_bench.models.terms import parameters_of

PHYSICAL = tuple(parameter.name for parameter in MOTOR_PARAMETERS)
# In the order of a solution's values; those of its terms follow. Delays are in seconds.
KNOWN = (*PHYSICAL, "command_delay", "motion_delay")


def names_of(solution: Solution) -> tuple[str, ...]:
    """Of a solution's values, as :func:`physical` has them."""
    return (*KNOWN, *(parameter.name for parameter in parameters_of(solution.shape.terms)))


def stated_by_name(solution: Solution, values: FloatArray, covariance: FloatArray) -> dict[str, tuple[float, float]]:
    """Each of a solution's values with its deviation, by its name."""
    stated = zip(values.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True)
    return dict(zip(names_of(solution), stated, strict=True))


def covariance_of(solution: Solution) -> FloatArray:
    """Of the solution's unknowns, linear ones first, as its residual gives it."""
    time_s = solution.regression.time_s()
    return sandwich(solution.jacobian, solution.innovation, time_s, solution.contamination, solution.linear)


def physical(solution: Solution, covariance: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Values in the order of PHYSICAL, then the two delays and the terms' parameters; and their covariance.

    From free motion they are per unit of torque gain, whose own value is then 1. ``covariance`` is that of the
    solution's unknowns, linear ones first; as the residual gives it where it is not told.
    """
    covariance = covariance_of(solution) if covariance is None else covariance
    shape, columns = solution.shape, len(solution.linear)
    linear, to_linear = _linear_in_torque(solution)
    stiffness = linear[COULOMB] * shape.s_per_rad
    ordered = np.array(
        [linear[GAIN], shape.bandwidth_rad_s, *linear[INERTIA : COULOMB + 1], stiffness, linear[DAMPING],
         shape.command_delay_s, shape.motion_delay_s]
    )  # fmt: skip
    # The gradient of each over (linear, then those of log β, log s, d_c, d_m that were free).
    terms, to_terms = terms_in_torque(solution, linear)
    gradient = np.zeros((MOTOR_VALUES + len(terms), columns + len(solution.free)))
    for row, column in ((0, GAIN), (2, INERTIA), (3, VISCOUS), (4, COULOMB), (6, DAMPING)):
        gradient[row, :5] = to_linear[column]
    gradient[5, :5] = shape.s_per_rad * to_linear[COULOMB]
    slopes = {0: (1, shape.bandwidth_rad_s), 1: (5, stiffness), 2: (7, 1.0), 3: (8, 1.0)}
    for term, (base, of_base, of_relative) in enumerate(to_terms):
        gradient[MOTOR_VALUES + term, :5] = of_base * to_linear[base]
        slopes[4 + term] = (MOTOR_VALUES + term, of_relative)
    for position, unknown in enumerate(solution.free):
        row, slope = slopes[unknown]
        gradient[row, columns + position] = slope
    return np.concatenate([ordered, terms]), gradient @ covariance @ gradient.T


def _linear_in_torque(solution: Solution) -> tuple[FloatArray, FloatArray]:
    """The five linear unknowns and their gradient over the five that were solved for: shapes (5,), (5, 5)."""
    solved = solution.linear[:5]
    if not solution.free_motion:
        return solved, np.eye(5)
    # Solved for: gain, B, τc and σ1 over the inertia. Wanted: all over the gain.
    gain = solved[GAIN]
    linear = solved / gain
    linear[INERTIA] = 1.0 / gain
    gradient = np.eye(5) / gain
    gradient[:, GAIN] -= solved / gain**2
    gradient[INERTIA] = 0.0
    gradient[INERTIA, GAIN] = -1.0 / gain**2
    return linear, gradient
