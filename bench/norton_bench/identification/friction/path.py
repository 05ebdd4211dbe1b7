"""The motion along which friction acts, uniformly sampled."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.errors import ExperimentError

# Of the rms velocity: what moves faster slides.
MOVING = 0.05


@dataclass(frozen=True)
class Path:
    """Motion in radians or in metres; arrays of shape (n,).

    ``starts`` are the indices at which a stretch begins (the first is 0): what friction remembers restarts there.
    ``load`` is the exertion transmitted, for friction that depends on it.
    """

    dt_s: float
    position: FloatArray
    velocity: FloatArray
    starts: IntArray
    load: FloatArray | None = None
    temperature_c: FloatArray | None = None

    @property
    def begin(self) -> FloatArray:
        """The share of a contact's strength in use where a stretch begins, NaN where one goes on, shape (n,).

        What moves as a stretch begins has been sliding; what rests is taken as without tension.
        """
        share = np.full(self.position.size, np.nan)
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
        scale = float(np.sqrt(np.mean(self.velocity**2)))
        if not (np.isfinite(scale) and scale > 0.0):
            raise ExperimentError("friction cannot be identified: the motion is missing or constant in this record")
        return scale

    @property
    def displacement_scale(self) -> float:
        """The longest way travelled in one stretch."""
        ends = np.append(self.starts[1:], self.position.size)
        return max(
            float(np.ptp(self.position[first:end])) for first, end in zip(self.starts, ends, strict=True) if end > first
        )
