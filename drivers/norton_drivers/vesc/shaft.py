"""A VESC's shaft: the position that goes on, from an angle within one turn or from the tachometer, and its velocity."""

from math import pi

from norton_drivers.codecs import vesc as protocol
from norton_drivers.unwrapping import Unwrapped

TURN_RAD = 2 * pi
_CODES_PER_TURN = 18_000  # of the angle in STATUS_4


class VescShaft:
    """In the drive's own sense. ``velocity_rad_s`` is None until a STATUS has come."""

    def __init__(self, pole_pairs: int, *, encoder: bool) -> None:
        self.velocity_rad_s: float | None = None
        codes_per_turn = _CODES_PER_TURN if encoder else protocol.TACHOMETER_PER_ELECTRICAL_TURN * pole_pairs
        self.step_rad = TURN_RAD / codes_per_turn
        self._rad_s_per_erpm = TURN_RAD / 60 / pole_pairs
        self._followed = Unwrapped(_CODES_PER_TURN if encoder else protocol.TACHOMETER_SPAN)
        self._last: tuple[int, float] | None = None  # arrival [ns] and velocity [rad/s] at the last position

    def on_erpm(self, erpm: float) -> None:
        """From STATUS."""
        self.velocity_rad_s = protocol.middle(erpm, protocol.ERPM_STEP) * self._rad_s_per_erpm

    def position_rad(self, code: int, arrival_ns: int) -> float:
        """From a code of STATUS_4 or STATUS_5, in steps: the velocity tells which turn it is in."""
        velocity_rad_s = self.velocity_rad_s or 0.0
        expected_rad = 0.0
        if self._last is not None:
            last_ns, last_rad_s = self._last
            expected_rad = 0.5 * (velocity_rad_s + last_rad_s) * (arrival_ns - last_ns) * 1e-9
        self._last = arrival_ns, velocity_rad_s
        return self._followed.follow(code, expected_rad / self.step_rad) * self.step_rad
