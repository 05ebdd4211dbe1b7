"""The two types and the two operational forms of an equivalent network (paper, sections II and VI.B)."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError


class Kind(Enum):
    """What the source gives at the port while nothing is exchanged there."""

    THEVENIN = "thevenin"  # an exertion source: what the blocked port exerts
    NORTON = "norton"  # a motion source: how the free port moves


class Form(Enum):
    """What goes in at the port, and what comes out."""

    IMPEDANCE = "impedance"  # motion in, exertion out
    ADMITTANCE = "admittance"  # exertion in, motion out


class NoConversionError(UsageError):
    """The network has no equivalent of the kind and form that was asked for; the sentence says why."""


@contextmanager
def told_as_no_conversion() -> Iterator[None]:
    """Inside, equations that cannot be rewritten (ValueError) are a NoConversionError with the same sentence."""
    try:
        yield
    except ValueError as error:
        raise NoConversionError(str(error)) from None


# What is sampled at the port: a motion with its derivatives, at the ticks.
@dataclass(frozen=True)
class Motion:
    """Angle [rad], velocity [rad/s] and acceleration [rad/s²] at each tick, shape (n,), taken as linear in between."""

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray

    @classmethod
    def of_position(cls, position_rad: npt.ArrayLike, tick_s: float) -> "Motion":
        """By central differences of the angle: give it smooth, and at least three ticks long."""
        position = np.asarray(position_rad, dtype=float)
        acceleration = np.zeros_like(position)
        acceleration[1:-1] = np.diff(position, 2) / tick_s**2
        acceleration[0], acceleration[-1] = acceleration[1], acceleration[-2]
        return cls(position, np.gradient(position, tick_s), acceleration)

    @classmethod
    def still(cls, ticks: int, position_rad: float = 0.0) -> "Motion":
        """The blocked port."""
        zero = np.zeros(ticks)
        return cls(zero + position_rad, zero, zero)

    def derivatives(self) -> FloatArray:
        """Shape (3, n): angle and what follows from it."""
        return np.stack([self.position_rad, self.velocity_rad_s, self.acceleration_rad_s2])


@dataclass(frozen=True)
class Load:
    """What is coupled to the port: f = inertia · a + damping · v + stiffness · x, in kg m², N m s/rad and N m/rad."""

    inertia_kgm2: float = 0.0
    damping_nms_rad: float = 0.0
    stiffness_nm_rad: float = 0.0
