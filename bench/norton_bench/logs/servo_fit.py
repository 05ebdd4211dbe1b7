"""Output-error refinement of a servo: the parameters whose simulated motion is nearest to the logged one.

The equation of motion starts it. The error is weighted robustly: where a simulation sticks and the machine slips, the
difference says little of how far a parameter is off. Starts from several places, and a fit that did not settle says so.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.covariance import sandwich
from norton_bench.logs.servo import ServoLog, ServoModel, joined_time, simulate_motion

# Of the scaled parameters: steps for derivatives, wide enough to pass over the roughness of sticking and slipping.
STEP = 1e-2
AT_BOUND = 1e-3
# Of the spread of the positions: errors beyond it weigh less.
ROBUST = 0.05
FIRST_ROUNDS = 12
MOST_ROUNDS = 60
SETTLED = 1e-4
# Starts besides the given ones, and how far they scatter in the logarithm.
SCATTERED = 5
SCATTER = 0.4
HOPEFUL = 3
HOPS = 3
HOP = 0.2
# Of the cost: between minima nearer than this, the logs do not decide.
AS_GOOD = 0.02


@dataclass(frozen=True)
class Box:
    """Where a parameter is searched: ``scale`` is its usual size, ``low`` and ``high`` are in SI."""

    scale: float
    low: float
    high: float


@dataclass(frozen=True)
class Trial:
    """The logs of a fit, and which samples of each are fitted."""

    logs: tuple[ServoLog, ...]
    chosen: tuple[BoolArray, ...]

    def errors(self, values: Mapping[str, float]) -> FloatArray:
        """Logged less simulated position at the chosen samples, shape (chosen,)."""
        return np.concatenate([error[rows] for error, rows in zip(self.each(values), self.chosen, strict=True)])

    def each(self, values: Mapping[str, float]) -> Iterator[FloatArray]:
        """The same log by log, at every sample; zeros where nothing of a log is chosen."""
        for log, rows in zip(self.logs, self.chosen, strict=True):
            yield log.position - simulate_motion(log, values) if rows.any() else np.zeros(rows.shape)

    @property
    def spread(self) -> float:
        """Of the chosen positions about their mean."""
        pieces = [log.position[rows] for log, rows in zip(self.logs, self.chosen, strict=True)]
        return float(np.std(np.concatenate(pieces)))

    @property
    def time_s(self) -> FloatArray:
        return joined_time(self.logs)[np.concatenate(self.chosen)]


@dataclass(frozen=True)
class ServoFit:
    """``values`` and ``deviations`` by name in SI; ``at_bound`` names what lies at the edge of its box."""

    model: ServoModel
    values: Mapping[str, float]
    deviations: Mapping[str, float]
    at_bound: tuple[str, ...]
    converged: bool
    cost: float


def fit_servo(
    trial: Trial,
    model: ServoModel,
    boxes: Mapping[str, Box],
    starts: Sequence[Mapping[str, float]],
    *,
    scattered: int = SCATTERED,
    hops: int = HOPS,
) -> ServoFit:
    """The best of what is reached from ``starts`` and from ``scattered`` places around the first, then searched for
    ``hops`` times beside it: sticking makes the error rough."""
    search = _Search(trial, tuple(boxes), tuple(boxes.values()))
    begins = [search.scaled(start) for start in starts]
    random = np.random.default_rng(0)
    begins += [begins[0] * np.exp(SCATTER * random.standard_normal(len(boxes))) for _ in range(scattered)]
    first = [search.run(begin, FIRST_ROUNDS) for begin in begins]
    hopeful = sorted(first, key=lambda reached: reached.cost)[:HOPEFUL]
    minima = [search.run(each.x, MOST_ROUNDS) for each in hopeful]
    for _ in range(hops):
        beside = _best(minima).x * np.exp(HOP * random.standard_normal(len(boxes)))
        minima.append(search.run(beside, MOST_ROUNDS))
    reached = _best(minima)
    undecided = spread_of_equals([each.cost for each in minima], np.array([each.x for each in minima]))
    deviations = np.hypot(search.deviations(reached), undecided * [box.scale for box in boxes.values()])
    return ServoFit(
        model=model,
        values=search.values(reached.x),
        deviations=dict(zip(boxes, deviations.tolist(), strict=True)),
        at_bound=search.at_bound(reached.x),
        converged=reached.status > 0,
        cost=float(reached.cost),
    )


def spread_of_equals(costs: Sequence[float], places: FloatArray) -> FloatArray:
    """Rms distance from the cheapest of ``places``, shape (minima, parameters), to those that are as good: which of
    them is cheapest is no more than the roughness of the error, and of the machine's rounding. Zeros where none is."""
    best = int(np.argmin(costs))
    others = [
        place for index, place in enumerate(places) if index != best and costs[index] <= (1 + AS_GOOD) * costs[best]
    ]
    return np.sqrt(np.mean((np.array(others) - places[best]) ** 2, axis=0)) if others else np.zeros(places.shape[1])


