"""Zero torque: proportional-integral feedback, damped while contacts stick and bolder while they slide."""

from dataclasses import dataclass, field
from math import exp

from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.design import TorqueGains

# A shaft that moves is taken to have been moving so for this long.
MOVING_S = 0.1


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
    slow: float = 1.0
    settles_s: float = 0.0
    _torque_nm: float = field(default=0.0, init=False)
    _damping_nm: float = field(default=0.0, init=False)
    _turned_at_rad: float = field(default=0.0, init=False)
    _farthest_rad: float = field(default=0.0, init=False)
    _began_rad: float = field(default=0.0, init=False)
    _reach_rad: float = field(default=0.0, init=False)
    _known_s: float = field(default=0.0, init=False)

    def begin(self, torque_nm: float, position_rad: float, velocity_rad_s: float) -> None:
        """Sticking where the shaft is at rest; one that moves has slid, and its damping ended long ago."""
        self._torque_nm = torque_nm
        self._turned_at_rad, self._farthest_rad = position_rad - MOVING_S * velocity_rad_s, position_rad
        self._began_rad, self._reach_rad, self._known_s = position_rad, 0.0, 0.0
        self._damping_nm = -self._sticking(position_rad) * self.gains.damping_nms_rad * velocity_rad_s

    def change_nm(self, torque_nm: float, position_rad: float, velocity_rad_s: float, *, bold: bool) -> float:
        """What to add to the last command; not ``bold`` where little is left to mend, and noise would be most of it."""
        self._follow(position_rad)
        sticking = self._sticking(position_rad)
        boost = self.gains.boost + (1 - self.gains.boost) * sticking if bold else 1.0
        rise_nm, self._torque_nm = torque_nm - self._torque_nm, torque_nm
        share = self._share(position_rad)
        damping_nm = -share * sticking * self.gains.damping_nms_rad * velocity_rad_s
        damped_nm, self._damping_nm = damping_nm - self._damping_nm, damping_nm
        feedback_nm = self.gains.proportional * rise_nm + self.gains.integral_per_s * self.tick_s * torque_nm
        return share * boost * feedback_nm + damped_nm

    def _share(self, position_rad: float) -> float:
        self._reach_rad = max(self._reach_rad, abs(position_rad - self._began_rad))
        if self.slow < 1.0:
            self._known_s += self.tick_s * (1 - exp(-self._reach_rad / self.turn_rad))
        return max(self.slow, self.settles_s / (self.settles_s + self._known_s)) if self._known_s else 1.0

    def _sticking(self, position_rad: float) -> float:
        return exp(-abs(position_rad - self._turned_at_rad) / self.turn_rad)

    def _follow(self, position_rad: float) -> None:
        direction = self._farthest_rad - self._turned_at_rad
        beyond = position_rad - self._farthest_rad
        if direction * beyond >= 0:
            self._farthest_rad = position_rad
        elif abs(beyond) > self.play_rad:
            self._turned_at_rad, self._farthest_rad = self._farthest_rad, position_rad


def settles_s(gains: TorqueGains, calibration: LoadCalibration) -> float:
    """The time constant with which a standing torque at the port decays under ``gains``.

    One over that is the integral gain times what of a standing command the port sees. While both contacts slide that
    is the actuator's share of the damping, while one sticks all of it: all of it is reckoned with.
    """
    return 1.0 / (gains.integral_per_s * calibration.torque_gain)
