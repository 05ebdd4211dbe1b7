"""Separable fit of one friction model: coefficients are solved for at every step, only the shape is searched.

No initial guess: the shape is scanned over its whole range on a logarithmic grid, then refined by Gauss-Newton. Where
a simpler model that this one contains fits better than what was reached, the search starts again from there.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.friction_laws import CONTAINS
from norton_bench.identification.friction_laws import model as member
from norton_bench.identification.friction_model import Dimension, Equation, FrictionModel, Path, remembers
from norton_bench.identification.friction_operators import bounded_solution
from norton_bench.identification.separable import linear_solution
from norton_bench.identification.statistics import Moved, moved_by_parts, sandwich

POINTS_PER_DECADE = 2
ROUNDS = 2
MOST_STEPS = 20
SMALL = 0.02  # relative step of the differences that stand for derivatives
LONGEST_STEP = 1.0  # in the logarithm
SHARES = (1.0, 0.5, 0.2, 0.05)
# Of the cost: converged once a step promises less than the first, or less than the second and does not keep it
# (Coulomb friction makes the cost rough).
WORTH_A_STEP = 1e-4
ROUGHNESS = 1e-3
KEPT = 8
AT_BOUND = 1e-3
# Relative, of differences that stand for derivatives by the shape.
DIFFERENCE = 0.02
# Parts of a record that are compared.
QUARTERS = 4
# Of a column's power: what is more noise than this tells nothing, however much is taken off.
MOST_NOISE = 0.5


@dataclass(frozen=True)
class FrictionFit:
    """One fitted model.

    ``names`` and ``values`` are the equation's further columns, then the model's terms, then its unknowns;
    ``covariance`` (names, names) is in the units of the values. ``residual`` and ``prediction`` cover every row of
    the equation, fitted or not; ``rows`` says which were, ``scale`` (n,) what they were multiplied by. ``at_bound``
    names what lies at the edge of what is allowed.
    """

    model: FrictionModel
    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    residual: FloatArray
    prediction: FloatArray
    rows: BoolArray
    scale: FloatArray
    converged: bool
    at_bound: tuple[str, ...]

    @property
    def strengths(self) -> FloatArray:
        """What the model's terms are multiplied by."""
        first = len(self.values) - len(self.model.unknowns) - len(self.model.terms)
        return self.values[first : first + len(self.model.terms)]

    @property
    def shape(self) -> FloatArray:
        return self.values[len(self.values) - len(self.model.unknowns) :]

    def moved_shapes(self) -> Iterator[tuple[FloatArray, float]]:
        """The shape with one unknown after the other changed for a difference, and the change. It becomes smaller: a
        ratio may be as great as it can be."""
        for index, value in enumerate(self.shape):
            changed = self.shape.copy()
            changed[index] = value * (1 - DIFFERENCE)
            yield changed, -DIFFERENCE * value

    @property
    def deviations(self) -> FloatArray:
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    def value(self, name: str) -> float:
        """Raises ValueError for a name that was not fitted."""
        return float(self.values[self.names.index(name)])

    def deviation(self, name: str) -> float:
        """Raises ValueError for a name that was not fitted."""
        return float(self.deviations[self.names.index(name)])

    def dimension(self, name: str) -> Dimension | None:
        """What a coefficient or unknown of the friction measures; None for the equation's further columns."""
        known = {term.name: term.dimension for term in self.model.terms}
        return (known | {unknown.name: unknown.dimension for unknown in self.model.unknowns}).get(name)

    @property
    def rms(self) -> float:
        """Of the residual in the rows fitted, as they were weighted."""
        scale = self.scale[self.rows]
        return scaled_rms(scale * self.residual[self.rows], scale)


def scaled_rms(scaled: FloatArray, scale: FloatArray) -> float:
    """Of a residual (n,) that has been multiplied by its rows' scale, in the unit that it had before; ``scale`` (m,) is
    that of the rows whose mean weight stands for it, the same or more: rows near rest, which count for little, do not
    count for much where there are no others."""
    return float(np.sqrt(np.mean(scaled**2) / np.mean(scale**2)))


