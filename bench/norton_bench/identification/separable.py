"""Separable least squares (variable projection): the linear unknowns are solved for exactly at every step.

No initial guess: a scan over the friction's shape, then Gauss-Newton from several amplifier bandwidths in a low band,
in which delays are harmless, then in the full band."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.bands import told, worthwhile_band
from norton_bench.identification.fed_back import SharedErrors
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.regression import Memory, Regression
from norton_bench.identification.search_box import (
    LONGEST_STEP,
    box,
    inside,
    of_terms_too,
    shortened,
    stepped,
    velocity_starts,
)
from norton_bench.identification.shape import BANDWIDTH, COULOMB, MOTION_DELAY, Shape
from norton_bench.identification.signals import Signals
from norton_bench.identification.turns import is_new, strongest_period
from norton_bench.models.terms import NetworkTerm

# In cycles a tick. The low band leaves delays of some ticks within the reach of Gauss-Newton.
LOW_BAND = Kernel(cutoff=0.05, half_width=24.0)
LOW_STRIDE = 5

SCAN_S = np.geomspace(20.0, 10_000.0, 10)
START_BANDWIDTHS = (150.0, 500.0, 1500.0)

# Of each parameter: relative for the first two, seconds for the delays.
CONVERGED_STEP = np.array([1e-4, 1e-4, 1e-7, 1e-7])
# Enough to go on from: the low band finds where to begin in the full one, and that what else there is.
ROUGH_STEP = np.array([0.03, 0.03, 2e-5, 2e-5])
# From each start; a local minimum may look the better one after a few.
LOW_STEPS = 15
MOST_STEPS = 40
MOST_COGGINGS = 4
# A step of a twentieth, and of a fifth, of a deviation.
NOTHING_GAINED = 2e-3
LITTLE_GAINED = 4e-2
# Half of one, where no step is better: a direction that is told so badly is no reason to call nothing known.
NO_STEP_BETTER = 0.25


@dataclass(frozen=True)
class Solution:
    """Where the iteration ended.

    ``residual`` (samples,) is in the target's unit; ``innovation`` (samples,) is what of it least squares saw, and
    ``jacobian`` (samples, parameters) its change, negative, with the linear unknowns, then log β, log s, delays.
    """

    shape: Shape
    linear: FloatArray
    residual: FloatArray
    innovation: FloatArray
    jacobian: FloatArray
    free: tuple[int, ...]
    contamination: FloatArray  # what errors of readings add to the squares of the jacobian's columns, (parameters,)
    cost: float
    regression: Regression  # the one that was solved
    converged: bool

    @property
    def free_motion(self) -> bool:
        return self.regression.free_motion


def solve(
    stretches: tuple[Signals, ...],
    *,
    free_motion: bool = False,
    roughly: bool = False,
    cogging: tuple[float, ...] = (),
) -> Solution:
    """The best fit of all stretches; ``free_motion`` as in Regression; ``roughly`` where nobody will believe it.

    ``cogging`` is what is known of it beforehand.
    """
    low = Regression.of(stretches, told(stretches, LOW_BAND), LOW_STRIDE, free_motion=free_motion, cogging=cogging)
    ends = [_descend(start, most_steps=LOW_STEPS, within=ROUGH_STEP)[0] for start in _starts(low)]
    ends.sort(key=lambda at: at.cost)
    # Not first in the full band: there the errors of coarse counts may be all that is seen of the acceleration.
    band = worthwhile_band(low, ends[0].linear)
    regression = Regression.of(stretches, band, free_motion=free_motion, cogging=cogging)
    solution = _first_settled(regression, ends)
    if roughly:
        return solution
    if (better := worthwhile_band(low, solution.linear)) != band:
        regression = Regression.of(stretches, better, free_motion=free_motion, cogging=cogging)
        solution = _iterate(regression, solution.shape, within=ROUGH_STEP)
    solution = _with_cogging(solution, within=ROUGH_STEP)
    counted = solution.regression.recounted(solution.shape).whitened(
        solution.shape, float(solution.linear[COULOMB]), solution.residual
    )
    return _with_cogging(_iterate(counted, solution.shape, within=CONVERGED_STEP), within=CONVERGED_STEP)


def solve_again(stretches: tuple[Signals, ...], near: Solution) -> Solution:
    """The same fit of another record of the same experiment, whose solution is ``near``: same band, same cogging."""
    regression = _again(stretches, near)
    at = _At.of(regression, near.shape)
    white = regression.whitened(near.shape, float(at.linear[COULOMB]), at.residual, near.regression.whitening)
    return _iterated(_At.solved(white, near.shape, at.columns, at.memory), within=CONVERGED_STEP)


def remaining_power(stretches: tuple[Signals, ...], near: Solution) -> float:
    """Mean square of what the shape of ``near`` leaves of another record of the same experiment, whitened as its
    own."""
    regression = _again(stretches, near).whitened_as(near.shape, near.regression.whitening)
    return float(np.mean(_At.of(regression, near.shape).innovation ** 2))


def _again(stretches: tuple[Signals, ...], near: Solution) -> Regression:
    """The regression of another record of the same experiment, before it is whitened."""
    before = near.regression
    regression = Regression.of(stretches, before.rows[0].kernel, free_motion=before.free_motion, cogging=before.cogging)
    return before.terms_of(regression).recounted(near.shape)


def solve_with_terms(near: Solution, terms: Sequence[NetworkTerm], zero_nm: float) -> Solution:
    """The same stretches with ``terms`` beside what the solution ``near`` has: from its values, and those of ``terms``.

    Their values are relative, as in Shape, and where the search begins; of a Stribeck velocity several are tried.
    ``zero_nm`` is the torque sensor's, which friction that grows with the load must know.
    """
    shape = replace(near.shape, terms=tuple(terms))
    # What looked like cogging may have been what the terms explain.
    regression = replace(near.regression, whitening=None, cogging=()).with_terms(
        terms, zero_nm, near.regression.middle_s
    )
    starts = (_At.of(regression, start) for start in velocity_starts(regression, shape))
    best = min((_descend(start, most_steps=1, within=ROUGH_STEP)[0] for start in starts), key=lambda at: at.cost)
    rough = _with_cogging(_iterated(best, within=ROUGH_STEP), within=ROUGH_STEP)
    counted = rough.regression.recounted(rough.shape).whitened(
        rough.shape, float(rough.linear[COULOMB]), rough.residual
    )
    return _with_cogging(_iterate(counted, rough.shape, within=CONVERGED_STEP), within=CONVERGED_STEP)


def linear_solution(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Least squares of ``target`` (samples,) by ``columns`` (unknowns, samples)."""
    return normal_solution(columns, columns @ target)


