"""What a drive makes of a command that is a position: its own loop around the shaft, as it is set in the drive."""

from dataclasses import dataclass
from math import inf

SHORTEST_WINDOW_S = 1e-6  # of a loop that knows the velocity at once


@dataclass(frozen=True)
class Servo:
    """A position loop in a drive: torque = stiffness · (goal − θ) − damping · ω, up to a limit.

    The loop runs at its own rate: on average it acts ``delay_s`` later than the shaft moves. It takes the velocity from
    two positions ``window_s`` apart. ``greatest_nm`` is the limit as it is set in the drive, infinite where nobody
    knows. Torques are the drive's own, before its error of scale.
    """

    stiffness_nm_rad: float
    damping_nms_rad: float = 0.0
    delay_s: float = 0.0
    window_s: float = SHORTEST_WINDOW_S
    greatest_nm: float = inf

    @property
    def lead_s(self) -> float:
        """Damping over stiffness: the velocity counts as so many seconds of position."""
        return self.damping_nms_rad / self.stiffness_nm_rad

    @property
    def greatest_rad(self) -> float:
        """The error at which the torque ends to grow."""
        return self.greatest_nm / self.stiffness_nm_rad