def noise_power(equation: Equation, noise: Mapping[str, FloatArray], part: IntArray, squares: FloatArray) -> FloatArray:
    """What ``noise`` of the equation's further columns, by name (n,), adds to their ``squares`` (parts, k), scaled, in
    the rows of each part (n,); those of −1 are in none."""
    inside = part >= 0
    power = np.zeros(squares.shape)
    for name, variance in noise.items():
        weighted = (equation.scale**2 * variance)[inside]
        power[:, equation.names.index(name)] = np.bincount(part[inside], weighted, len(squares))
    return np.minimum(power, MOST_NOISE * squares)


def noise_in_target(equation: Equation) -> FloatArray:
    """The target's part of the noise of each of the further columns, as a multiple, (k,)."""
    return np.array([equation.noise_in_target.get(name, 0.0) for name in equation.names])


def fit_friction(
    equation: Equation, model: FrictionModel, rows: BoolArray | None = None, near: FloatArray | None = None
) -> FrictionFit:
    """Fit ``model`` to ``rows`` of the equation (all by default).

    ``near`` (unknowns,) is a shape known from an equation that differs little: the search then begins and stays there.
    Raises ExperimentError where there are too few rows or nothing moves.
    """
    rows = np.ones(equation.target.size, dtype=bool) if rows is None else rows
    problem = Problem.of(equation, model, np.where(rows, 0, -1))
    if np.count_nonzero(rows) < 3 * (len(problem.nonnegative) + len(model.unknowns)):
        raise ExperimentError(f'too few samples are left to fit friction "{model.name}": use a longer record')
    if near is not None:
        return problem.finish(rows, problem.refine(rows, np.clip(np.log(near), problem.low, problem.high)))
    # One without unknowns of its shape is found within any shape of this one.
    inner = [each for each in map(member, CONTAINS.get(model.name, ())) if each.unknowns]
    contained = {each.name: fit_friction(equation, each, rows).shape for each in inner}
    return problem.finish(rows, problem.search(rows, problem.scan(), contained))


def moved_by_quarters(equation: Equation, fit: FrictionFit) -> Moved:
    """By how much each quarter of the rows fitted moves the values of the ``fit``, (quarters, names)."""
    problem = Problem.of(equation, fit.model, np.where(fit.rows, 0, -1))
    reached = problem.reached(np.log(fit.shape), fit.rows)
    moved = moved_by_parts(*problem.least_squares(fit.rows, reached), parts=QUARTERS)
    return Moved(reached.units * moved.values, reached.units * moved.stds)


@dataclass(frozen=True)
class Reached:
    """Where a search stands: the logarithms of the shape, all columns, coefficients and residual in the rows fitted.

    Columns and residual are multiplied by the rows' scale.
    """

    at: FloatArray
    columns: FloatArray
    linear: FloatArray
    residual: FloatArray
    converged: bool = False

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)

    @property
    def units(self) -> FloatArray:
        """Of the values, over those of what is searched: coefficients, and the logarithms of the shape."""
        return np.concatenate([np.ones(len(self.linear)), np.exp(self.at)])


class LeastSquares(NamedTuple):
    """The arguments of :func:`sandwich`, in their order."""

    jacobian: FloatArray
    residual: FloatArray
    time_s: FloatArray
    contamination: FloatArray
    linear: FloatArray


