"""The equation of a log with the simplest friction, nothing held to a sign: a wrong sign then shows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import BenchError
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.friction_model import remembers
from norton_bench.identification.separable import linear_solution
from norton_bench.identification.statistics import sandwich
from norton_bench.logs.equation import TORQUE_GAIN, Problem
from norton_bench.logs.log import Log

# Beyond these many deviations a sign is no accident.
SIGNIFICANT = 3.0
# An equation that leaves more of the exertion than this has not been understood.
UNEXPLAINED = 0.5
# A gain further from the one given than this share of it is another one, although delays are not reckoned with.
ANOTHER = 0.5


@dataclass(frozen=True)
class Basic:
    """The equation with Coulomb and viscous friction and nothing held to a sign. ``unexplained`` is over what varies.

    ``inertia``, ``gain`` and ``braking`` (mean power that friction takes) are in deviations from zero, None where they
    are not sought. ``at_port`` is what a sensor there tells beside the command, None without both.
    """

    unexplained: float
    inertia: float | None
    braking: float | None
    gain: float | None
    at_port: "AtPort | None"

    @property
    def sound(self) -> bool:
        """Whether nothing has the wrong sign."""
        if self.load is not None and self.load.negative:
            return False
        ratios = (self.inertia, self.braking, self.gain)
        return self.unidentifiable_gain or all(ratio is None or ratio > -SIGNIFICANT for ratio in ratios)

    @property
    def load(self) -> "LoadInertia | None":
        """That at the port, where the torque there follows from the motion alone."""
        return None if self.at_port is None else self.at_port.load

    @property
    def unidentifiable_gain(self) -> bool:
        """Whether a gain is sought beside a load that moves as it is driven: without any command the equation holds as
        well, with the load's inertia, turned round, as the actuator's."""
        return self.load is not None and self.gain is not None

    def with_contact(self, fit: FrictionFit) -> "Basic":
        """With the signs of a fit whose friction remembers the path: that of velocity alone may not tell them."""
        if not remembers(fit.model):
            return self
        ratio = dict(zip(fit.names, fit.values / np.maximum(fit.deviations, 1e-300), strict=True))
        inertia = None if self.inertia is None else ratio.get("inertia")
        return replace(self, inertia=inertia, braking=None, gain=ratio.get(TORQUE_GAIN))

    @classmethod
    def of(cls, problem: Problem) -> "Basic":
        equation, rows = problem.equation, problem.train
        velocity = equation.path.velocity
        columns = basic_columns(problem)[:, rows]
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
            variation(problem),
            float(parts[list(equation.names).index(TORQUE_GAIN)]) if TORQUE_GAIN in equation.names else 0.0,
        )
        ratio = dict(zip(equation.names, linear / deviation, strict=False))
        # Beside a known load the actuator's own share may be too small to have a sign: the gain's tells.
        own = problem.terms[0].load is None
        return cls(
            unexplained=rms(residual) / scale if scale > 0 else float("inf"),
            inertia=ratio.get("inertia") if own else None,
            braking=float(weights @ linear[-2:]) / spread if own else None,
            gain=ratio.get(TORQUE_GAIN),
            at_port=_at_port(problem),
        )


@dataclass(frozen=True)
class LoadInertia:
    """Of a load that is nothing else, in the unit of the inertia."""

    value: float
    std: float

    @property
    def negative(self) -> bool:
        return self.value < -SIGNIFICANT * self.std


@dataclass(frozen=True)
class AtPort:
    """What a sensor at the port tells: the inertia of a load, where the torque follows from the motion alone; and
    whether the torque asks for another gain than that given."""

    load: LoadInertia | None
    contradicts_gain: bool


def _at_port(problem: Problem) -> AtPort | None:
    """A load at the port may move as it is driven: then the gain, if it is free, is nothing, or gives the actuator a
    negative inertia, and nothing else tells a gain."""
    drive = problem.joined("drive")
    if problem.terms[0].port is None or drive is None:
        return None
    equation, rows = problem.equation, problem.train
    motions = [term.link or term.motion for term in problem.terms]
    angle, velocity, acceleration = (
        np.concatenate([getattr(motion, name) for motion in motions])
        for name in ("position", "velocity", "acceleration")
    )
    own = [acceleration, velocity, np.sign(velocity), np.ones(angle.size)]
    columns = equation.process(np.stack([*own, angle, np.sin(angle), np.cos(angle), drive]))[:, rows]
    motion, command, port, time_s = columns[:-1], columns[-1], problem.exertion[rows], equation.time_s[rows]
    free, deviations = _linear(np.concatenate([columns[: len(own)], columns[-1:]]), port, time_s)
    unidentifiable = free[0] > SIGNIFICANT * deviations[0] or abs(free[-1]) < SIGNIFICANT * deviations[-1]
    follow = (rms(_left(motion, each)) < UNEXPLAINED * np.std(each) for each in (port, command))
    if unidentifiable and all(follow):
        alone, deviations = _linear(motion, port, time_s)
        return AtPort(LoadInertia(float(alone[0]), float(deviations[0])), contradicts_gain=False)
    given = problem.terms[0].gain
    far = given is not None and abs(free[-1] - given) > max(ANOTHER * abs(given), SIGNIFICANT * deviations[-1])
    return AtPort(None, contradicts_gain=far)


def _linear(columns: FloatArray, values: FloatArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """By how much each of ``columns`` (k, n) explains ``values`` (n,) beside the others, and the deviations, (k,)."""
    linear = linear_solution(columns, values)
    covariance = sandwich(columns.T, values - linear @ columns, time_s)
    return linear, np.sqrt(np.maximum(np.diag(covariance), 1e-300))


def _left(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Of ``values`` (n,), what ``columns`` (k, n) do not explain."""
    return np.asarray(values - linear_solution(columns, values) @ columns)


def basic_columns(problem: Problem) -> FloatArray:
    """Those of the equation, then viscous and Coulomb friction, shape (columns, n)."""
    velocity = problem.equation.path.velocity
    friction = problem.equation.process(np.stack([velocity, np.sign(velocity)]))
    return np.concatenate([problem.equation.others, -friction])


def variation(problem: Problem) -> float:
    """By how much the exertion varies in training, about its mean: what a constant explains is no evidence."""
    return float(np.std(problem.exertion[problem.train]))


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def basic_of(logs: Sequence[Log], solve: Callable[[Sequence[Log]], Problem]) -> Basic:
    """That of logs that are to be fitted anew; one that explains nothing where they cannot be."""
    try:
        return Basic.of(solve(logs))
    except BenchError:
        return Basic(float("inf"), None, None, None, None)