def normal_solution(
    columns: FloatArray,
    right: FloatArray,
    contamination: FloatArray | None = None,
    shared: SharedErrors | None = None,
) -> FloatArray:
    """The normal equations of scaled columns with this right side; columns that say nothing get zero.

    What errors add to the columns' squares, ``contamination``, and to their products, ``shared``, is taken off again:
    they would shrink what is estimated. Columns beyond its length have none.
    """
    matrix = columns @ columns.T
    matrix[:5, :5] -= 0.0 if shared is None else shared.of_columns
    scale = np.sqrt(np.diag(matrix))
    scale[scale == 0] = 1.0
    matrix /= np.outer(scale, scale)
    if contamination is not None:
        at = np.arange(len(contamination))
        matrix[at, at] -= contamination / scale[: len(at)] ** 2
    return np.asarray(np.linalg.lstsq(matrix, right / scale, rcond=1e-13)[0] / scale)


@dataclass(frozen=True)
class _At:
    """The regression at one shape, solved for what is linear."""

    regression: Regression
    shape: Shape
    columns: FloatArray
    memory: Memory
    white_memory: Memory
    seen: FloatArray  # of the columns, what least squares sees
    linear: FloatArray
    states: FloatArray  # that the friction had after each rest, for every sample
    residual: FloatArray
    innovation: FloatArray
    cost: float
    shared: SharedErrors | None = None

    @classmethod
    def of(cls, regression: Regression, shape: Shape) -> "_At":
        return cls.solved(regression, shape, *regression.columns(shape))

    @classmethod
    def solved(cls, regression: Regression, shape: Shape, columns: FloatArray, memory: Memory) -> "_At":
        """With the regression's own columns at this shape, which no whitening changes."""
        contamination, shared = regression.contamination(), regression.shared_contamination(shape)
        white_memory = regression.white_memory(memory)
        white = regression.white(np.concatenate([columns, regression.target()[None, :]]))
        *_, wanted = left = white_memory.taken_off(white)
        seen = left[:-1]
        (right := seen @ wanted)[:5] += 0.0 if shared is None else shared.pull(np.zeros(5))
        linear = normal_solution(seen, right, contamination, shared)
        innovation = wanted - linear @ seen
        states = white_memory.factors(white[-1] - linear @ white[:-1])
        residual = regression.target() - linear @ columns - states * memory.left
        # Errors in the columns add this to the squares of the innovations.
        cost = float(innovation @ innovation - contamination @ linear[:5] ** 2)
        cost -= 0.0 if shared is None else shared.square(linear)
        return cls(
            regression, shape, columns, memory, white_memory, seen, linear, states, residual, innovation, cost, shared
        )

    def solution(self, *, converged: bool) -> Solution:
        """What the search ends with."""
        return Solution(
            shape=self.shape,
            linear=self.linear,
            residual=self.residual,
            innovation=self.innovation,
            jacobian=np.concatenate([self.seen, self.slopes]).T,
            free=self.regression.free,
            contamination=self.contamination,
            cost=self.cost,
            regression=self.regression,
            converged=converged,
        )

    @cached_property  # of the last step of a search, and of the solution
    def slopes(self) -> FloatArray:
        """Change of the prediction with the free unknowns of the shape, shape (free, samples)."""
        slopes = self.regression.jacobian(self.shape, self.columns, self.linear, self.memory, self.states)
        return self.white_memory.taken_off(self.regression.white(slopes[list(self.regression.free)]))

    @property
    def contamination(self) -> FloatArray:
        """What errors of readings add to the squares of the linear columns and of the free slopes, (parameters,)."""
        regression = self.regression
        columns = np.zeros(len(self.linear) + len(regression.free))
        columns[:5] = regression.contamination()
        if MOTION_DELAY in regression.free:
            place = len(self.linear) + regression.free.index(MOTION_DELAY)
            columns[place] = regression.slope_contamination(self.linear)
        return columns

    def bettered(
        self, step: FloatArray, low: FloatArray, high: FloatArray, longest: FloatArray, most: int | None
    ) -> "_At | None":
        """The first of so many shares of a step, inside the box, that is better; None where none is."""
        place = self.shape.as_array()
        places = (stepped(place, each, low, high) for each in islice(shortened(step, longest), most))
        trials = (_At.of(self.regression, self.shape.at(each)) for each in places)
        return next((trial for trial in trials if trial.cost < self.cost), None)

    def step_within(self, low: FloatArray, high: FloatArray, longest: FloatArray) -> tuple[FloatArray, float]:
        """As :meth:`step`; what would leave the box goes to its side, and the others go on without it."""
        step, squared_deviations = self.step()
        place = self.shape.as_array()
        wanted = place + np.clip(step, -longest, longest)
        leaves = (wanted > high) | (wanted < low)
        if not leaves.any():
            return step, squared_deviations
        others, squared_deviations = self.step(frozenset(np.flatnonzero(leaves)))
        return np.where(leaves, np.clip(wanted, low, high) - place, others), squared_deviations

    def step(self, held: frozenset[int] = frozenset()) -> tuple[FloatArray, float]:
        """Of Gauss-Newton, shape (unknowns,); zero for what is ``held`` or not free. And how far that is, in squared
        deviations."""
        linear = len(self.linear)
        free = [(linear + k, place) for k, place in enumerate(self.regression.free) if place not in held]
        moved = [*range(linear), *(row for row, _ in free)]
        contamination = self.contamination[moved]
        every = np.concatenate([self.seen, self.slopes])[moved]
        right = every @ self.innovation
        # The linear unknowns stand at their optimum, where errors in the columns leave them this much of a slope.
        right[:linear] += contamination[:linear] * self.linear
        if self.shared is not None:
            right[:5] += self.shared.pull(self.linear)
            if free and free[0][1] == BANDWIDTH:
                right[linear] += self.regression.shared_slope(self.shape, self.linear)
        whole = normal_solution(every, right, contamination, self.shared)
        if right @ whole < 0.0:
            # With coarse counts more may be taken off for their errors than there is: that is no way down.
            whole = normal_solution(every, right)
        step = np.zeros(MOTION_DELAY + 1 + self.regression.scales.size)
        step[[place for _, place in free]] = whole[linear:]
        # All of the residual: with coarse counts what is taken off for their errors may leave nothing of it.
        variance = self.regression.alike * float(self.innovation @ self.innovation) / self.innovation.size
        return step, float(right @ whole) / max(variance, 1e-300)


