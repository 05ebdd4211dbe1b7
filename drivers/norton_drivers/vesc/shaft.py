"""Where the shaft of a drive is that tells a position in steps and a speed in electrical turns."""

from math import pi
from typing import Self

from norton_drivers.codecs import vesc as protocol
from norton_drivers.readings import Unwrapped

TURN_RAD = 2 * pi


class VescShaft:
    """In the drive's own sense. ``velocity_rad_s`` is None until a speed has come.

    A position comes modulo ``span`` steps of ``step_rad``; a speed in steps of ``erpm_step``, of which each electrical
    turn a minute is ``rad_s_per_erpm``.
    """

    def __init__(self, step_rad: float, span: int, rad_s_per_erpm: float, erpm_step: float) -> None:
        self.velocity_rad_s: float | None = None
        self.step_rad = step_rad
        self._rad_s_per_erpm = rad_s_per_erpm
        self._erpm_step = erpm_step
        self._followed = Unwrapped(span)
        self._last: tuple[int, float] | None = None  # arrival [ns] and velocity [rad/s] at the last position

    @classmethod
    def by_encoder(cls, pole_pairs: int, codes_per_turn: int) -> Self:
        """By an angle within a turn."""
        return cls(TURN_RAD / codes_per_turn, codes_per_turn, TURN_RAD / 60 / pole_pairs, protocol.ERPM_STEP)

    @classmethod
    def by_tachometer(cls, pole_pairs: int) -> Self:
        """By the count of sixths of electrical turns."""
        step_rad = TURN_RAD / (protocol.TACHOMETER_PER_ELECTRICAL_TURN * pole_pairs)
        return cls(step_rad, protocol.TACHOMETER_SPAN, TURN_RAD / 60 / pole_pairs, protocol.ERPM_STEP)

    def on_erpm(self, erpm: float) -> None:
        """The electrical speed, as it was cut off."""
        self.velocity_rad_s = protocol.middle(erpm, self._erpm_step) * self._rad_s_per_erpm

    def position_rad(self, code: int, arrival_ns: int) -> float:
        """From a code, in steps: the velocity tells which turn it is in."""
        velocity_rad_s = self.velocity_rad_s or 0.0
        expected_rad = 0.0
        if self._last is not None:
            last_ns, last_rad_s = self._last
            expected_rad = 0.5 * (velocity_rad_s + last_rad_s) * (arrival_ns - last_ns) * 1e-9
        self._last = arrival_ns, velocity_rad_s
        return self._followed.follow(code, expected_rad / self.step_rad) * self.step_rad
