"""What every model of friction offers: columns that are linear in its coefficients once its shape is given."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.errors import ExperimentError

# Of the rms velocity: what moves faster slides.
MOVING = 0.05


@dataclass(frozen=True)
class Path:
    """The motion along which friction acts, uniformly sampled.

    Motion in radians or in metres; arrays of shape (n,).

    ``starts`` are the indices at which a stretch begins (the first is 0): what friction remembers restarts there.
    ``load`` is the exertion transmitted, for friction that depends on it. ``shares`` (stretches,) are the shares of a
    contact's strength in use as each stretch begins, where they are known. ``trained`` (n,) says which samples are
    fitted: scales are theirs alone, so that what is only predicted has no influence on a fit. Of friction at speeds
    below ``slowest``, and over ways below ``shortest``, the record tells nothing.
    """

    dt_s: float
    position: FloatArray
    velocity: FloatArray
    starts: IntArray
    load: FloatArray | None = None
    temperature_c: FloatArray | None = None
    shares: FloatArray | None = None
    trained: BoolArray | None = None
    slowest: float = 0.0
    shortest: float = 0.0

    @property
    def begin(self) -> FloatArray:
        """The share of a contact's strength in use where a stretch begins, NaN where one goes on, shape (n,).

        Where nothing else is known, what moves as a stretch begins has been sliding, and what rests is taken as
        without tension.
        """
        share = np.full(self.position.size, np.nan)
        if self.shares is not None:
            share[self.starts] = self.shares
            return share
        first = self.velocity[self.starts]
        share[self.starts] = np.sign(first) * (np.abs(first) > MOVING * self.velocity_scale)
        return share

    @property
    def velocity_between(self) -> FloatArray:
        """The mean velocity of the step that leads to each sample, shape (n,)."""
        return np.asarray(0.5 * (self.velocity + np.concatenate([self.velocity[:1], self.velocity[:-1]])))

    @property
    def velocity_scale(self) -> float:
        """The rms velocity. Raises ExperimentError for a path that does not move."""
        velocity = self.velocity if self.trained is None else self.velocity[self.trained]
        scale = float(np.sqrt(np.mean(velocity**2))) if velocity.size else 0.0
        if not (np.isfinite(scale) and scale > 0.0):
            raise ExperimentError("friction cannot be identified: the motion is missing or constant in this record")
        return scale

    @property
    def displacement_scale(self) -> float:
        """The longest way travelled in one stretch."""
        ends = np.append(self.starts[1:], self.position.size)
        trained = np.ones(self.position.size, dtype=bool) if self.trained is None else self.trained
        parts = (self.position[a:b][trained[a:b]] for a, b in zip(self.starts, ends, strict=True))
        return max(float(np.ptp(part)) for part in parts if part.size)


# Of blocks: enough that every fold meets every slow condition.
ROUNDS = 6


# One equation of motion in which friction is the unknown: a target, further linear columns, and friction's path.
@dataclass(frozen=True)
class Equation:
    """``target = coefficients @ others − friction``, in rows that may be coarser than the path.

    ``target`` and ``time_s`` (n,), ``others`` (k, n) named ``names``. ``process`` takes rows of the path's rate,
    shape (columns, path), through the filter and decimation that the target has passed: (columns, n). ``fold`` (n,)
    says which held-out fold each row belongs to; the rows of −1 are never held out and always trained on.

    ``afresh`` is the same path with a beginning at every part that is held out, as a new record begins: contacts do
    not know there what they went through before. ``settled`` (n,) are the rows in which filters do not see across
    such a beginning. None: what is held out goes on from what lies before it.

    ``variance`` (n,) is that of each row's error in units of the best rows': rows that no model can describe have more
    than one. Rows are divided by its root. None: all are alike.

    ``noise`` (n,) is the variance that noise of the readings adds to some of ``others`` in each row, by name: it would
    shrink what is estimated, and is taken off (Fuller, Measurement Error Models, section 2.2). ``noise_in_target`` is
    the noise of the target that goes with it, as a multiple of the column's. ``noise_at_zero`` is that of columns whose
    coefficients end at zero: it shrinks nothing, but it is no information either.

    Raises ExperimentError where a number is missing or infinite.
    """

    target: FloatArray
    others: FloatArray
    names: tuple[str, ...]
    path: Path
    fold: IntArray
    time_s: FloatArray
    process: Callable[[FloatArray], FloatArray]
    afresh: Path | None = None
    settled: BoolArray | None = None
    variance: FloatArray | None = None
    noise: Mapping[str, FloatArray] = field(default_factory=dict)
    noise_in_target: Mapping[str, float] = field(default_factory=dict)
    noise_at_zero: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        parts = {"target": self.target, "motion": self.path.position, "velocity": self.path.velocity}
        parts |= dict(zip(self.names, self.others, strict=True))
        for name, values in parts.items():
            if not np.isfinite(values).all():
                raise ExperimentError(f"the {name} holds missing or infinite values: cut them out of the record first")

    @property
    def scale(self) -> FloatArray:
        """What each row is multiplied by, (n,)."""
        return np.ones(self.target.size) if self.variance is None else 1.0 / np.sqrt(self.variance)


def blocked_folds(count: int, folds: int = 5) -> IntArray:
    """Folds of contiguous blocks along a record of ``count`` rows, shape (count,).

    Every fold has one block in each round, in an order that changes from round to round: blocks in a fixed order would
    fall in step with an experiment that repeats itself.
    """
    random = np.random.default_rng(0)
    order = np.concatenate([random.permutation(folds) for _ in range(ROUNDS)])
    return np.asarray(order[np.arange(count) * order.size // max(count, 1)], dtype=np.int64)


# A contact that yields within a small part of one sample's travel cannot be told from one that does not yield.
SHORTEST_TRAVEL = 1e-3
# From full tension one way to full tension the other way takes two deflections: one that is longer than this share of
# the whole travel never does that, and then is a spring whose rest nobody knows.
LONGEST_TRAVEL = 0.5
# However little a record tells, an unknown is searched between its upper bound and this share of it.
WIDEST = 0.5


class Dimension(Enum):
    """What a coefficient multiplies, or an unknown of the shape measures; each with its unit turning and sliding."""

    FRICTION = ("N*m", "N")
    DAMPING = ("N*m*s/rad", "N*s/m")
    STIFFNESS = ("N*m/rad", "N/m")
    VELOCITY = ("rad/s", "m/s")
    DISPLACEMENT = ("rad", "m")
    RATIO = ("1", "1")

    def unit(self, *, rotation: bool) -> str:
        return self.value[0] if rotation else self.value[1]


@dataclass(frozen=True)
class Unknown:
    """One unknown of a model's shape, searched in its logarithm.

    ``low`` and ``high`` of a velocity are multiples of the path's rms velocity; those of a displacement are multiples
    of one sample's travel and of the whole travel; those of a ratio are as they stand.
    """

    name: str
    dimension: Dimension
    low: float
    high: float

    def bounds(self, path: Path) -> tuple[float, float]:
        """The range searched on ``path``, in SI."""
        if self.dimension is Dimension.VELOCITY:
            low, high = max(self.low * path.velocity_scale, path.slowest), self.high * path.velocity_scale
        elif self.dimension is Dimension.DISPLACEMENT:
            low = max(self.low * path.velocity_scale * path.dt_s, path.shortest)
            high = self.high * path.displacement_scale
        else:
            low, high = self.low, self.high
        return min(low, WIDEST * high), high


@dataclass(frozen=True)
class Term:
    """One coefficient. ``nonnegative``: friction that feeds motion would not be friction."""

    name: str
    dimension: Dimension
    nonnegative: bool = True


class FrictionModel(Protocol):
    """A member of the family. Friction opposing motion is its coefficients @ ``columns(path, shape)``."""

    @property
    def name(self) -> str: ...

    @property
    def unknowns(self) -> tuple[Unknown, ...]: ...

    @property
    def terms(self) -> tuple[Term, ...]: ...

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        """Shape (terms, n), for the values of ``unknowns`` in SI, (unknowns,)."""
        ...


def remembers(model: FrictionModel) -> bool:
    """Whether its friction depends on the path."""
    return any(unknown.dimension is Dimension.DISPLACEMENT for unknown in model.unknowns)


PRESLIDING = Unknown("presliding_displacement", Dimension.DISPLACEMENT, SHORTEST_TRAVEL, 1.0)
STRIBECK = Unknown("stribeck_velocity", Dimension.VELOCITY, 1e-3, 3.0)
COULOMB = Term("coulomb_torque", Dimension.FRICTION)
VISCOUS = Term("viscous_damping", Dimension.DAMPING)
PRESLIDING_DAMPING = Term("presliding_damping", Dimension.DAMPING)
