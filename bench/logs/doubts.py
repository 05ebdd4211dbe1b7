"""What in a log contradicts mechanics: wrong signs, swapped columns, an equation that explains nothing.

Every finding is a sentence with the mend; any of them makes all estimates doubtful.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from bench.errors import BenchError
from bench.identification.covariance import sandwich
from bench.identification.separable import linear_solution
from bench.logs.column_map import ColumnMap
from bench.logs.equation import Problem
from bench.logs.filters import Filters, slope
from bench.logs.grid import Stretch
from bench.logs.log import Log

FloatArray = npt.NDArray[np.float64]

# Beyond these many deviations a sign is no accident.
SIGNIFICANT = 3.0
# An equation that leaves more of the exertion than this has not been understood.
UNEXPLAINED = 0.5
# Swapping two columns is suspected where it leaves less than this share of what is left otherwise.
BETTER = 0.5
# A logged velocity, as a multiple of the position's derivative, and how well the two must agree.
SLOPE = (0.8, 1.25)
AGREEMENT = 0.8
# A position that leads its goal by more than this many samples, and by this many deviations.
LEAD_SAMPLES = 0.5


@dataclass(frozen=True)
class Basic:
    """The equation with Coulomb and viscous friction and nothing held to a sign; ``unexplained`` is relative.

    ``inertia`` and ``braking`` (mean power that friction takes) are in deviations from zero, None where not sought.
    """

    unexplained: float
    inertia: float | None
    braking: float | None
    gain: float | None

    @classmethod
    def of(cls, problem: Problem) -> "Basic":
        equation, rows = problem.equation, problem.train
        velocity = equation.path.velocity
        friction = equation.process(np.stack([velocity, np.sign(velocity)]))
        columns = np.concatenate([equation.others, -friction])[:, rows]
        target = equation.target[rows]
        linear = linear_solution(columns, target)
        residual = target - linear @ columns
        covariance = sandwich(columns.T, residual, equation.time_s[rows])
        deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        # Friction's power over the record is this share of each of its two coefficients.
        weights = np.array([np.mean(velocity**2), np.mean(np.abs(velocity))])
        spread = float(np.sqrt(max(weights @ covariance[-2:, -2:] @ weights, 1e-300)))
        parts = np.sqrt(np.mean((linear[:, None] * columns) ** 2, axis=1))
        scale = max(
            _rms(problem.exertion[rows]),
            float(parts[list(equation.names).index("torque_gain")]) if "torque_gain" in equation.names else 0.0,
        )
        ratio = dict(zip(equation.names, linear / deviation, strict=False))
        return cls(
            unexplained=_rms(residual) / scale if scale > 0 else float("inf"),
            inertia=ratio.get("inertia"),
            braking=float(weights @ linear[-2:]) / spread,
            gain=ratio.get("torque_gain"),
        )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def wrong_signs(basic: Basic, column_map: ColumnMap) -> Iterator[str]:
    """Inertia and dissipation are positive, and so is a gain, if the signs of the columns agree."""
    driver = "exertion" if column_map.columns.exertion is not None else "command"
    mend = f"turn the sign of {driver} or of the motion in [columns] (sign = -1)"
    if basic.gain is not None and basic.gain < -SIGNIFICANT:
        yield f"A positive command drives the shaft backwards: {mend.replace(driver, 'command')}."
    elif basic.inertia is not None and basic.inertia < -SIGNIFICANT:
        yield f"The inertia comes out negative: the signs of {driver} and motion do not agree; {mend}."
    elif basic.braking is not None and basic.braking < -SIGNIFICANT:
        yield f"Friction comes out negative, driving the motion: the signs of {driver} and motion do not agree; {mend}."


def unexplained(basic: Basic, left: float) -> Iterator[str]:
    """``left`` is what the model that was chosen leaves, relative."""
    if min(basic.unexplained, left) > UNEXPLAINED:
        yield (
            f"The equation leaves {min(basic.unexplained, left):.0%} of the exertion unexplained: check which column "
            "is which, their units and signs, and whether something else acted."
        )


def swapped(logs: Sequence[Log], basic: Basic, solve: Callable[[Sequence[Log]], Problem]) -> Iterator[str]:
    """Two columns that explain far more with their places changed."""
    names = [name for name in ("position", "velocity", "command", "exertion") if name in logs[0].columns]
    found: list[tuple[float, str]] = []
    for first, second in combinations(names, 2):
        try:
            other = Basic.of(solve([_with_swapped(log, first, second) for log in logs]))
        except BenchError:
            continue
        sound = all(ratio is None or ratio > -SIGNIFICANT for ratio in (other.inertia, other.braking))
        if sound and other.unexplained < min(BETTER * basic.unexplained, UNEXPLAINED):
            found.append(
                (other.unexplained, f"{first} and {second} seem to be swapped: change them round in [columns].")
            )
    if found:
        yield min(found)[1]


def _with_swapped(log: Log, first: str, second: str) -> Log:
    columns = dict(log.columns)
    columns[first], columns[second] = columns[second], columns[first]
    return replace(log, columns=columns)


def unlike_derivative(parts: Sequence[Stretch], filters: Filters) -> Iterator[str]:
    """A logged velocity must be the derivative of the logged position."""
    if not all({"position", "velocity"} <= set(part.columns) for part in parts):
        return
    derived, logged = _derivatives(parts, filters, "position", "velocity")
    factor, agreement = _agreement(derived, logged)
    if agreement > AGREEMENT and SLOPE[0] < factor < SLOPE[1]:
        return
    swapped_factor, swapped_agreement = _agreement(*_derivatives(parts, filters, "velocity", "position"))
    if swapped_agreement > AGREEMENT and SLOPE[0] < swapped_factor < SLOPE[1]:
        yield "position and velocity seem to be swapped: change them round in [columns]."
    elif agreement > AGREEMENT:
        yield f"velocity is {factor:.3g} times the derivative of position: check the units, scales and signs of both."
    else:
        yield "velocity is not the derivative of position: check which column is which, and the clock."


def _derivatives(
    parts: Sequence[Stretch], filters: Filters, position: str, velocity: str
) -> tuple[FloatArray, FloatArray]:
    derived, logged = [], []
    for part in parts:
        keep = part.sound & (np.arange(len(part.sound)) >= filters.margin)
        keep[-filters.margin :] = False
        derived.append(slope(filters.smooth(part.columns[position]), part.dt_s)[keep])
        logged.append(filters.smooth(part.columns[velocity])[keep])
    return np.concatenate(derived), np.concatenate(logged)


def _agreement(derived: FloatArray, logged: FloatArray) -> tuple[float, float]:
    """``logged`` as a multiple of ``derived``, and their correlation about zero."""
    power = float(derived @ derived) * float(logged @ logged)
    if power == 0.0:
        return 0.0, 0.0
    product = float(derived @ logged)
    return product / float(derived @ derived), abs(product) / float(np.sqrt(power))


def ahead_of_goal(parts: Sequence[Stretch], filters: Filters) -> Iterator[str]:
    """A controlled position follows its goal; one that leads it is the goal."""
    if not all({"position", "goal"} <= set(part.columns) for part in parts):
        return
    lag, target = [], []
    for part in parts:
        keep = slice(filters.margin, -filters.margin)
        position, goal = (filters.smooth(part.columns[name]) for name in ("position", "goal"))
        lag.append(0.5 * slope(position + goal, part.dt_s)[keep])
        target.append((position - goal)[keep])
    columns = np.stack([np.concatenate(lag), np.ones(sum(map(len, lag)))])
    error = np.concatenate(target)
    linear = linear_solution(columns, error)
    time_s = np.arange(error.size, dtype=np.float64) * parts[0].dt_s
    deviation = np.sqrt(sandwich(columns.T, error - linear @ columns, time_s)[0, 0])
    if linear[0] > max(LEAD_SAMPLES * parts[0].dt_s, SIGNIFICANT * deviation):
        yield (
            f"position runs {1e3 * linear[0]:.3g} ms ahead of its goal: the two seem to be swapped; change them round "
            "in [columns]."
        )
