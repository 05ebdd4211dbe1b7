"""Deviations that can be believed, a choice between models by unseen data, one value out of several."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from norton_bench.arrays import FloatArray
from norton_bench.distributions import chi2_quantile, chi2_tail, normal_tail, t_quantile

# A bandwidth that may be so many times as great is not known.
FARTHEST = 10.0
# A parameter, or a combination of them, that deviates by more than this share of its value is not known.
LOOSE_BEYOND = 0.5
NORMAL_95 = 1.96  # deviations
BLOCKS_S = (0.1, 0.5, 2.0)
# Degrees of freedom of a deviation of which as good as nothing, and as good as all, is known.
LEAST_FREEDOM, CERTAIN_FREEDOM = 1e-2, 1e6
# A column shorter than this says nothing, and its square is no number.
NOTHING = 1e-100
# A direction of the columns that a part excites less than this, of what it excites most, it does not excite.
WORTH_A_COLUMN = 1e-6


def std_of_next(draws: FloatArray) -> FloatArray:
    """Of one more, (p,), from a few ``draws`` (n, p), as wide as so few make it: with it 1.96 deviations hold 95 %."""
    return reach_of_next(draws, 0.975) / NORMAL_95


def moderated_std_of_next(draws: FloatArray, stated_std: FloatArray) -> FloatArray:
    """The same for parameters whose deviations are ``stated_std`` (p,) beforehand, though not for certain.

    The scatter of few draws says little of a deviation, and what is stated may leave out a part of it. How far the two
    differ over all parameters, beyond what chance does, tells how many draws what is stated is worth: variances are
    moderated by empirical Bayes (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3:3, section 3; here with a prior variance
    that is given for each parameter, so that only its degrees of freedom are estimated).
    """
    count = len(draws)
    freedom, variance = count - 1, np.var(draws, axis=0, ddof=1)
    prior = _prior_freedom(variance / stated_std**2, freedom)
    weight = 1.0 / (1.0 + freedom / prior)  # of what is stated: 1 where the prior is certain
    moderated = weight * stated_std**2 + (1.0 - weight) * variance
    inflation = t_quantile(0.975, freedom + prior) / NORMAL_95
    return np.asarray(inflation * np.sqrt(moderated * (1.0 + 1.0 / count)))


def _prior_freedom(ratios: FloatArray, freedom: int) -> float:
    """Of the deviations that are stated, from variances over what was stated, (p,), each with its own ``freedom``.

    Both variances are those of chi-squared variables, whose logarithms have known moments: their mean square is that of
    the ratios. As good as certain where chance alone makes ratios differ as much.
    """
    logarithms = np.log(ratios[np.isfinite(ratios) & (ratios > 0.0)])
    mean_square = float(np.mean((logarithms - _mean_log(freedom)) ** 2)) if logarithms.size else 0.0

    def excess(prior: float) -> float:
        spread = scipy.special.polygamma(1, freedom / 2.0) + scipy.special.polygamma(1, prior / 2.0)
        return float(spread + _mean_log(prior) ** 2) - mean_square

    if excess(CERTAIN_FREEDOM) >= 0.0:
        return CERTAIN_FREEDOM
    return (
        LEAST_FREEDOM
        if excess(LEAST_FREEDOM) <= 0.0
        else float(scipy.optimize.brentq(excess, LEAST_FREEDOM, CERTAIN_FREEDOM))
    )


def _mean_log(freedom: float) -> float:
    """Of a variance with so many degrees of freedom, over its true value."""
    return float(scipy.special.digamma(freedom / 2.0) - np.log(freedom / 2.0))


def reach_of_next(draws: FloatArray, level: float) -> FloatArray:
    """How far from the mean of a few ``draws`` (n, ...) one more lies at this quantile of Student's distribution."""
    count = len(draws)
    return np.asarray(t_quantile(level, count - 1) * np.std(draws, axis=0, ddof=1) * np.sqrt(1.0 + 1.0 / count))


