"""How large commands for a servo may be, and motions imposed on it, so that its torque stays below a limit.

All are in the unit of its command: rad for one that holds a position, rad/s for one that holds a velocity.
"""

from norton_bench.rig.rig import Rig
from norton_drivers.servo import Servo

# Of the greatest command: room for what the drive rounds.
GOAL_SHARE = 0.95
# Of the port's torque limit, as for any plan (excitations.SHARE).
TORQUE_SHARE = 0.8
# Of the greatest error: what the goal, and the motion, of a stretch may each reach.
ERROR_SHARE = 0.4


def greatest_goal(rig: Rig) -> float:
    """The greatest goal to use."""
    return GOAL_SHARE * min(abs(end) for end in rig.command.span)


def greatest_error(rig: Rig, servo: Servo) -> float:
    """At the servo's own limit, or where the port has its greatest torque."""
    return min(servo.greatest_error, TORQUE_SHARE * rig.limits.torque_nm / servo.gain)


def room_for(rig: Rig, servo: Servo) -> float:
    """How large a goal, or a motion, may be that leaves the servo below its limit, whatever the other does."""
    return min(greatest_goal(rig), ERROR_SHARE * greatest_error(rig, servo))


def greatest_step(rig: Rig) -> float:
    """The greatest command that may come at once: any of a motor, of a servo what brings it near to its limit.

    One that holds a velocity has a motor's: what it grows to here it is led to, and the shaft follows."""
    if rig.servo is None or not rig.servo.holds_position:
        return rig.command.limit
    return min(greatest_goal(rig), greatest_error(rig, rig.servo))


def greatest_shake(rig: Rig) -> float:
    """The greatest command to shake with."""
    return rig.command.limit if rig.servo is None else room_for(rig, rig.servo)
