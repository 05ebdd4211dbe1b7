"""How tense contacts are as a record begins, and records that begin anew where parts are held out.

A contact at rest may be under any tension, and one that moves may have turned round a moment ago. What it pulls with
as a record begins is read from the exertion of its first rows; the rows after them are predicted.
"""

from dataclasses import replace

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.friction_laws import model
from norton_bench.identification.friction_model import Path
from norton_bench.identification.ladder import fit_friction
from norton_bench.logs.equation import Problem

# What tells how tense the contacts are, whatever model is fitted afterwards: two numbers of shape, no drift in between.
SCOUT = "elasto-plastic"
# The rows that a start is read from, and the shares of a contact's strength that are tried.
FIRST_ROWS = 3
TRIALS = 9
# Tried over all shares first, then around the best.
REACHES = (1.0, 0.25)
ROUNDS = 2
# A start is another one than the usual if it leaves less than this share of the squared error of its first rows.
BETTER = 0.8
# If fewer than this share of the held-out rows lie clear of the cuts, nothing is cut.
CLEAR = 0.5


def begun(problem: Problem) -> Problem:
    """The problem with the tension at each beginning, and with a path on which held-out parts begin anew.

    Raises ExperimentError where nothing moves.
    """
    equation = problem.equation
    for _ in range(ROUNDS):
        scout = fit_friction(equation, model(SCOUT), problem.train)
        equation = replace(equation, path=_tensed(problem, equation.path, scout))
    cuts = _cuts(problem)
    afresh = replace(equation.path, starts=np.union1d(equation.path.starts, cuts), shares=None)
    settled = _settled(problem, cuts)
    held_out = problem.train & (equation.fold >= 0)
    if np.count_nonzero(settled & held_out) < CLEAR * np.count_nonzero(held_out):
        return replace(problem, equation=equation)
    fresh = replace(equation, afresh=_tensed(problem, afresh, scout), settled=settled)
    return replace(problem, equation=fresh)


def tensed(problem: Problem, fit: FrictionFit) -> Problem:
    """The problem with the tension at each beginning that a law of contacts which was fitted to it asks for."""
    equation = problem.equation
    return replace(problem, equation=replace(equation, path=_tensed(problem, equation.path, fit)))


def _tensed(problem: Problem, path: Path, scout: FrictionFit) -> Path:
    """The path with the share of its strength that the contact has at each start, as the first rows after it tell."""
    equation = problem.equation
    rest = equation.target - scout.values[: len(equation.names)] @ equation.others
    rows = _first_rows(problem, path.starts)
    usual = path.begin[path.starts]

    def left(shares: FloatArray) -> FloatArray:
        friction = equation.process(scout.model.columns(replace(path, shares=shares), scout.shape))
        error = (rest + scout.strengths @ friction) ** 2
        return np.array([float(np.mean(error[each])) if each.size else 0.0 for each in rows])

    best = np.zeros(path.starts.size)
    for reach in REACHES:
        trials = np.clip(best + np.linspace(-reach, reach, TRIALS)[:, None], -1.0, 1.0)
        best = _lowest(trials, np.stack([left(shares) for shares in trials]))
    return replace(path, shares=np.where(left(best) < BETTER * left(usual), best, usual))


def _lowest(trials: FloatArray, costs: FloatArray) -> FloatArray:
    """Where a parabola through the lowest trial and those beside it is lowest, (starts,); both are (trials, starts)."""
    at = np.clip(np.argmin(costs, axis=0), 1, len(trials) - 2)
    which = np.arange(costs.shape[1])
    before, here, after = (costs[at + step, which] for step in (-1, 0, 1))
    bend = before - 2 * here + after
    offset = np.where(bend > 0, 0.5 * (before - after) / np.where(bend > 0, bend, 1.0), 0.0)
    apart = trials[at, which] - trials[at - 1, which]
    return np.asarray(np.clip(trials[at, which] + np.clip(offset, -1.0, 1.0) * apart, -1.0, 1.0))


def _first_rows(problem: Problem, starts: IntArray) -> list[IntArray]:
    """The first rows after each start that filters have left clear."""
    margin = problem.filters.margin
    ends = np.append(starts[1:], problem.known.size)
    result = []
    for start, end in zip(starts, ends, strict=True):
        first, last = np.searchsorted(problem.pick, [start + margin, end])
        result.append(np.arange(first, min(first + FIRST_ROWS, last)))
    return result


def _cuts(problem: Problem) -> IntArray:
    """The samples at which another fold begins."""
    fold = problem.equation.fold
    return np.asarray(problem.pick[1:][np.diff(fold) != 0])


def _settled(problem: Problem, cuts: IntArray) -> BoolArray:
    """Rows whose filters do not see across a cut, shape (n,)."""
    if not cuts.size:
        return np.ones(problem.pick.size, dtype=bool)
    after = np.searchsorted(cuts, problem.pick, side="right")
    since = problem.pick - cuts[np.maximum(after - 1, 0)]
    until = cuts[np.minimum(after, cuts.size - 1)] - problem.pick
    margin = problem.filters.margin
    return np.asarray(((after == 0) | (since >= margin)) & ((after == cuts.size) | (until >= margin)))
