"""The reference a little ahead of time, for when a command sent now has taken effect."""

from dataclasses import dataclass

import numpy as np

from norton_bench.control.dynamics import FloatArray
from norton_bench.sample import Target


@dataclass
class Reference:
    """What is remembered of it; inertia and the friction of a contact are carried along its path.

    The instant is ``between`` (a share of a tick) beyond one tick before the newest that is known. ``path`` holds the
    contact's force [N m], and velocity [rad/s] and acceleration [rad/s²] of the newest instant.
    """

    inertia_kgm2: float
    between: float

    def __post_init__(self) -> None:
        self.path: FloatArray = np.zeros(3)

    def begin(self, ahead: Target, contact_nm: float) -> None:
        """The contact starts out as the load's own."""
        self.path[:] = contact_nm, ahead.velocity_rad_s, ahead.acceleration_rad_s2


def continued(target: Target, before: Target, ticks: int, tick_s: float) -> Target:
    """The reference ``ticks`` from now where nobody says: along the last slope of its acceleration."""
    slope = target.acceleration_rad_s2 - before.acceleration_rad_s2
    duration_s = ticks * tick_s
    velocity = target.velocity_rad_s + duration_s * (target.acceleration_rad_s2 + 0.5 * slope * ticks)
    return Target(target.position_rad, velocity, target.acceleration_rad_s2 + slope * ticks)
