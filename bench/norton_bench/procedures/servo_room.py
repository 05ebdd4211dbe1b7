"""How large goals for a servo may be, and motions imposed on it, so that its torque stays below a limit."""

from norton_bench.rig.rig import Rig
from norton_drivers.servo import Servo

# Of the greatest command: room for what the drive rounds.
GOAL_SHARE = 0.95
# Of the port's torque limit, as for any plan (excitations.SHARE).
TORQUE_SHARE = 0.8
# Of the greatest error: what the goal, and the motion, of a stretch may each reach.
ERROR_SHARE = 0.4


def goal_span_rad(rig: Rig) -> float:
    """The greatest goal to use."""
    return GOAL_SHARE * min(abs(end) for end in rig.command.span)


def error_rad(rig: Rig, servo: Servo) -> float:
    """The greatest error: at the servo's own limit, or where the port has its greatest torque."""
    return min(servo.greatest_rad, TORQUE_SHARE * rig.limits.torque_nm / servo.stiffness_nm_rad)


def room_rad(rig: Rig, servo: Servo) -> float:
    """How large a goal, or a motion, may be that leaves the servo below its limit, whatever the other does."""
    return min(goal_span_rad(rig), ERROR_SHARE * error_rad(rig, servo))


def greatest_step(rig: Rig) -> float:
    """The greatest command that may come at once: any of a motor, of a servo what brings it near to its limit."""
    return rig.command.limit if rig.servo is None else min(goal_span_rad(rig), error_rad(rig, rig.servo))


def greatest_shake(rig: Rig) -> float:
    """The greatest command to shake with."""
    return rig.command.limit if rig.servo is None else room_rad(rig, rig.servo)