def _best(minima: Sequence[OptimizeResult]) -> OptimizeResult:
    return min(minima, key=lambda reached: reached.cost)


@dataclass(frozen=True)
class _Search:
    """Robust least squares in parameters over their scales."""

    trial: Trial
    names: tuple[str, ...]
    boxes: tuple[Box, ...]

    @property
    def low(self) -> FloatArray:
        return np.array([box.low / box.scale for box in self.boxes])

    @property
    def high(self) -> FloatArray:
        return np.array([box.high / box.scale for box in self.boxes])

    def scaled(self, values: Mapping[str, float]) -> FloatArray:
        """Inside the box; what is not among the values starts at a tenth of its scale."""
        at = [values.get(name, 0.1 * box.scale) / box.scale for name, box in zip(self.names, self.boxes, strict=True)]
        return np.clip(at, self.low, self.high)

    def values(self, at: FloatArray) -> dict[str, float]:
        sizes = [box.scale for box in self.boxes]
        return dict(zip(self.names, (at * sizes).tolist(), strict=True))

    def errors(self, at: FloatArray) -> FloatArray:
        return self.trial.errors(self.values(at)) / self.trial.spread

    def slopes(self, at: FloatArray) -> FloatArray:
        """Differences, away from the nearer edge, shape (samples, parameters)."""
        here = self.errors(at)
        steps = np.where(at + STEP > self.high, -STEP, STEP)
        moved = (self.errors(at + step * unit) for step, unit in zip(steps, np.eye(at.size), strict=True))
        return np.stack([(there - here) / step for there, step in zip(moved, steps, strict=True)], axis=1)

    def run(self, begin: FloatArray, rounds: int) -> OptimizeResult:
        inside = 1e-6 * np.minimum(self.high - self.low, 1.0)
        return least_squares(
            self.errors,
            np.clip(begin, self.low + inside, self.high - inside),
            self.slopes,
            bounds=(self.low, self.high),
            loss="soft_l1",
            f_scale=ROBUST,
            ftol=SETTLED,
            xtol=SETTLED,
            max_nfev=rounds,
        )

    def deviations(self, reached: OptimizeResult) -> FloatArray:
        """In SI; from the robustly weighted errors, their colouring included."""
        errors, slopes = self.errors(reached.x), self.slopes(reached.x)
        # Half the power: jacobian and residual each carry it.
        weight = (1.0 + (errors / ROBUST) ** 2) ** -0.25
        covariance = sandwich(slopes * weight[:, None], errors * weight, self.trial.time_s)
        return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)) * [box.scale for box in self.boxes])

    def at_bound(self, at: FloatArray) -> tuple[str, ...]:
        """Zero is a value that a parameter may have where its box begins there."""
        near = AT_BOUND * np.maximum(self.high - self.low, 0.0)
        edges = ((at - self.low < near) & (self.low > 0.0)) | (self.high - at < near)
        return tuple(name for name, edge in zip(self.names, edges, strict=True) if edge)
