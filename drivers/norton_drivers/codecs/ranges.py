"""Numbers scaled to integers within a range, as MIT mode and the families that descend from it send them.

A command has a position and a torque with two gains, an answer position, velocity and torque. What the integers span
differs between motors, and how many bits they have between families. Sources: bgkatz/motorcontrol,
Core/Src/math_ops.c (``float_to_uint`` cuts off), can.c (``pack_reply``, ``unpack_cmd``).
"""

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from norton_drivers.codecs.common import CodecError

POSITION_CODES = 1 << 16
_LAST_POSITION = POSITION_CODES - 1
STIFFNESS_MAX_NM_RAD, DAMPING_MAX_NMS_RAD = 500.0, 5.0  # what the codes of gains reach: can.c


class Goal(NamedTuple):
    """A command as the drive reads it: torque = stiffness · (position − θ) + damping · (velocity − ω) + torque."""

    position_rad: float
    velocity_rad_s: float
    stiffness_nm_rad: float
    damping_nms_rad: float
    torque_nm: float

    def held_nm(self, angle_rad: float, velocity_rad_s: float) -> float:
        """The torque at an angle θ and a velocity ω."""
        error_rad, error_rad_s = self.position_rad - angle_rad, self.velocity_rad_s - velocity_rad_s
        return self.stiffness_nm_rad * error_rad + self.damping_nms_rad * error_rad_s + self.torque_nm


class GoalCodes(NamedTuple):
    """The integers of a command."""

    position: int
    velocity: int
    stiffness: int
    damping: int
    torque: int


RELEASED = Goal(0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Ranges:
    """What a motor's integers span: from minus to plus each of these, and its gains from zero.

    The drive cuts what it says off to integers (math_ops.c, ``float_to_uint``), so that a code in a reply stands for
    the whole step above it, and is read here as its middle: a shaft that stands still reads exactly zero. A code in
    a command is taken for the step's lower end, so that exactly zero, which lies between two codes, cannot be sent.

    Positions have 16 bits, everything else ``short_bits``.
    """

    position_rad: float
    velocity_rad_s: float
    torque_nm: float
    short_bits: int = 12
    stiffness_nm_rad: float = STIFFNESS_MAX_NM_RAD
    damping_nms_rad: float = DAMPING_MAX_NMS_RAD

    @property
    def short_codes(self) -> int:
        return 1 << self.short_bits

    @property
    def _last_short(self) -> int:
        return self.short_codes - 1

    @property
    def position_step_rad(self) -> float:
        return 2 * self.position_rad / _LAST_POSITION

    @property
    def velocity_step_rad_s(self) -> float:
        return 2 * self.velocity_rad_s / self._last_short

    @property
    def torque_step_nm(self) -> float:
        return 2 * self.torque_nm / self._last_short

    # ---- Commands ------------------------------------------------------------------------------------------------

    def command_code(self, torque_nm: float) -> int:
        """The nearest code, held within the range: the firmware does not clamp. Raises CodecError for no number."""
        return _nearest("torque", torque_nm, self.torque_nm, self._last_short)

    def commanded_nm(self, code: int) -> float:
        """The torque that the drive makes of a code in a command."""
        return code * self.torque_step_nm - self.torque_nm

    def goal_code(self, position_rad: float) -> int:
        """The nearest code, held within the range. Raises CodecError for no number."""
        return _nearest("position", position_rad, self.position_rad, _LAST_POSITION)

    def commanded_rad(self, code: int) -> float:
        """The position that the drive makes of a code in a command."""
        return code * self.position_step_rad - self.position_rad

    def velocity_code(self, velocity_rad_s: float) -> int:
        """The nearest code, held within the range. Raises CodecError for no number."""
        return _nearest("velocity", velocity_rad_s, self.velocity_rad_s, self._last_short)

    def commanded_rad_s(self, code: int) -> float:
        """The velocity that the drive makes of a code in a command."""
        return code * self.velocity_step_rad_s - self.velocity_rad_s

    @property
    def slowest_code(self) -> int:
        """Half a step below a velocity of zero, which has no code."""
        return self._last_short // 2

    def stiffness_code(self, stiffness_nm_rad: float) -> int:
        """The nearest code, held within what can be sent."""
        return self._gain_code(stiffness_nm_rad / self.stiffness_nm_rad)

    def damping_code(self, damping_nms_rad: float) -> int:
        """The nearest code, held within what can be sent."""
        return self._gain_code(damping_nms_rad / self.damping_nms_rad)

    def _gain_code(self, share: float) -> int:
        return min(max(round(share * self._last_short), 0), self._last_short)

    def stiffness_of(self, code: int) -> float:
        """The stiffness [N m/rad] that the drive makes of a code."""
        return code * self.stiffness_nm_rad / self._last_short

    def damping_of(self, code: int) -> float:
        """The damping [N m s/rad] that the drive makes of a code."""
        return code * self.damping_nms_rad / self._last_short

    def goal_of(self, codes: GoalCodes) -> Goal:
        """What the drive makes of a command's codes."""
        return Goal(
            self.commanded_rad(codes.position),
            self.commanded_rad_s(codes.velocity),
            self.stiffness_of(codes.stiffness),
            self.damping_of(codes.damping),
            self.commanded_nm(codes.torque),
        )

    # ---- Replies -------------------------------------------------------------------------------------------------

    def position_of(self, code: int) -> float:
        """The position [rad] of a code in a reply, also of one that was unwrapped."""
        return (code + 0.5) * self.position_step_rad - self.position_rad

    def velocity_of(self, code: int) -> float:
        """The velocity [rad/s] of a code in a reply."""
        return (code + 0.5) * self.velocity_step_rad_s - self.velocity_rad_s

    def torque_of(self, code: int) -> float:
        """The torque [N m] of a code in a reply."""
        return (code + 0.5) * self.torque_step_nm - self.torque_nm

    def cut(self, position_rad: float, velocity_rad_s: float, torque_nm: float) -> tuple[int, int, int]:
        """As the drive casts its measurements: what is beyond its range makes a code beyond its bits."""
        return (
            int((position_rad + self.position_rad) / self.position_step_rad),
            int((velocity_rad_s + self.velocity_rad_s) / self.velocity_step_rad_s),
            int((torque_nm + self.torque_nm) / self.torque_step_nm),
        )


def _nearest(name: str, value: float, greatest: float, last_code: int) -> int:
    if not isfinite(value):
        raise CodecError(f"{name}: not a finite number")
    held = min(max(value, -greatest), greatest)
    return min(round((held + greatest) / (2 * greatest / last_code)), last_code)