def _starts(regression: Regression) -> list[_At]:
    tick_s = regression.rows[0].signals.tick_s
    shapes = [Shape(START_BANDWIDTHS[1], s, tick_s, 0.0) for s in SCAN_S]
    best = min(shapes, key=lambda shape: _At.of(regression, shape).cost)
    return [_At.of(regression, replace(best, bandwidth_rad_s=bandwidth)) for bandwidth in START_BANDWIDTHS]


def _first_settled(regression: Regression, ends: list[_At]) -> Solution:
    """From the best end of the low band; from the next where that leads nowhere."""
    solutions = []
    for end in ends:
        solutions.append(_iterate(regression, end.shape, within=ROUGH_STEP))
        if solutions[-1].converged:
            break
    return min(solutions, key=lambda solution: (not solution.converged, solution.cost))


def _with_cogging(solution: Solution, *, within: FloatArray) -> Solution:
    """The same with every wave that stands out of what is left."""
    for _ in range(MOST_COGGINGS - len(solution.regression.cogging)):
        regression = solution.regression
        position = regression.position(solution.shape)
        weight = None if regression.whitening is None else regression.whitening.scale**2
        periods = strongest_period(position, solution.residual, regression.alike, weight)
        if periods is None or not is_new(periods, regression.cogging, position):
            break
        more = replace(regression, cogging=(*regression.cogging, periods))
        solution = _iterate(more, solution.shape, within=within)
    return solution


