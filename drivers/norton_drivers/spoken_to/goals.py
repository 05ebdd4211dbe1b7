"""Commands that are positions: one frame has the goal and the gains."""

from collections.abc import Callable
from typing import Generic, TypeVar

from norton_drivers.codecs.ranges import Ranges
from norton_drivers.errors import DeviceError
from norton_drivers.servo import Servo

# A motor that stands away from the drive's zero when it is enabled is led there: no faster, and from no further.
LED_RAD_S = 0.5
FURTHEST_RAD = 0.25
LATEST_NS = 50_000_000  # a longer silence leads no further

Packed = TypeVar("Packed")


class Goals(Generic[Packed]):
    """Angles from the drive's own zero, in its own sense; its gains are always the same.

    ``pack`` makes a frame of the codes of position, stiffness, damping and torque.
    """

    def __init__(self, ranges: Ranges, servo: Servo, pack: Callable[[int, int, int, int], Packed]) -> None:
        self._ranges = ranges
        self._pack = pack
        self._codes = ranges.stiffness_code(servo.stiffness_nm_rad), ranges.damping_code(servo.damping_nms_rad)
        self._away_rad = 0.0  # how far the goal still is from what is asked
        self._led_ns = 0

    def begin(self, position_rad: float, now_ns: int) -> None:
        """The motor, about to be enabled, stands there. Raises DeviceError where that is too far from zero."""
        if abs(position_rad) > FURTHEST_RAD:
            raise DeviceError(
                f"the shaft stands {position_rad:.3g} rad from the drive's zero, "
                f"where a command of 0 would take it; turn it to within {FURTHEST_RAD:g} rad, or set the drive's zero"
            )
        self._away_rad, self._led_ns = position_rad, now_ns

    def frame(self, goal_rad: float, now_ns: int) -> tuple[Packed, float]:
        """What to send, and the goal that it holds. Raises CodecError for no number."""
        led_rad = LED_RAD_S * min(now_ns - self._led_ns, LATEST_NS) * 1e-9
        self._away_rad -= min(max(self._away_rad, -led_rad), led_rad)
        self._led_ns = now_ns
        code = self._ranges.goal_code(goal_rad + self._away_rad)
        return self._pack(code, *self._codes, self._ranges.command_code(0.0)), self._ranges.commanded_rad(code)
