"""What every model of friction offers: columns that are linear in its coefficients once its shape is given."""

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction.path import Path

# A contact that yields within a small part of one sample's travel cannot be told from one that does not yield.
SHORTEST_TRAVEL = 1e-3


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
            return self.low * path.velocity_scale, self.high * path.velocity_scale
        if self.dimension is Dimension.DISPLACEMENT:
            return self.low * path.velocity_scale * path.dt_s, self.high * path.displacement_scale
        return self.low, self.high


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

    @property
    def replaces(self) -> tuple[str, ...]:
        """Further columns of an equation that cannot be told from this model's own: they are left at zero."""
        ...

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        """Shape (terms, n), for the values of ``unknowns`` in SI, (unknowns,)."""
        ...


PRESLIDING = Unknown("presliding_displacement", Dimension.DISPLACEMENT, SHORTEST_TRAVEL, 1.0)
STRIBECK = Unknown("stribeck_velocity", Dimension.VELOCITY, 1e-3, 3.0)
COULOMB = Term("coulomb_torque", Dimension.FRICTION)
VISCOUS = Term("viscous_damping", Dimension.DAMPING)
PRESLIDING_DAMPING = Term("presliding_damping", Dimension.DAMPING)
