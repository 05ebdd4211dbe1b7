"""Commands that are positions: one frame has the goal and the gains."""

from collections.abc import Callable
from typing import Generic, TypeVar

from norton_drivers.codecs.ranges import Ranges
from norton_drivers.servo import Lead, Servo

Packed = TypeVar("Packed")


class Goals(Generic[Packed]):
    """Angles from the drive's own zero, in its own sense; its gains are always the same.

    ``pack`` makes a frame of the codes of position, stiffness, damping and torque.
    """

    def __init__(self, ranges: Ranges, servo: Servo, pack: Callable[[int, int, int, int], Packed]) -> None:
        self._ranges = ranges
        self._pack = pack
        self._codes = ranges.stiffness_code(servo.stiffness_nm_rad), ranges.damping_code(servo.damping_nms_rad)
        self._lead = Lead()

    def begin(self, position_rad: float, now_ns: int) -> None:
        """The motor, about to be enabled, stands there. Raises DeviceError where that is too far from zero."""
        self._lead.begin(position_rad, now_ns)

    def frame(self, goal_rad: float, now_ns: int) -> tuple[Packed, float]:
        """What to send, and the goal that it holds. Raises CodecError for no number."""
        code = self._ranges.goal_code(self._lead.led_rad(goal_rad, now_ns))
        return self._pack(code, *self._codes, self._ranges.command_code(0.0)), self._ranges.commanded_rad(code)
