"""What a drive makes of a command that is a position or a velocity: its own loop around the shaft, as it is set."""

from dataclasses import dataclass
from math import inf

from norton_drivers.errors import DeviceError

# A motor that stands away from the drive's zero when it is enabled is led there: no faster, and from no further.
LED_RAD_S = 0.5
FURTHEST_RAD = 0.25
LATEST_NS = 50_000_000  # a longer silence leads no further
SHORTEST_WINDOW_S = 1e-6  # of a loop that knows the velocity at once


@dataclass(frozen=True)
class Servo:
    """A loop in a drive, up to a limit: torque = stiffness · (goal − θ) − damping · ω of a command that is a position,
    or, without a stiffness, damping · (goal − ω) of one that is a velocity.

    Either way it is a gain times the command less what the shaft takes off it: :attr:`of_angle` · θ +
    :attr:`of_velocity` · ω. The loop runs at its own rate: on average it acts ``delay_s`` later than the shaft moves.
    It takes the velocity from two positions ``window_s`` apart. ``greatest_nm`` is the limit as it is set in the drive,
    infinite where nobody knows. Torques are the drive's own, before its error of scale.
    """

    stiffness_nm_rad: float
    damping_nms_rad: float = 0.0
    delay_s: float = 0.0
    window_s: float = SHORTEST_WINDOW_S
    greatest_nm: float = inf

    @property
    def holds_position(self) -> bool:
        """Whether its command is a position [rad]; otherwise it is a velocity [rad/s]."""
        return self.stiffness_nm_rad > 0.0

    @property
    def gain(self) -> float:
        """Torque for each unit of the error [N m/rad or N m s/rad]."""
        return self.stiffness_nm_rad if self.holds_position else self.damping_nms_rad

    @property
    def of_angle(self) -> float:
        """How much of the angle counts against the command: all, or nothing."""
        return 1.0 if self.holds_position else 0.0

    @property
    def of_velocity(self) -> float:
        """How much of the velocity does: so many seconds of position, or all."""
        return self.damping_nms_rad / self.gain

    @property
    def greatest_error(self) -> float:
        """The error [rad or rad/s] at which the torque ends to grow."""
        return self.greatest_nm / self.gain


class Lead:
    """Leads a goal from where the shaft stands to what is asked; angles from the drive's own zero, in its own sense."""

    def __init__(self) -> None:
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

    def led_rad(self, goal_rad: float, now_ns: int) -> float:
        """The goal to send."""
        led_rad = LED_RAD_S * min(now_ns - self._led_ns, LATEST_NS) * 1e-9
        self._away_rad -= min(max(self._away_rad, -led_rad), led_rad)
        self._led_ns = now_ns
        return goal_rad + self._away_rad
