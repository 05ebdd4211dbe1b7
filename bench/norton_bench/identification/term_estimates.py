"""The terms of a solution in units of their own: values, how well they are known, and the network's cogging."""

from dataclasses import replace

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.results import Cogging
from norton_bench.identification.separable import Solution
from norton_bench.identification.shape import COULOMB, GAIN, INERTIA, MOTOR_VALUES, VISCOUS
from norton_bench.identification.statistics import LOOSE_BEYOND
from norton_bench.models.parameters import Estimate, Status
from norton_bench.models.terms import Factor, NetworkTerm, Term

# The linear unknowns that parameters of terms are relative to.
TERM_BASE = {"coulomb_torque": COULOMB, "viscous_damping": VISCOUS, "inertia": INERTIA}


def terms_in_torque(solution: Solution, linear: FloatArray) -> tuple[FloatArray, list[tuple[int, float, float]]]:
    """The terms' parameters (parameters,), and of each which linear unknown its value goes with, its slope with that
    unknown, and its slope with the unknown of the shape."""
    values, slopes = list[float](), list[tuple[int, float, float]]()
    for each in solution.shape.terms:
        for parameter, relative in zip(each.term.parameters, each.values, strict=True):
            base = TERM_BASE.get(parameter.over)
            size = 1.0 if base is None else float(linear[base])
            values.append(relative * size)
            own = relative * size if parameter.logarithmic else size
            slopes.append((GAIN if base is None else base, 0.0 if base is None else relative, own))
    return np.array(values), slopes


def waves_found(solution: Solution, to_torque: float) -> tuple[NetworkTerm, ...]:
    """The torques found that go with the position, from the pairs that follow the five linear unknowns."""
    periods = solution.regression.cogging
    pairs = solution.linear[5 : 5 + 2 * len(periods)].reshape(-1, 2) * to_torque
    return tuple(NetworkTerm("cogging", tuple(pair.tolist()), each) for each, pair in zip(periods, pairs, strict=True))


def cogging_found(solution: Solution, covariance: FloatArray, to_torque: float) -> tuple[Cogging, ...]:
    """The amplitudes of these waves, and how well they are known, along their phase; ``covariance`` is that of the
    solution's unknowns."""
    result = []
    for place, wave in enumerate(waves_found(solution, to_torque)):
        pair = np.array(wave.values)
        size = float(np.linalg.norm(pair))
        along, own = pair / size, slice(5 + 2 * place, 7 + 2 * place)
        std = to_torque * max(float(along @ covariance[own, own] @ along), 0.0) ** 0.5
        result.append(Cogging(wave.periods_per_turn, size, std))
    return tuple(result)


def terms_found(
    solution: Solution, values: FloatArray, covariance: FloatArray, command_unit: str
) -> list[tuple[NetworkTerm, list[Estimate]]]:
    """Each of the solution's terms in units of its own, and its estimates."""
    result, place = [], MOTOR_VALUES
    for each in solution.shape.terms:
        own = slice(place, place + len(each.values))
        known = _known(each.term, values[own], covariance[own, own])
        statuses = [_status(solution, bool(one)) for one in known]
        numbers = zip(each.term.parameters, values[own], np.sqrt(np.diag(covariance)[own]), statuses, strict=True)
        estimates = [
            Estimate(one.name, float(value), float(std), one.unit_for(command_unit), status)
            for one, value, std, status in numbers
        ]
        result.append((replace(each, values=tuple(values[own].tolist())), estimates))
        place = own.stop
    return result


def _known(term: Term, values: FloatArray, covariance: FloatArray) -> BoolArray:
    """Of each of a term's parameters, whether it is known to within LOOSE_BEYOND of its size.

    What cannot be nothing is asked alone. All others are asked together, by their mean square in deviations (Wald):
    of a cosine and a sine, or of a drift and its rate, one may be nothing. So may a joint's damping, and the inertia
    beyond it, which have nothing to do with each other.
    """
    known = np.sqrt(np.diag(covariance)) <= LOOSE_BEYOND * np.abs(values)
    if term.factor is Factor.JOINT:
        return np.asarray(known)
    alone = np.array([each.logarithmic for each in term.parameters])
    together = ~alone
    score = values[together] @ np.linalg.solve(covariance[np.ix_(together, together)], values[together])
    known[together] = score >= np.count_nonzero(together) / LOOSE_BEYOND**2
    return np.asarray(known)


def _status(solution: Solution, known: bool) -> Status:
    if not solution.converged:
        return Status.NOT_CONVERGED
    return Status.VALID if known else Status.UNEXCITED
