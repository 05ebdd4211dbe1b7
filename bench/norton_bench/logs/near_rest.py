"""Rows near rest, in which friction is no law of velocity that samples could show, count for less.

Where a shaft sticks, friction holds whatever pulls at it, up to its limit; a velocity within its own errors has no
sign; and where it turns, friction jumps at an instant that samples and low-pass show only roughly. That error passes
the rows' filter as everything does: a row's variance is that of the others times 1 + λ g, g the share of the filter's
power that lies near rest. λ is the likeliest for what is left of the equation (groupwise heteroscedasticity; Greene,
Econometric Analysis, section 9.7). Where a contact that deflects describes these rows as well as the others, λ is next
to nothing, and they count like any other.

Where λ is more than that, no law is seen near rest, and what is left there is no noise: friction that holds is less
than friction that slides, at every stop, and errors of one sign do not average out. Then these rows count so much less
that, were all of their errors of one sign, a mean over all rows would move by half of its deviation at most.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage, optimize, signal

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.friction_fit import FrictionFit, fit_friction
from norton_bench.identification.friction_model import FrictionModel, Path
from norton_bench.identification.statistics import least
from norton_bench.logs.equation import Problem, Terms
from norton_bench.logs.grid import Filters, Stretch

# A velocity within this many of its deviations has no sign.
UNSURE = 3.0
# After a period of the cutoff the low-pass has come within 3 % of a step.
ROUNDED_PERIODS = 1.0
# Between which λ is looked for, and at how many places: from rows like all others to rows that are as good as left out.
LEAST, MOST = 1e-3, 1e6
TRIALS = 21
# Where near rest the variance is more than twice the others', no law is seen there.
HIDDEN = 1.0
# How far errors of one sign near rest may move a mean, in its deviations: with it, the error is 1.1 deviations rms.
MOVED = 0.5
# A film, or stiction, has come within 5 % of its end at three times its velocity (exp −3), a contact shows while it
# deflects: neither is seen if no more samples than these are as slow, or as near to the last turn.
DIES_AFTER = 3.0
FEW = 0.05
# Of a fit and its weights, each made with the other.
ROUNDS = 3


@dataclass(frozen=True)
class WeightedFit:
    """A fit with weights of its own, the ``excess`` that they are made from, and how unlikely what it leaves is: the
    mean of minus twice the logarithm of the likelihood, but for a constant."""

    fit: FrictionFit
    excess: float
    doubt: float


@dataclass(frozen=True)
class NearRest:
    """What of the rows of ``problem`` lies near rest.

    ``share`` (n,) is how much of the power of each row's filter does. Nearly all samples trained on that are not near
    rest are faster than a film of ``slowest`` shows at, and further from the last turn than ``shortest``.
    """

    problem: Problem
    share: FloatArray
    slowest: float
    shortest: float
    _fits: dict[str, WeightedFit] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem) -> "NearRest":
        near = _near_rest(problem)
        return cls(problem, _shares(problem, near), *_hidden(problem.equation.path, ~np.concatenate(near)))

    def weighted(self, excess: float) -> Problem:
        """The problem with rows near rest weighted by the ``excess`` (λ) of their variance.

        No law can change at speeds that are seldom seen elsewhere. Nor over ways, unless a contact is seen there: where
        the excess is small.
        """
        equation, hidden = self.problem.equation, excess > HIDDEN
        shortest = self.shortest if hidden else 0.0
        weight = one_sided(excess, self.share[self.problem.train]) if hidden else excess
        path = replace(equation.path, slowest=self.slowest, shortest=shortest)
        afresh = equation.afresh
        if afresh is not None:
            afresh = replace(afresh, slowest=self.slowest, shortest=shortest)
        variance = 1.0 + weight * self.share
        return replace(self.problem, equation=replace(equation, path=path, afresh=afresh, variance=variance))

    def fit(self, model: FrictionModel) -> WeightedFit:
        """The model with weights of its own; each is fitted once.

        Raises ExperimentError where there are too few rows or nothing moves.
        """
        if model.name not in self._fits:
            self._fits[model.name] = self._fit(model)
        return self._fits[model.name]

    def _fit(self, model: FrictionModel) -> WeightedFit:
        train, excess = self.problem.train, 0.0
        fit = fit_friction(self.problem.equation, model, train)
        for _ in range(ROUNDS):
            excess = self.excess(fit)
            fit = fit_friction(self.weighted(excess).equation, model, train, near=fit.shape)
        return WeightedFit(fit, excess, doubt(fit.residual[train], self.share[train], excess))

    def excess(self, fit: FrictionFit) -> float:
        """The likeliest λ of what the fit leaves."""
        train = self.problem.train
        return likeliest_excess(fit.residual[train], self.share[train])

    def noise_variance(self, fit: FrictionFit) -> FloatArray:
        """Of every row's error, shape (n,); near rest it is as great as it was found to be."""
        factor, train = 1.0 + self.excess(fit) * self.share, self.problem.train
        return np.asarray(np.mean(fit.residual[train] ** 2 / factor[train]) * factor)