def _iterate(regression: Regression, shape: Shape, *, within: FloatArray) -> Solution:
    """To the minimum nearest to ``shape``."""
    return _iterated(_At.of(regression, shape), within=within)


def _iterated(at: _At, *, within: FloatArray) -> Solution:
    """To the minimum nearest to it."""
    at, converged = _descend(at, most_steps=MOST_STEPS, within=within)
    return at.solution(converged=converged)


def _descend(at: _At, *, most_steps: int, within: FloatArray) -> tuple[_At, bool]:
    """Gauss-Newton on the projected problem with step halving, inside the box, until a step is ``within`` that.

    Returns where it ended and whether it converged.
    """
    regression = at.regression
    low, high = box(regression, at.shape)
    within, longest = (of_terms_too(each, regression) for each in (within, LONGEST_STEP))
    for _ in range(most_steps):
        step, squared_deviations = at.step_within(low, high, longest)
        # What the data hardly tell, such as a bandwidth far above theirs, may wander on for ever.
        if np.all(np.abs(step) < within) or abs(squared_deviations) < NOTHING_GAINED:
            return at, True
        little = abs(squared_deviations) < LITTLE_GAINED
        # Where little is to be gained, one try will do.
        result = at.bettered(step, low, high, longest, 1 if little else None)
        if result is None and not little:
            # Of what is told so little that its step leads out of the box, the others shall not depend.
            step, squared_deviations = at.step_within(low, high, np.full(longest.size, np.inf))
            result = at.bettered(step, low, high, np.maximum(longest, high - low), None)
            # A bandwidth and a delay that stand for each other must go together, as far as the box lets both.
            result = result or at.bettered(
                inside(at.step()[0], at.shape.as_array(), low, high), low, high, longest, None
            )
        if result is None:
            # Gauss-Newton cannot improve: at the minimum to within rounding, or where nothing tells.
            settled = abs(squared_deviations) < NO_STEP_BETTER
            return at, settled or bool(np.all(np.abs(step) < 100 * within))
        at = result
    # So slow a search is one in which readings' errors hide the way; it is over where little is to be gained.
    return at, abs(at.step_within(low, high, longest)[1]) < LITTLE_GAINED
