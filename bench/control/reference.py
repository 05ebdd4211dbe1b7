"""The torque that the load needs along the reference, when a command sent now has taken effect."""

from dataclasses import dataclass, field

from bench.control import core
from bench.control.dynamics import FloatArray
from bench.sample import Target


@dataclass
class Reference:
    """Follows the reference a little ahead of time; inertia and the friction of a contact carried along its path.

    The instant is ``between`` (a share of a tick) beyond one tick before ``lead_ticks``.
    """

    inertia_kgm2: float
    friction_law: FloatArray
    tick_s: float
    lead_ticks: int
    between: float
    contact_nm: float = field(default=0.0, init=False)
    _far: Target = field(default_factory=Target, init=False)

    def begin(self, ahead: Target, contact_nm: float) -> None:
        """The contact starts out as the load's own."""
        self._far, self.contact_nm = ahead, contact_nm

    def torque_nm(self, ahead: Target) -> float:
        """Once a tick; ``ahead`` is the reference ``lead_ticks`` from now."""
        near, self._far = self._far, ahead
        share = self.between
        velocity = near.velocity_rad_s + share * (ahead.velocity_rad_s - near.velocity_rad_s)
        acceleration = near.acceleration_rad_s2 + share * (ahead.acceleration_rad_s2 - near.acceleration_rad_s2)
        law = self.friction_law
        self.contact_nm = core.slide(self.contact_nm, velocity * self.tick_s, law[1], law[2])
        return float(self.inertia_kgm2 * acceleration + core.friction(self.contact_nm, velocity, law))


def continued(target: Target, before: Target, ticks: int, tick_s: float) -> Target:
    """The reference ``ticks`` from now where nobody says: along the last slope of its acceleration."""
    slope = target.acceleration_rad_s2 - before.acceleration_rad_s2
    duration_s = ticks * tick_s
    velocity = target.velocity_rad_s + duration_s * (target.acceleration_rad_s2 + 0.5 * slope * ticks)
    return Target(target.position_rad, velocity, target.acceleration_rad_s2 + slope * ticks)
