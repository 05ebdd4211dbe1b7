"""What passes the guard, and what it is told of the drives."""

from enum import IntFlag
from typing import NamedTuple

from drivers.readings import DriveStatus


class Limited(IntFlag):
    """What was clipped in a tick; clipping is no alarm, but it is recorded."""

    COMMAND = 1
    COMMAND_RATE = 2
    LOAD_TORQUE = 4


class Commands(NamedTuple):
    """What goes to the drives: the actuator's command in its own unit, the load's torque, and what was clipped."""

    command: float
    load_torque_nm: float
    limited: int = 0


class DriveHealth(NamedTuple):
    """A drive's last word, and how long its heartbeat may be silent."""

    name: str
    status: DriveStatus
    heartbeat_timeout_ns: int


NOTHING = Commands(0.0, 0.0)
