"""The motion of a log: filtered, differentiated, and taken as much later as command or exertion are late."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from norton_bench.arrays import FloatArray
from norton_bench.logs.grid import Filters, Stretch, integral, slope


@dataclass(frozen=True)
class Motion:
    """Filtered motion of one stretch, arrays (n,)."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @classmethod
    def of(cls, stretch: Stretch, filters: Filters, later_s: float = 0.0) -> "Motion":
        """From the position or, where only velocity was logged, from that; ``later_s`` after each instant."""
        name = stretch.motion_name
        return cls.of_column(name, stretch.columns[name], filters, later_s)

    @classmethod
    def of_column(cls, name: str, logged: FloatArray, filters: Filters, later_s: float = 0.0) -> "Motion":
        """``name`` is position or velocity."""
        if name == "position":
            return cls.of_position(logged, filters, later_s)
        velocity = moved(filters.smooth(logged), filters.dt_s, later_s)
        return cls(integral(velocity, filters.dt_s), velocity, slope(velocity, filters.dt_s))

    @classmethod
    def of_position(cls, logged: FloatArray, filters: Filters, later_s: float) -> "Motion":
        """What is moved in time has passed the low-pass: between its samples nothing is lost."""
        position = moved(filters.smooth(logged), filters.dt_s, later_s)
        velocity = slope(position, filters.dt_s)
        return cls(position, velocity, slope(velocity, filters.dt_s))


# Samples beyond what is asked for, so that the end of a spline is far away.
BEYOND = 12


def moved(values: FloatArray, dt_s: float, later_s: float) -> FloatArray:
    """``later_s`` after each of evenly spaced samples (n,); beyond their ends they go on turned round, as filters
    take them: a kink there would ring through every filter."""
    if later_s == 0.0:
        return values
    reach = min(int(np.ceil(abs(later_s) / dt_s)) + BEYOND, len(values) - 1)
    longer = np.concatenate([2 * values[0] - values[reach:0:-1], values, 2 * values[-1] - values[-2 : -reach - 2 : -1]])
    at = np.arange(len(values)) + reach + later_s / dt_s
    return np.asarray(make_interp_spline(np.arange(len(longer), dtype=np.float64), longer, k=5)(at))


@dataclass(frozen=True)
class Delays:
    """What command and exertion of a row belong to: the motion so many seconds later. ``sought`` are those that the
    equation has a column for."""

    command_s: float = 0.0
    exertion_s: float = 0.0
    sought: tuple[str, ...] = ()

    def reference_s(self, *, exertion: bool) -> float:
        """How much later than its row the motion is taken: rows are those of the exertion, else of the command."""
        return self.exertion_s if exertion else self.command_s
