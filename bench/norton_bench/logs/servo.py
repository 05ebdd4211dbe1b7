"""A servo with a known load, simulated from its goal or its command alone: what is known of it and what is sought."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from math import ceil

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.statistics import sandwich
from norton_bench.logs.axis_inputs import inputs_of, load_of, loop_of
from norton_bench.logs.grid import Stretch
from norton_bench.logs.steps import Axis, Friction, Inputs, Load, Loop, Motor, simulate

# Of one step: half of it changes no result by more than an encoder's tick.
LONGEST_S = 1e-3
# From so many samples the velocity at the start is taken.
START_SAMPLES = 12

UNITS = {
    "torque_constant": ("N*m/A", "N/A"),
    "winding_resistance": ("ohm", "ohm"),
    "source_resistance": ("ohm", "ohm"),
    "inertia": ("kg*m^2", "kg"),
    "viscous_damping": ("N*m*s/rad", "N*s/m"),
    "coulomb_torque": ("N*m", "N"),
    "offset": ("N*m", "N"),
    "gravity_zero": ("rad", "rad"),
    "stribeck_torque": ("N*m", "N"),
    "load_coefficient": ("1", "1"),
    "load_stiction_coefficient": ("1", "1"),
    "stribeck_velocity": ("rad/s", "m/s"),
}


@dataclass(frozen=True)
class ServoModel:
    """One rung: the friction that a servo is taken to have; ``extra`` are its numbers beyond Coulomb and viscous."""

    name: str
    extra: tuple[str, ...] = ()


LADDER = (
    ServoModel("coulomb-viscous"),
    ServoModel("stribeck", ("stribeck_torque", "stribeck_velocity")),
    ServoModel("load-dependent", ("load_coefficient",)),
    ServoModel("load-dependent-stribeck", ("load_coefficient", "load_stiction_coefficient", "stribeck_velocity")),
)


@dataclass(frozen=True)
class ServoLog:
    """One uninterrupted part of a log: what acted, the position that came of it (n,), and where both begin."""

    inputs: Inputs
    load: Load
    loop: Loop
    position: FloatArray
    start_velocity: float

    @classmethod
    def of(cls, stretch: Stretch, *, translation: bool) -> "ServoLog":
        position = stretch.columns["position"]
        return cls(
            inputs=inputs_of(stretch)._replace(supply=_supply(stretch)),
            load=load_of(stretch, translation=translation),
            loop=loop_of(stretch, sampled=False),
            position=position,
            start_velocity=_velocity(stretch.time_s, position, 0),
        )

    def part(self, begin: int, end: int) -> "ServoLog":
        """Its samples from ``begin`` to before ``end``, as a log that begins there as it was measured."""
        rows = slice(begin, end)
        velocity = _velocity(self.inputs.time_s, self.position, begin) if begin else self.start_velocity
        return replace(self, inputs=self.inputs.part(rows), position=self.position[rows], start_velocity=velocity)


def _velocity(time_s: FloatArray, position: FloatArray, at: int) -> float:
    """The slope of a line through the samples around ``at``, or behind it where nothing is before."""
    few = slice(max(at - START_SAMPLES // 2, 0), max(at + START_SAMPLES // 2, START_SAMPLES))
    return float(np.polyfit(time_s[few], position[few], 1)[0])


def _supply(stretch: Stretch) -> FloatArray:
    """What the drive is fed with: a switched drive's supply is read at any moment of the switching, so the middle."""
    if "supply" not in stretch.columns:
        return np.ones(len(stretch.time_s))
    return np.full(len(stretch.time_s), float(np.median(stretch.columns["supply"])))


def simulate_motion(log: ServoLog, values: Mapping[str, float], longest_s: float = LONGEST_S) -> FloatArray:
    """The position at the log's instants, shape (n,), from its start on. ``values`` by the names of ``UNITS``, in SI;
    what is not among them is zero."""
    get = values.get
    axis = Axis(
        inertia=values["inertia"],
        motor=Motor(values["torque_constant"], get("winding_resistance", 0.0), get("source_resistance", 0.0)),
        friction=Friction(
            viscous=get("viscous_damping", 0.0),
            coulomb=get("coulomb_torque", 0.0),
            stiction=get("stribeck_torque", 0.0),
            load_coefficient=get("load_coefficient", 0.0),
            load_stiction=get("load_stiction_coefficient", 0.0),
            stribeck_velocity=get("stribeck_velocity", 1.0),
        ),
        offset=get("offset", 0.0),
    )
    load = log.load._replace(gravity_zero=log.load.gravity_zero + get("gravity_zero", 0.0))
    return simulate(axis, load, log.loop, log.inputs, float(log.position[0]), log.start_velocity, longest_s)


def joined_time(logs: Sequence[ServoLog]) -> FloatArray:
    """The instants of all logs, one after the other."""
    spans = [float(log.inputs.time_s[-1] - log.inputs.time_s[0]) for log in logs]
    begins = accumulate(spans, initial=0.0)
    return np.concatenate(
        [log.inputs.time_s - log.inputs.time_s[0] + begin for log, begin in zip(logs, begins, strict=False)]
    )


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


# Output-error refinement of a servo: the parameters whose simulated motion is nearest to the logged one.
#
# The equation of motion starts it. The error is weighted robustly: where a simulation sticks and the machine slips,
# the difference says little of how far a parameter is off. Starts from several places, and a fit that did not settle
# says so.
@dataclass(frozen=True)
class Box:
    """Where a parameter is searched: ``scale`` is its usual size, ``low`` and ``high`` are in SI."""

    scale: float
    low: float
    high: float


@dataclass(frozen=True)
class FittedLogs:
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

    def pieces(self, longest_s: float) -> "FittedLogs":
        """The chosen samples alone, in pieces of even length that each begin as measured (multiple shooting)."""
        cut = [piece for log, rows in zip(self.logs, self.chosen, strict=True) for piece in _cut(log, rows, longest_s)]
        return FittedLogs(tuple(cut), tuple(np.ones(piece.position.size, dtype=bool) for piece in cut))

    @property
    def spread(self) -> float:
        """Of the chosen positions about their mean."""
        pieces = [log.position[rows] for log, rows in zip(self.logs, self.chosen, strict=True)]
        return float(np.std(np.concatenate(pieces)))

    @property
    def time_s(self) -> FloatArray:
        return joined_time(self.logs)[np.concatenate(self.chosen)]


def _cut(log: ServoLog, rows: BoolArray, longest_s: float) -> Iterator[ServoLog]:
    edges = np.flatnonzero(np.diff(rows, prepend=False, append=False))
    for first, last in edges.reshape(-1, 2).tolist():
        span_s = float(log.inputs.time_s[last - 1] - log.inputs.time_s[first])
        count = min(max(ceil(span_s / longest_s), 1), max((last - first) // START_SAMPLES, 1))
        run = log.part(first, last)
        for begin, end in pairwise(np.linspace(0, last - first, count + 1).astype(int).tolist()):
            yield run.part(begin, end)


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
    trial: FittedLogs,
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

    trial: FittedLogs
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
        edges = ((at - self.low < near) & (self.low != 0.0)) | (self.high - at < near)
        return tuple(name for name, edge in zip(self.names, edges, strict=True) if edge)