def likeliest_excess(residual: FloatArray, share: FloatArray) -> float:
    """The λ of a residual (n,) with the least doubt."""
    near = share > 0
    if not np.any(near):
        return 0.0
    # Far from rest the variance is one, whatever λ is.
    far, own, squares = float(np.sum(residual[~near] ** 2)), share[near], residual[near] ** 2

    def doubts(excesses: FloatArray) -> FloatArray:
        return np.array([_doubt(far, squares, 1.0 + excess * own, residual.size) for excess in excesses])

    return least(doubts, LEAST, MOST, TRIALS)


def one_sided(excess: float, share: FloatArray) -> float:
    """The least weight in place of λ with which errors of one sign near rest move no mean by more than ``MOVED``.

    A row of variance 1 + λ g then has the part √(λ g) / (1 + w g) in the sum over all n rows, whose deviation is √n.
    With w = n λ no part is more than 1/(2 √n).
    """
    near = share[share > 0]
    error = np.sqrt(excess * near)

    def beyond(weight: float) -> float:
        return float(np.sum(error / (1 + weight * near)) - MOVED * np.sqrt(share.size))

    if beyond(excess) <= 0:
        return excess
    return float(optimize.brentq(beyond, excess, share.size * excess, rtol=1e-3))


def doubt(residual: FloatArray, share: FloatArray, excess: float) -> float:
    """Of a residual (n,) whose variance is 1 + ``excess`` · ``share`` (n,) times one that is the likeliest."""
    return _doubt(0.0, residual**2, 1.0 + excess * share, residual.size)


def _doubt(far: float, squares: FloatArray, variance: FloatArray, rows: int) -> float:
    """The same from ``squares`` and ``variance`` of some of so many ``rows``; the others have the sum of squares
    ``far``, and the variance one."""
    mean_square = (far + float(np.sum(squares / variance))) / rows
    return float(np.sum(np.log(variance)) / rows + np.log(max(mean_square, 1e-300)))


def _shares(problem: Problem, near: Sequence[BoolArray]) -> FloatArray:
    power = problem.filters.kernel**2 / np.sum(problem.filters.kernel**2)
    each = [signal.convolve(part.astype(np.float64), power, "same") for part in near]
    return np.clip(np.concatenate(each)[problem.pick], 0.0, 1.0)


def _hidden(path: Path, away: BoolArray) -> tuple[float, float]:
    """The velocity of a film, and the way of a contact, that nearly all samples ``away`` from rest are beyond; of those
    trained on. Zero where there are none."""
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
    """Of the filtered velocity, by the noise in what was logged."""
    name = stretch.motion_name
    response = filters.response(1 if name == "position" else 0)
    return filters.noise(stretch, name, stretch.sound) * float(np.linalg.norm(response))
