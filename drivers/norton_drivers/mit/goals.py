"""Commands of a motor in MIT mode that are positions: one frame has the goal and the gains."""

from norton_drivers.codecs import mit as protocol
from norton_drivers.codecs.mit import Ranges
from norton_drivers.servo import LedGoal, Servo


class Goals(LedGoal):
    """Angles from the drive's own zero, in its own sense; its gains are always the same."""

    def __init__(self, ranges: Ranges, servo: Servo) -> None:
        super().__init__()
        self._ranges = ranges
        self._codes = protocol.stiffness_code(servo.stiffness_nm_rad), protocol.damping_code(servo.damping_nms_rad)

    def frame(self, goal_rad: float, now_ns: int) -> tuple[bytes, float]:
        """What to send, and the goal that it holds. Raises CodecError for no number."""
        code = self._ranges.goal_code(self.towards(goal_rad, now_ns))
        return (
            protocol.goal_value(code, *self._codes, self._ranges.command_code(0.0)),
            self._ranges.commanded_rad(code),
        )
