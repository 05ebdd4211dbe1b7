"""Zero torque: proportional-integral feedback, damped while contacts stick and bolder while they slide."""

from dataclasses import dataclass, field
from math import copysign, exp

from bench.control.design import TorqueGains

# A shaft that covers the way to sliding in this time is taken to slide already.
UNDER_WAY_S = 0.01
SLID_TURNS = 20.0  # ways to sliding; nothing of the sticking is left


@dataclass
class TorqueLoop:
    """Changes of the command, once a tick.

    While a contact sticks the shaft behaves like a wall, and the port sees the whole command; once it has slid, only
    the actuator's share of the inertia. The distance since the shaft last turned says which. ``turn_rad`` is the
    distance over which contacts begin to slide, ``play_rad`` how far back is a turn and no noise.
    """

    gains: TorqueGains
    tick_s: float
    turn_rad: float
    play_rad: float
    _torque_nm: float = field(default=0.0, init=False)
    _damping_nm: float = field(default=0.0, init=False)
    _turned_at_rad: float = field(default=0.0, init=False)
    _farthest_rad: float = field(default=0.0, init=False)

    def begin(self, torque_nm: float, position_rad: float, velocity_rad_s: float) -> None:
        """Sticking, until the shaft has moved, or sliding, where it is well under way.

        Damping that is taken for there and then fades as the shaft goes on would kick it.
        """
        self._torque_nm = torque_nm
        slides = abs(velocity_rad_s) * UNDER_WAY_S > self.turn_rad
        behind_rad = copysign(SLID_TURNS * self.turn_rad, velocity_rad_s) if slides else 0.0
        self._turned_at_rad, self._farthest_rad = position_rad - behind_rad, position_rad
        self._damping_nm = 0.0 if slides else -self.gains.damping_nms_rad * velocity_rad_s

    def change_nm(self, torque_nm: float, position_rad: float, velocity_rad_s: float, *, bold: bool) -> float:
        """What to add to the last command; not ``bold`` where little is left to mend, and noise would be most of it."""
        self._follow(position_rad)
        sticking = exp(-abs(position_rad - self._turned_at_rad) / self.turn_rad)
        boost = self.gains.boost + (1 - self.gains.boost) * sticking if bold else 1.0
        rise_nm, self._torque_nm = torque_nm - self._torque_nm, torque_nm
        damping_nm = -sticking * self.gains.damping_nms_rad * velocity_rad_s
        damped_nm, self._damping_nm = damping_nm - self._damping_nm, damping_nm
        feedback_nm = self.gains.proportional * rise_nm + self.gains.integral_per_s * self.tick_s * torque_nm
        return boost * feedback_nm + damped_nm

    def _follow(self, position_rad: float) -> None:
        direction = self._farthest_rad - self._turned_at_rad
        beyond = position_rad - self._farthest_rad
        if direction * beyond >= 0:
            self._farthest_rad = position_rad
        elif abs(beyond) > self.play_rad:
            self._turned_at_rad, self._farthest_rad = self._farthest_rad, position_rad
