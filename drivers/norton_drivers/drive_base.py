"""What drives have in common, whatever line they are on."""

from typing import Annotated

from pydantic import AfterValidator

from norton_drivers.readings import CurrentReading, DriveStatus, Inbox, MotionReading
from norton_drivers.wiring import DeviceSettings

_SHORTEST_WATCHDOG_S = 0.02


def _can_be_fed(watchdog_s: float) -> float:
    if 0 < watchdog_s < _SHORTEST_WATCHDOG_S:
        raise ValueError("shorter than a computer can be relied on to feed; at least 20 ms")
    return watchdog_s


# An option: the time of a watchdog that this computer must feed; 0 leaves the drive's own as it is.
FedWatchdog = Annotated[float, AfterValidator(_can_be_fed)]


class DriveBase:
    """Readings that wait to be taken, and a status that is put together anew only after something has changed."""

    def __init__(self, settings: DeviceSettings) -> None:
        self.role = settings.role
        self._direction = settings.direction
        self._motion: Inbox[MotionReading] = Inbox()
        self._current: Inbox[CurrentReading] = Inbox()
        self._status: DriveStatus | None = None  # None where something has changed since it was last asked for

    def take_motion(self) -> list[MotionReading]:
        return self._motion.take()

    def take_current(self) -> list[CurrentReading]:
        return self._current.take()

    def status(self) -> DriveStatus:
        # Asked every tick, but it changes seldom.
        if self._status is None:
            self._status = self._new_status()
        return self._status

    def _new_status(self) -> DriveStatus:
        raise NotImplementedError
