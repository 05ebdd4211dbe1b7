"""Commands that are positions or velocities: one frame has the goal and the gains."""

from collections.abc import Callable
from typing import Generic, TypeVar

from norton_drivers.codecs.ranges import GoalCodes, Ranges
from norton_drivers.servo import Lead, Servo

Packed = TypeVar("Packed")


class Goals(Generic[Packed]):
    """Goals in the drive's own sense, angles from its zero; its gains are always the same. ``pack`` makes a frame."""

    def __init__(self, ranges: Ranges, servo: Servo, pack: Callable[[GoalCodes], Packed]) -> None:
        self._ranges = ranges
        self._pack = pack
        stiffness, damping = ranges.stiffness_code(servo.stiffness_nm_rad), ranges.damping_code(servo.damping_nms_rad)
        self._none = GoalCodes(ranges.goal_code(0.0), ranges.slowest_code, stiffness, damping, ranges.command_code(0.0))
        self._lead = Lead() if servo.holds_position else None
        # Exactly no torque cannot be sent. In a command of a velocity, what is sent instead counts as a velocity.
        self._beside_rad_s = 0.0 if servo.holds_position else ranges.commanded_nm(self._none.torque) / servo.gain

    def begin(self, position_rad: float, now_ns: int) -> None:
        """The motor, about to be enabled, stands there. Raises DeviceError if that is too far from a goal of zero."""
        if self._lead is not None:
            self._lead.begin(position_rad, now_ns)

    def frame(self, goal: float, now_ns: int) -> tuple[Packed, float]:
        """What to send for a position [rad] or a velocity [rad/s], and the goal that it holds. Raises CodecError for no
        number."""
        ranges, none = self._ranges, self._none
        if self._lead is None:
            code = ranges.velocity_code(goal - self._beside_rad_s)
            return self._pack(none._replace(velocity=code)), ranges.commanded_rad_s(code) + self._beside_rad_s
        code = ranges.goal_code(self._lead.led_rad(goal, now_ns))
        return self._pack(none._replace(position=code)), ranges.commanded_rad(code)
