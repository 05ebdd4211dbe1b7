"""Zero torque: proportional-integral feedback, damped while contacts stick and bolder while they slide."""

from dataclasses import dataclass, field
from math import exp, sqrt

from bench.control.design import TorqueGains

# Where the foreseen motion is trusted, feedback waits until the torque, averaged over so many ticks, is beyond so many
# deviations of the sensor's noise, and forgets what it added within this time.
AVERAGED_TICKS = 5.0
DEVIATIONS = 3.0
FORGETS_S = 0.1
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
    noise_nm: float = 0.0  # standard deviation of one torque reading
    _averaged_nm: float = field(default=0.0, init=False)
    _added_nm: float = field(default=0.0, init=False)
    _torque_nm: float = field(default=0.0, init=False)
    _damping_nm: float = field(default=0.0, init=False)
    _turned_at_rad: float = field(default=0.0, init=False)
    _farthest_rad: float = field(default=0.0, init=False)

    def begin(self, torque_nm: float, position_rad: float, velocity_rad_s: float) -> None:
        """Sticking where the shaft is at rest; one that moves has slid, and its damping ended long ago."""
        self._torque_nm = torque_nm
        self._averaged_nm = self._added_nm = 0.0
        self._turned_at_rad, self._farthest_rad = position_rad - MOVING_S * velocity_rad_s, position_rad
        self._damping_nm = -self._sticking(position_rad) * self.gains.damping_nms_rad * velocity_rad_s

    def change_nm(
        self, torque_nm: float, position_rad: float, velocity_rad_s: float, *, bold: bool, trusting: bool = False
    ) -> float:
        """What to add to the last command; not ``bold`` where little is left to mend, and noise would be most of it.

        ``trusting`` a foreseen motion that is known to a per cent, only what noise cannot explain is mended.
        """
        share = self._beyond_noise(torque_nm) if trusting else 1.0
        self._follow(position_rad)
        sticking = self._sticking(position_rad)
        boost = self.gains.boost + (1 - self.gains.boost) * sticking if bold else 1.0
        rise_nm, self._torque_nm = torque_nm - self._torque_nm, torque_nm
        damping_nm = -share * sticking * self.gains.damping_nms_rad * velocity_rad_s
        damped_nm, self._damping_nm = damping_nm - self._damping_nm, damping_nm
        feedback_nm = self.gains.proportional * rise_nm + self.gains.integral_per_s * self.tick_s * torque_nm
        added_nm = share * boost * feedback_nm - (self._added_nm * self.tick_s / FORGETS_S if trusting else 0.0)
        self._added_nm += added_nm
        return added_nm + damped_nm

    def _beyond_noise(self, torque_nm: float) -> float:
        """The share of the averaged torque that is no noise, 0 to 1."""
        weight = 1 / AVERAGED_TICKS
        self._averaged_nm += weight * (torque_nm - self._averaged_nm)
        hidden_nm = DEVIATIONS * self.noise_nm * sqrt(weight / (2 - weight))
        return max(1.0 - hidden_nm**2 / max(self._averaged_nm**2, 1e-18), 0.0)

    def _sticking(self, position_rad: float) -> float:
        return exp(-abs(position_rad - self._turned_at_rad) / self.turn_rad)

    def _follow(self, position_rad: float) -> None:
        direction = self._farthest_rad - self._turned_at_rad
        beyond = position_rad - self._farthest_rad
        if direction * beyond >= 0:
            self._farthest_rad = position_rad
        elif abs(beyond) > self.play_rad:
            self._turned_at_rad, self._farthest_rad = self._farthest_rad, position_rad