@dataclass(frozen=True)
class Problem:
    """One model in one equation. ``low`` and ``high`` are the logarithms of the box searched.

    ``part`` (n,) numbers the parts that a search may leave out, from 0 on; -1 is in none of them. ``target`` and all
    columns are multiplied by ``scale``, (n,).
    """

    equation: Equation
    model: FrictionModel
    low: FloatArray
    high: FloatArray
    nonnegative: BoolArray
    part: IntArray
    scale: FloatArray
    target: FloatArray
    _scanned: dict[bytes, tuple[FloatArray, FloatArray, FloatArray]] = field(default_factory=dict)
    _kept: dict[bytes, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, equation: Equation, model: FrictionModel, part: IntArray) -> "Problem":
        _ = equation.path.velocity_scale  # refuses a path at rest
        box = np.log(np.array([unknown.bounds(equation.path) for unknown in model.unknowns]).reshape(-1, 2))
        signs = [False] * len(equation.names) + [term.nonnegative for term in model.terms]
        scale = equation.scale
        return cls(equation, model, box[:, 0], box[:, 1], np.array(signs), part, scale, scale * equation.target)

    def columns(self, at: FloatArray) -> FloatArray:
        """Further columns, then friction's with the sign they have in the equation: (columns, n)."""
        key = at.tobytes()
        if key not in self._kept:
            while len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[key] = self._columns(at)
        return self._kept[key]

    def begun_afresh(self, at: FloatArray) -> FloatArray:
        """As ``columns``, where every part that is held out begins as a new record does."""
        afresh = self.equation.afresh
        return self.columns(at) if afresh is None or not remembers(self.model) else self._columns(at, afresh)

    def _columns(self, at: FloatArray, path: Path | None = None) -> FloatArray:
        friction = self.equation.process(self.model.columns(path or self.equation.path, np.exp(at)))
        return np.asarray(self.scale * np.concatenate([self.equation.others, -friction]))

    def scan(self, left_out: int | None = None, known: FloatArray | None = None) -> FloatArray:
        """The best shape on a grid, one unknown after the other, for all parts but ``left_out``; or ``known``.

        The better of the two. Sums over each part are kept, so that leaving out another one costs next to nothing.
        """
        chosen = np.array([k for k in range(int(self.part.max()) + 1) if k != left_out])
        best = 0.5 * (self.low + self.high)
        for _ in range(ROUNDS if len(best) > 1 else 1):
            for unknown, (low, high) in enumerate(zip(self.low, self.high, strict=True)):
                points = int(np.ceil(POINTS_PER_DECADE * (high - low) / np.log(10.0))) + 1
                trials = [self._with(best, unknown, value) for value in np.linspace(low, high, points)]
                best = min([best, *trials], key=lambda at: self._cost(at, chosen))
        return best if known is None else min([best, known], key=lambda at: self._cost(at, chosen))

    @staticmethod
    def _with(at: FloatArray, unknown: int, value: float) -> FloatArray:
        changed = at.copy()
        changed[unknown] = value
        return changed

    def _cost(self, at: FloatArray, chosen: IntArray) -> float:
        gram, moment, power = (sums[chosen].sum(axis=0) for sums in self._sums(at))
        linear = bounded_solution(gram, moment, self.nonnegative)
        return float(power - 2 * linear @ moment + linear @ gram @ linear)

    def _sums(self, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        from norton_bench.identification.friction_operators import part_sums  # noqa: PLC0415  (compiled: slow to import)

        key = at.tobytes()
        if key not in self._scanned:
            gram, moment, power = part_sums(self.columns(at), self.target, self.part)
            self._scanned[key] = *self._without_noise(gram, moment, self.part), power
        return self._scanned[key]

    def _without_noise(self, gram: FloatArray, moment: FloatArray, part: IntArray) -> tuple[FloatArray, FloatArray]:
        """The columns' products in each part, and those with the target, without what noise adds to them; (parts,
        columns, columns) and (parts, columns)."""
        if not self.equation.noise:
            return gram, moment
        at = np.arange(len(self.equation.names))
        taken = noise_power(self.equation, self.equation.noise, part, gram[:, at, at])
        gram[:, at, at] -= taken
        moment[:, at] -= taken * noise_in_target(self.equation)
        return gram, moment

    def search(self, rows: BoolArray, start: FloatArray, contained: Mapping[str, FloatArray]) -> Reached:
        """Refined from ``start``, or from what a model that this one contains is here, where that is better.

        ``contained`` are the shapes of models fitted to the same rows, by name; those that are not contained are not
        looked at.
        """
        result = self.refine(rows, start)
        starts = [
            self.reached(at, rows)
            for name in CONTAINS.get(self.model.name, ())
            if name in contained and contained[name].size
            for at in self._becoming(member(name), contained[name], result.at)
        ]
        best = min(starts, key=lambda each: each.cost, default=result)
        return self.refine(rows, best.at) if best.cost < result.cost else result

    def _becoming(self, inner: FrictionModel, shape: FloatArray, result: FloatArray) -> Iterator[FloatArray]:
        """Where this model is ``inner`` with that ``shape``: unknowns that ``inner`` does not have are at their least,
        or do not matter and stay as ``found``."""
        known = {unknown.name: value for unknown, value in zip(inner.unknowns, np.log(shape), strict=True)}
        for others in (self.low, result):
            at = [known.get(each.name, other) for each, other in zip(self.model.unknowns, others, strict=True)]
            yield np.clip(at, self.low, self.high)

    def refine(self, rows: BoolArray, start: FloatArray) -> Reached:
        """Gauss-Newton on the projected problem with step halving, inside the box."""
        now = self.reached(start, rows)
        for _ in range(MOST_STEPS if len(start) else 0):
            slopes = self.slopes(now)[:, rows]
            active = now.columns[:, rows][(now.linear > 0) | ~self.nonnegative]
            step = linear_solution(np.concatenate([slopes, active]), now.residual)[: len(start)]
            step = np.clip(now.at + np.clip(step, -LONGEST_STEP, LONGEST_STEP), self.low, self.high) - now.at
            promised = float(step @ slopes @ now.residual)
            if promised < WORTH_A_STEP * now.cost:
                return replace(now, converged=True)
            trials = (self.reached(now.at + share * step, rows) for share in SHARES)
            better = next((trial for trial in trials if trial.cost < now.cost), None)
            if better is None:
                return replace(now, converged=promised < ROUGHNESS * now.cost)
            now = better
        return replace(now, converged=not len(start))

    def reached(self, at: FloatArray, rows: BoolArray) -> Reached:
        from norton_bench.identification.friction_operators import part_sums  # noqa: PLC0415  (compiled: slow to import)

        columns, target = self.columns(at), self.target
        part = np.where(rows, 0, -1)
        gram, moment, _ = part_sums(columns, target, part)
        gram, moment = self._without_noise(gram, moment, part)
        linear = bounded_solution(gram[0], moment[0], self.nonnegative)
        return Reached(at, columns, linear, (target - linear @ columns)[rows])

    def slopes(self, reached: Reached) -> FloatArray:
        """Change of the prediction with the logarithm of each unknown, shape (unknowns, n)."""
        change = np.zeros((len(reached.at), self.equation.target.size))
        for unknown in range(len(reached.at)):
            sign = 1.0 if reached.at[unknown] + SMALL <= self.high[unknown] else -1.0
            moved = self.columns(self._with(reached.at, unknown, reached.at[unknown] + sign * SMALL))
            change[unknown] = reached.linear @ (moved - reached.columns) / (sign * SMALL)
        return change

    def least_squares(self, rows: BoolArray, reached: Reached) -> LeastSquares:
        """What the search ends with, linear about its values."""
        jacobian = np.concatenate([reached.columns, self.slopes(reached)])[:, rows].T
        others = len(self.equation.names)
        squares = np.sum(jacobian[:, :others] ** 2, axis=0, keepdims=True)
        all_noise = {**self.equation.noise, **self.equation.noise_at_zero}
        noise = noise_power(self.equation, all_noise, np.where(rows, 0, -1), squares)[0]
        shrunk = reached.linear[:others] - noise_in_target(self.equation)
        return LeastSquares(jacobian, reached.residual, self.equation.time_s[rows], noise, shrunk)

    def finish(self, rows: BoolArray, reached: Reached) -> FrictionFit:
        """The values with their covariance, and the prediction of every row."""
        covariance = sandwich(*self.least_squares(rows, reached))
        shape, units = np.exp(reached.at), reached.units
        prediction = reached.linear @ (reached.columns / self.scale)
        terms = tuple(term.name for term in self.model.terms)
        unknowns = tuple(unknown.name for unknown in self.model.unknowns)
        return FrictionFit(
            model=self.model,
            names=self.equation.names + terms + unknowns,
            values=np.concatenate([reached.linear, shape]),
            covariance=covariance * np.outer(units, units),
            residual=self.equation.target - prediction,
            prediction=prediction,
            rows=rows,
            scale=self.scale,
            converged=reached.converged,
            at_bound=self._at_bound(reached),
        )

    def _at_bound(self, reached: Reached) -> tuple[str, ...]:
        names = self.equation.names + tuple(term.name for term in self.model.terms)
        zero = [name for name, x, held in zip(names, reached.linear, self.nonnegative, strict=True) if held and x <= 0]
        width = AT_BOUND * (self.high - self.low)
        edge = (reached.at - self.low < width) | (self.high - reached.at < width)
        return (*zero, *(unknown.name for unknown, hit in zip(self.model.unknowns, edge, strict=True) if hit))
