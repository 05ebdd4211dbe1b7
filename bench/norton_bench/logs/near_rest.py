"""Rows near rest, in which friction is no law of velocity that samples could show, count for less.

Where a shaft sticks, friction holds whatever pulls at it, up to its limit; a velocity within its own errors has no
sign; and where it turns, friction jumps at an instant that samples and low-pass show only roughly. That error passes
the rows' filter as everything does: a row's variance is that of the others times 1 + λ g, g the share of the filter's
power that lies near rest. λ is the likeliest for what is left of the equation (groupwise heteroscedasticity; Greene,
Econometric Analysis, section 9.7). The weight is the square of its reciprocal: friction at rest is never more than the
law's, so that the error has a mean too, which a weight for its variance alone would let through. Where a contact that
deflects describes these rows as well as the others, λ is next to nothing, and they count like any other.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, signal
from scipy.optimize import minimize_scalar

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.friction_fit import FrictionFit, fit_friction
from norton_bench.identification.friction_model import FrictionModel, Path
from norton_bench.logs.equation import Problem, Terms
from norton_bench.logs.grid import Filters, Stretch, slope

# A velocity within this many of its deviations has no sign.
UNSURE = 3.0
# After a period of the cutoff the low-pass has come within 3 % of a step.
ROUNDED_PERIODS = 1.0
# Between which λ is looked for, and at how many places: from rows like all others to rows that are as good as left out.
LEAST, MOST = 1e-3, 1e6
TRIALS = 21
# Where near rest the variance is more than twice the others', no contact is seen there.
HIDDEN = 1.0
# A film, or stiction, has come within 5 % of its end at three times its velocity (exp −3), a contact shows while it
# deflects: neither is seen if no more samples than these are as slow, or as near to the last turn.
DIES_AFTER = 3.0
FEW = 0.05
# Of a fit and its weights, each made with the other.
ROUNDS = 3


def weighted(problem: Problem, excess: float) -> Problem:
    """The problem with rows near rest weighted by the ``excess`` (λ) of their variance.

    No law can change at speeds that are seldom seen elsewhere. Nor over ways, unless a contact is seen there: where the
    excess is small.
    """
    equation = problem.equation
    slowest, way = _hidden(problem)
    shortest = way if excess > HIDDEN else 0.0
    path = replace(equation.path, slowest=slowest, shortest=shortest)
    afresh = None if equation.afresh is None else replace(equation.afresh, slowest=slowest, shortest=shortest)
    weights = 1.0 / (1.0 + excess * shares(problem)) ** 2
    return replace(problem, equation=replace(equation, path=path, afresh=afresh, weights=weights))


@dataclass(frozen=True)
class WeightedFit:
    """A fit with weights of its own, the ``excess`` that they are made from, and how unlikely what it leaves is: the
    mean of minus twice the logarithm of the likelihood, but for a constant."""

    fit: FrictionFit
    excess: float
    doubt: float


def fit_weighted(problem: Problem, model: FrictionModel) -> WeightedFit:
    """The model with weights of its own.

    Raises ExperimentError where there are too few rows or nothing moves.
    """
    share, excess = shares(problem), 0.0
    fit = fit_friction(problem.equation, model, problem.train)
    for _ in range(ROUNDS):
        excess = likeliest_excess(fit.residual[problem.train], share[problem.train])
        fit = fit_friction(weighted(problem, excess).equation, model, problem.train, near=fit.shape)
    return WeightedFit(fit, excess, doubt(fit.residual[problem.train], share[problem.train], excess))


def doubt(residual: FloatArray, share: FloatArray, excess: float) -> float:
    """Of a residual (n,) whose variance is 1 + ``excess`` · ``share`` (n,) times one that is the likeliest."""
    variance = 1.0 + excess * share
    return float(np.mean(np.log(variance)) + np.log(max(float(np.mean(residual**2 / variance)), 1e-300)))


def likeliest_excess(residual: FloatArray, share: FloatArray) -> float:
    """The λ of a residual (n,) with the least doubt."""
    if not np.any(share > 0):
        return 0.0

    def of(log_excess: float) -> float:
        return doubt(residual, share, float(np.exp(log_excess)))

    trials = np.linspace(np.log(LEAST), np.log(MOST), TRIALS)
    at = int(np.argmin([of(each) for each in trials]))
    if at == 0:
        return 0.0
    bounds = (trials[at - 1], trials[min(at + 1, TRIALS - 1)])
    return float(np.exp(minimize_scalar(of, bounds=bounds, method="bounded").x))


def shares(problem: Problem) -> FloatArray:
    """Of the power of each row's filter, what lies near rest, shape (n,)."""
    filters = problem.filters
    power = filters.anti_alias(_pulse(filters)) ** 2
    power /= np.sum(power)
    each = [signal.convolve(near.astype(np.float64), power, "same") for near in _near_rest(problem)]
    return np.clip(np.concatenate(each)[problem.pick], 0.0, 1.0)


def _hidden(problem: Problem) -> tuple[float, float]:
    """The velocity of a film, and the way of a contact, that nearly all samples are beyond that are not near rest; in
    training. Zero where all are near rest."""
    away, path = ~np.concatenate(_near_rest(problem)), problem.equation.path
    if path.trained is not None:
        away = away & path.trained
    if not away.any():
        return 0.0, 0.0
    speed, way = np.abs(path.velocity[away]), _since_turn(path)[away]
    return float(np.quantile(speed, FEW)) / DIES_AFTER, float(np.quantile(way, FEW))


def _since_turn(path: Path) -> FloatArray:
    """How far each sample is from the last place where the motion turned, or a stretch began, shape (n,)."""
    turned = np.diff(np.sign(path.velocity), prepend=0.0) != 0
    turned[path.starts] = True
    last = np.maximum.accumulate(np.where(turned, np.arange(turned.size), 0))
    return np.asarray(np.abs(path.position - path.position[last]))


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
