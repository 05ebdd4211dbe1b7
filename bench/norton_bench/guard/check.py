"""What every plausibility check is given, and what it must say."""

from enum import IntFlag
from typing import NamedTuple, Protocol

from norton_bench.guard.model import GuardModel
from norton_bench.sample import Sample
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


# A reading that is wrong once is a glitch; wrong as often as this, one after the other, it is a fault.
STRIKES = 3
# A position that stays where it was for so long, while it should move, is stuck.
PATIENCE_NS = 100_000_000
# An older reading of an encoder tells nothing: it is the business of [limits] stale_after.
FRESH_NS = 30_000_000
# Two positions may differ by so many steps of their resolution, and by this angle.
STEPS = 4
LEAST_RAD = 0.05


class Check(Protocol):
    """One relation between signals that must hold. Its name is the one that ``[guard] leave_out`` knows."""

    @property
    def name(self) -> str: ...

    def begin(self, sample: Sample) -> None:
        """The drives were just enabled at zero."""
        ...

    def learn(self, model: GuardModel) -> None:
        """From now on, use what was measured."""
        ...

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        """What is wrong, with place, numbers and mend; None where nothing is. ``sent`` is what acts since last tick."""
        ...
