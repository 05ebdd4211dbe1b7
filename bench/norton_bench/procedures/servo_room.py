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
# What is imposed on either kind of servo: durations of the multisine, itself and a command at standstill; shakes, each
# of half of that duration.
HELD_TOO = 1.3
SHAKES = 2
# The limit is looked for at this many times the error at which it should be, with a slow motion in both directions.
BEYOND_LIMIT = 1.4
LIMIT_HZ, LIMIT_CYCLES = 1.0, 6


def servo_of(rig: Rig) -> Servo:
    """That of the rig, which must have one."""
    assert rig.servo is not None
    return rig.servo


def greatest_goal(rig: Rig) -> float:
    """The greatest goal to use."""
    return GOAL_SHARE * min(abs(end) for end in rig.command.span)


def greatest_error(rig: Rig) -> float:
    """At the servo's own limit, or where the port has its greatest torque."""
    servo = servo_of(rig)
    return min(servo.greatest_error, TORQUE_SHARE * rig.limits.torque_nm / servo.gain)


def room_for(rig: Rig) -> float:
    """How large a goal, or a motion, may be that leaves the servo below its limit, whatever the other does."""
    return min(greatest_goal(rig), ERROR_SHARE * greatest_error(rig))


def greatest_step(rig: Rig) -> float:
    """The greatest command that may come at once: any of a motor, of a servo what brings it near to its limit.

    One that holds a velocity has a motor's: what it grows to here it is led to, and the shaft follows."""
    return min(greatest_goal(rig), greatest_error(rig)) if rig.holds_position else rig.command.limit


def greatest_shake(rig: Rig) -> float:
    """The greatest command to shake with."""
    return rig.command.limit if rig.servo is None else room_for(rig)
