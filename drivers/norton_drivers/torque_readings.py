"""From a sensor's numbers to the bench's readings, as the drivers of serial torque sensors all need it."""

from math import isfinite

from norton_drivers.inbox import Inbox
from norton_drivers.readings import TorqueReading


class TorqueReadings:
    """Readings that wait to be taken. ``nm_per_unit`` turns the sensor's number and its sign into the bench's."""

    def __init__(self, nm_per_unit: float, range_nm: float) -> None:
        self.range_nm = range_nm
        self._nm_per_unit = nm_per_unit
        self._inbox: Inbox[TorqueReading] = Inbox()

    @property
    def count(self) -> int:
        """How many there ever were."""
        return self._inbox.count

    def put(self, number: float, arrival_ns: int, device_ns: int | None = None, *, sound: bool = True) -> None:
        """A number that the sensor sent, ``sound`` by its own word; beyond its range it measured nothing."""
        torque_nm = self._nm_per_unit * number
        valid = sound and isfinite(torque_nm) and abs(torque_nm) <= self.range_nm
        self._inbox.put(TorqueReading(self._inbox.count, arrival_ns, torque_nm, device_ns, valid))

    def take(self) -> list[TorqueReading]:
        """Those since the last call."""
        return self._inbox.take()