def sandwich(
    jacobian: FloatArray,
    residual: FloatArray,
    time_s: FloatArray,
    contamination: FloatArray | None = None,
    linear: FloatArray | None = None,
) -> FloatArray:
    """Deviations that can be believed: residuals are coloured, and part of them is not noise but the model's fault.

    Neighbouring residuals are summed in blocks of time before they are squared (a sandwich estimate clustered by
    block), for several lengths of block; the widest answer counts.

    Covariance of least squares parameters, shape (parameters, parameters).

    ``jacobian`` (samples, parameters), ``residual`` and ``time_s`` (samples,). ``contamination`` (parameters,) is
    what errors in the columns add to their squares, ``linear`` the values of those parameters, the first, that
    stand in the equation as factors. The correlations are those of the middle length of block, the deviations the
    largest of all.
    """
    bread, scores, scale = _normal(jacobian, residual, contamination, linear)
    candidates = [bread @ _meat(scores, time_s, block_s) @ bread for block_s in BLOCKS_S]
    widest = np.sqrt(np.max([np.diag(candidate) for candidate in candidates], axis=0))
    middle = candidates[len(candidates) // 2]
    deviation = np.sqrt(np.maximum(np.diag(middle), 1e-300))
    return np.asarray(middle / np.outer(deviation, deviation) * np.outer(widest, widest) / np.outer(scale, scale))


@dataclass(frozen=True)
class Moved:
    """By how much each part of the samples moves each parameter of least squares, and by how much the noise within the
    part alone would: ``values`` and their deviations ``stds``, both (parts, parameters). Values add up to zero."""

    values: FloatArray
    stds: FloatArray


def moved_by_parts(
    jacobian: FloatArray,
    residual: FloatArray,
    time_s: FloatArray,
    contamination: FloatArray | None = None,
    linear: FloatArray | None = None,
    *,
    parts: int,
) -> Moved:
    """Of so many parts, as long as each other; other arguments as of :func:`sandwich`.

    The influence of samples on an estimate (Hampel et al., Robust Statistics, 1986, ch. 6), added up in each part. What
    a part does not excite it does not move, and so needs no value of its own. The noise within a part is what a fit of
    the part alone would leave.
    """
    bread, scores, scale = _normal(jacobian, residual, contamination, linear)
    values, stds = [], []
    for rows in np.array_split(np.arange(len(residual)), parts):
        columns = jacobian[rows] / scale
        left = residual[rows] - columns @ np.linalg.lstsq(columns, residual[rows], rcond=WORTH_A_COLUMN)[0]
        meats = [_meat(columns * left[:, None], time_s[rows], block_s) for block_s in BLOCKS_S]
        variance = np.max([np.diag(bread @ meat @ bread) for meat in meats], axis=0)
        values.append(np.sum(scores[rows], axis=0) @ bread / scale)
        stds.append(np.sqrt(np.maximum(variance, 0.0)) / scale)
    return Moved(np.array(values), np.array(stds))


def _normal(
    jacobian: FloatArray, residual: FloatArray, contamination: FloatArray | None, linear: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The inverse of the information, and each sample's scores, both of columns divided by their ``scale``."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale < NOTHING] = 1.0
    information = (jacobian / scale).T @ (jacobian / scale)
    scores = jacobian / scale * residual[:, None]
    if contamination is not None and linear is not None:
        at = np.arange(len(contamination))
        information[at, at] -= contamination / scale[at] ** 2
        linearly = slice(len(linear))
        scores[:, linearly] += contamination[linearly] * linear / len(residual) / scale[linearly]
    return np.linalg.pinv(information, rcond=1e-13, hermitian=True), scores, scale


def with_lag_as_told(values: FloatArray, covariance: FloatArray, place: int) -> FloatArray:
    """The covariance (p, p) of ``values`` (p,), with a bandwidth β at ``place`` that deviates as far as it may.

    Behind a delay that is estimated, too, a lag shows by the square of its time constant: |1 + iω/β|⁻² = 1 − (ω/β)² …;
    what is of first order in ω looks like delay. So it is 1/β² that deviates evenly, and the interval of β reaches
    further up than down; without end where 1/β² may be zero. Now 1.96 deviations to either side hold 95 %.
    """
    bandwidth, std = float(values[place]), float(np.sqrt(covariance[place, place]))
    wider = np.ones(len(values))
    reach = _reach_of_bandwidth(2.0 * std / bandwidth)
    wider[place] = max(1.0, bandwidth * min(reach / NORMAL_95, 1.0) / max(std, 1e-300))
    return np.asarray(covariance * np.outer(wider, wider))


def _reach_of_bandwidth(std: float) -> float:
    """How far to either side 95 % of β lie, relative to it, where 1/β² is normal with this relative deviation."""

    def missing(reach: float) -> float:
        above = normal_tail((1.0 - (1.0 + reach) ** -2) / std)
        below = normal_tail(((1.0 - reach) ** -2 - 1.0) / std) if reach < 1.0 else 0.0
        return above + below - 0.05

    return float(scipy.optimize.brentq(missing, 1e-9, FARTHEST)) if std > 0.0 and missing(FARTHEST) < 0.0 else np.inf


def _meat(scores: FloatArray, time_s: FloatArray, block_s: float) -> FloatArray:
    block = np.unique(((time_s - time_s[0]) / block_s).astype(np.int64), return_inverse=True)[1]
    count = int(block.max()) + 1
    sums = np.stack([np.bincount(block, column, count) for column in scores.T], axis=1)
    # The usual correction for few clusters and spent degrees of freedom.
    correction = count / max(count - 1, 1) * len(scores) / max(len(scores) - scores.shape[1], 1)
    return np.asarray(correction * sums.T @ sums)


# A richer model has to leave this much less, relative.
LEAST_GAIN = 0.01


# Choosing between models by what each errs on data that it has not seen.
def held_out_rms(mean_squares: Sequence[float]) -> tuple[float, float]:
    """The error over all folds and its standard error, from each fold's mean square (folds,)."""
    rms = float(np.sqrt(np.mean(mean_squares)))
    return rms, _standard_error(np.array(mean_squares)) / (2 * rms) if rms > 0 else 0.0


def simplest_as_good(mean_squares: Sequence[Sequence[float]], unknowns: Sequence[int]) -> int:
    """Which model to use, from the mean squares of each on the same folds, (models, folds), and their sizes.

    The simplest that is not worse than the best by more than one standard error of the difference between them. It is
    taken fold by fold: folds differ far more than models do. A gain too small to matter is none, however sure it is:
    no model is quite what a machine does.
    """
    squares = np.array(mean_squares)
    means = squares.mean(axis=1)
    best = int(np.argmin(means))
    matters = (LEAST_GAIN**2 + 2 * LEAST_GAIN) * float(means[best])

    def as_good(model: int) -> bool:
        excess = squares[model] - squares[best]
        return bool(np.mean(excess) <= max(_standard_error(excess), matters))

    def beaten(model: int) -> bool:
        """By a simpler one that is not as good as the best itself."""
        return any(means[other] <= means[model] for other in range(len(means)) if unknowns[other] < unknowns[model])

    good = [model for model in range(len(squares)) if as_good(model)]
    return min(good, key=lambda model: (beaten(model), unknowns[model], means[model]))


def _standard_error(values: FloatArray) -> float:
    """Of the mean of independent values."""
    return float(np.std(values, ddof=1) / np.sqrt(values.size))


NODES = 200
# Between which the spread is looked for, in units of the values' range.
LEAST_SPREAD, GREATEST_SPREAD = 1e-4, 2.0


# One value out of several that disagree: each has its own deviation, and the sessions differ by more than that.
#
# The random-effects model: session i gives y_i = value + b_i + e_i with e_i ~ N(0, std_i²), known, and b_i ~ N(0,
# τ²), what differs between the sessions. τ is found by restricted maximum likelihood (Viechtbauer 2005, J. Educ.
# Behav. Stat. 30:261); the value's interval is that of Knapp and Hartung (2003, Stat. Med. 22:2693), Student's t over
# the scatter itself, but never narrower than that of normal errors (Wiksten, Rücker, Schwarzer 2016, Stat. Med.
# 35:2503). Deviations far greater than the scatter hold an error that all sessions share: no average makes that
# smaller.
@dataclass(frozen=True)
class Combined:
    """``value`` ± 1.96 ``std`` covers 95 %: ``std`` holds within, between, and how little few sessions tell of both.

    ``within_std`` is that of one typical session, ``shared_std`` what of it is common to all sessions,
    ``between_std`` the spread between sessions, with 95 % confidence no more than ``between_std_upper``. ``q`` is
    Cochran's, ``p`` how often chance alone gives so much where nothing differs. ``weights`` (sessions,) sum to one.
    """

    value: float
    std: float
    within_std: float
    shared_std: float
    between_std: float
    between_std_upper: float
    q: float
    p: float
    weights: FloatArray


def combine(values: FloatArray, stds: FloatArray, known_shared_std: float = 0.0) -> Combined:
    """Of two sessions or more, shapes (sessions,). ``known_shared_std`` is what of these is known to be common.

    Raises ValueError for fewer sessions, or a deviation that is not positive.
    """
    count = len(values)
    if count < 2 or not (np.isfinite(values).all() and np.isfinite(stds).all() and (stds > 0).all()):
        raise ValueError("needs two finite values or more, each with a positive deviation")
    variances = stds**2
    between = between_variance(values, variances)
    weights = 1.0 / (variances + between)
    value = float(weights @ values / weights.sum())
    scatter = float(weights @ (values - value) ** 2) / (count - 1)
    half_width = max(t_quantile(0.975, count - 1) * np.sqrt(scatter), NORMAL_95) / np.sqrt(weights.sum())
    q = float(cochran(values, variances))
    within = float(np.sqrt(count / np.sum(1.0 / variances)))
    shared = max(known_shared_std, within * shared_share(q, count))
    return Combined(
        value=value,
        std=float(np.hypot(half_width / NORMAL_95, shared)),
        within_std=within,
        shared_std=shared,
        between_std=float(np.sqrt(between)),
        between_std_upper=between_limit(values, variances * min(1.0, q / (count - 1))),
        q=q,
        p=chi2_tail(q, count - 1),
        weights=weights / weights.sum(),
    )


def shared_share(q: float, count: int) -> float:
    """How much of the sessions' own deviations their scatter does not bear out, with 95 % confidence; 0 to 1.

    Independent errors scatter by at most sqrt(Q / its 5 % quantile) of their deviations.
    """
    return float(np.sqrt(max(0.0, 1.0 - q / chi2_quantile(0.05, count - 1))))


def between_variance(values: FloatArray, variances: FloatArray) -> float:
    """τ² by restricted maximum likelihood: the best of a scan, then refined; 0 where nothing is more likely."""
    reach = float(np.ptp(values))
    if reach == 0.0:
        return 0.0
    scaled, own = (values - values.mean()) / reach, variances / reach**2

    def doubt(spreads: FloatArray) -> FloatArray:
        return _restricted_doubt(scaled, own + spreads[:, None] ** 2)

    return least(doubt, LEAST_SPREAD, GREATEST_SPREAD, NODES) ** 2 * reach**2


def shrunk(values: FloatArray, variances: FloatArray) -> FloatArray:
    """What each of ``values`` (n,) is in truth, were they measured with ``variances`` (n,): empirical Bayes.

    Each is brought nearer to the mean by the share that chance has in how much they differ; all are the mean where they
    differ by no more than chance (Efron and Morris 1975, J. Am. Stat. Assoc. 70:311).
    """
    between = between_variance(values, variances)
    weights = 1.0 / (variances + between)
    mean = float(weights @ values / weights.sum())
    return np.asarray(mean + between * weights * (values - mean))


def least(doubt: Callable[[FloatArray], FloatArray], low: float, high: float, trials: int) -> float:
    """The positive value with the least doubt: the best of a geometric scan, then refined; 0 if zero is no worse.

    ``doubt`` is told several values at once, (n,), and returns that of each.
    """
    nodes = np.linspace(np.log(low), np.log(high), trials)
    best = int(np.argmin(doubt(np.exp(nodes))))
    bounds = (nodes[max(best - 1, 0)], nodes[min(best + 1, trials - 1)])
    result = scipy.optimize.minimize_scalar(
        lambda node: float(doubt(np.exp([node]))[0]), bounds=bounds, method="bounded"
    )
    return float(np.exp(result.x)) if result.fun < doubt(np.zeros(1))[0] else 0.0


def _restricted_doubt(values: FloatArray, totals: FloatArray) -> FloatArray:
    """Twice the negative logarithm of the restricted likelihood, but for a constant; ``totals`` (..., sessions)."""
    weights = 1.0 / totals
    return np.asarray(np.log(totals).sum(-1) + np.log(weights.sum(-1)) + cochran(values, totals))


def cochran(values: FloatArray, variances: FloatArray) -> FloatArray:
    """Q: squared distances from the weighted mean, each over its variance; ``variances`` (..., sessions)."""
    weights = 1.0 / variances
    mean = weights @ values / weights.sum(-1)
    return np.asarray((weights * (values - mean[..., None]) ** 2).sum(-1))


def between_limit(values: FloatArray, variances: FloatArray, confidence: float = 0.95) -> float:
    """The τ that is not exceeded with this confidence: at it, Q would seldom be as small (Viechtbauer 2007, Stat. Med.
    26:37). 0 where Q is that small already."""
    allowed = chi2_quantile(1.0 - confidence, len(values) - 1)
    reach = float(np.ptp(values))
    if reach == 0.0 or cochran(values, np.maximum(variances, 1e-300)) <= allowed:
        return 0.0
    # With equal weights Q is at most n·reach²/4τ²: beyond this τ it is below what is allowed.
    highest = reach * np.sqrt(len(values) / allowed)
    return float(
        scipy.optimize.brentq(
            lambda spread: float(cochran(values, variances + spread**2)) - allowed, 1e-9 * reach, highest
        )
    )


def tail_of_each(comparisons: int) -> float:
    """The chance on either side of each of so many intervals if all are to hold in 95 % of cases (Bonferroni)."""
    return 0.025 / comparisons
