"""Rows near rest, in which friction is no law of velocity that samples could show, count for less.

Where a shaft sticks, friction holds whatever pulls at it, up to its limit; a velocity within its own errors has no
sign; and where it turns, friction jumps at an instant that samples and low-pass show only roughly. That error passes
the rows' filter as everything does: a row's variance is that of the others times 1 + λ g, g the share of the filter's
power that lies near rest. λ is the likeliest for what is left of the equation (groupwise heteroscedasticity; Greene,
Econometric Analysis, section 9.7). Where a contact that deflects describes these rows as well as the others, λ is next
to nothing, and they count like any other.
"""

from dataclasses import replace

import numpy as np
from scipy import ndimage, signal
from scipy.optimize import minimize_scalar

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.friction_fit import FrictionFit, fit_friction
from norton_bench.identification.friction_model import FrictionModel
from norton_bench.logs.equation import Problem, Terms
from norton_bench.logs.grid import Filters, Stretch, slope

# A velocity within this many of its deviations has no sign.
UNSURE = 3.0
# After a period of the cutoff the low-pass has come within 3 % of a step.
ROUNDED_PERIODS = 1.0
# Between which λ is looked for, and at how many places: from rows like all others to rows that are as good as left out.
LEAST, MOST = 1e-3, 1e6
TRIALS = 21
# Where rows near rest alone count for less than half, no law shows that changes among them.
HALF = 1.0
# Of a fit and its weights, each made with the other.
ROUNDS = 3


def weighted(problem: Problem, excess: float) -> Problem:
    """The problem with rows near rest whose variance is that of the others times 1 + ``excess`` (λ) times their share.

    Where they count for less than half, a law can neither change at the speeds nor over the ways that are passed among
    them.
    """
    equation = problem.equation
    slowest, shortest = _passed(problem) if excess > HALF else (0.0, 0.0)
    path = replace(equation.path, slowest=slowest, shortest=shortest)
    afresh = None if equation.afresh is None else replace(equation.afresh, slowest=slowest, shortest=shortest)
    weights = 1.0 / (1.0 + excess * shares(problem))
    return replace(problem, equation=replace(equation, path=path, afresh=afresh, weights=weights))


def fit_weighted(problem: Problem, model: FrictionModel) -> tuple[FrictionFit, float]:
    """The model with weights of its own, and the ``excess`` that they are made from.

    Raises ExperimentError where there are too few rows or nothing moves.
    """
    share, excess = shares(problem), 0.0
    fit = fit_friction(problem.equation, model, problem.train)
    for _ in range(ROUNDS):
        excess = likeliest_excess(fit.residual[problem.train], share[problem.train])
        fit = fit_friction(weighted(problem, excess).equation, model, problem.train, near=fit.shape)
    return fit, excess


def likeliest_excess(residual: FloatArray, share: FloatArray) -> float:
    """λ for a residual (n,) whose variance is 1 + λ ``share`` (n,) times one that is the likeliest for each λ."""
    if not np.any(share > 0):
        return 0.0

    def doubt(log_excess: float) -> float:
        variance = 1.0 + np.exp(log_excess) * share
        mean_square = max(float(np.mean(residual**2 / variance)), 1e-300)
        return float(np.mean(np.log(variance)) + np.log(mean_square))

    trials = np.linspace(np.log(LEAST), np.log(MOST), TRIALS)
    at = int(np.argmin([doubt(each) for each in trials]))
    if at == 0:
        return 0.0
    bounds = (trials[at - 1], trials[min(at + 1, TRIALS - 1)])
    return float(np.exp(minimize_scalar(doubt, bounds=bounds, method="bounded").x))


def shares(problem: Problem) -> FloatArray:
    """Of the power of each row's filter, what lies near rest, shape (n,)."""
    filters = problem.filters
    power = filters.anti_alias(_pulse(filters)) ** 2
    power /= np.sum(power)
    each = [signal.convolve(near.astype(np.float64), power, "same") for near in _near_rest(problem)]
    return np.clip(np.concatenate(each)[problem.pick], 0.0, 1.0)


def _passed(problem: Problem) -> tuple[float, float]:
    """Rms of the velocities near rest, and of the ways gone in each visit there; in training."""
    near, path = np.concatenate(_near_rest(problem)), problem.equation.path
    if path.trained is not None:
        near = near & path.trained
    edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(np.int8), [0]]))).reshape(-1, 2)
    if not edges.size:
        return 0.0, 0.0
    ways = np.array([np.ptp(path.position[first:end]) for first, end in edges])
    return float(np.sqrt(np.mean(path.velocity[near] ** 2))), float(np.sqrt(np.mean(ways**2)))


def _near_rest(problem: Problem) -> list[BoolArray]:
    """Which samples of each stretch are."""
    pairs = zip(problem.stretches, problem.terms, strict=True)
    return [_of_stretch(part, term, problem.filters) for part, term in pairs]


def _of_stretch(stretch: Stretch, term: Terms, filters: Filters) -> BoolArray:
    """Samples with a velocity that its errors hide, and those that the low-pass mixes with these or with a turn."""
    velocity = term.motion.velocity
    turns = np.diff(np.sign(velocity), append=np.sign(velocity[-1])) != 0
    unsure = np.abs(velocity) < UNSURE * _velocity_deviation(stretch, filters)
    reach = int(np.ceil(ROUNDED_PERIODS / (filters.cutoff_hz * filters.dt_s)))
    return np.asarray(ndimage.binary_dilation(turns | unsure, iterations=reach))


def _velocity_deviation(stretch: Stretch, filters: Filters) -> float:
    """That of white noise in what was logged, of which the low-pass takes off a known part."""
    pulse = _pulse(filters)
    passed = filters.smooth(pulse)
    name = "position" if "position" in stretch.columns else "velocity"
    logged = stretch.columns[name]
    noise = np.std((logged - filters.smooth(logged))[stretch.sound]) / np.sqrt(np.sum((pulse - passed) ** 2))
    velocity = slope(passed, filters.dt_s) if name == "position" else passed
    return float(noise * np.sqrt(np.sum(velocity**2)))


def _pulse(filters: Filters) -> FloatArray:
    """Long enough for all that filters remember, and for what they go on with beyond its ends."""
    reach = max(2 * filters.margin, 32)
    return np.asarray(signal.unit_impulse(2 * reach + 1, "mid"))
