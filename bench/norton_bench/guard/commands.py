"""What passes the guard, and what it is told of the drives."""

from enum import IntFlag
from typing import NamedTuple

from norton_drivers.readings import DriveStatus


class Limited(IntFlag):
    """What was clipped in a tick; clipping is no alarm, but it is recorded."""

    COMMAND = 1
    COMMAND_RATE = 2
    LOAD_TORQUE = 4
    MODULATION = 8


class Commands(NamedTuple):
    """What goes to the drives: the actuator's command in its own unit, the load's torque, and what was clipped.

    ``modulation`` is the modulator's command in its own unit; NaN once sent where there is none.
    """

    command: float
    load_torque_nm: float
    limited: int = 0
    modulation: float = 0.0


class DriveHealth(NamedTuple):
    """A drive's last word, and how long its heartbeat may be silent."""

    name: str
    status: DriveStatus
    heartbeat_timeout_ns: int


NOTHING = Commands(0.0, 0.0)
