"""What the drivers of serial torque sensors share."""

from math import isfinite
from typing import Protocol

from norton_drivers.link import Link, wait_until
from norton_drivers.ports import SerialPort
from norton_drivers.readings import Inbox, TorqueReading
from norton_drivers.serial_timing import ByteStamps
from norton_drivers.wiring import DeviceSettings


class SerialOptions(Protocol):
    """The part of their options that is needed here."""

    @property
    def range_nm(self) -> float: ...
    @property
    def baud(self) -> int: ...


class SerialSensor:
    """A sensor on a line of its own: a driver hands on the bytes that come, and puts readings.

    ``nm_per_unit`` turns the sensor's number into newton metres.
    """

    def __init__(
        self, settings: DeviceSettings, options: SerialOptions, port: SerialPort, link: Link, nm_per_unit: float
    ) -> None:
        self.role = settings.role
        self._port = port
        self._link = link
        self._stamps = ByteStamps(options.baud)
        self._inbox: Inbox[TorqueReading] = Inbox()
        self._nm_per_unit = settings.direction * nm_per_unit
        self._range_nm = options.range_nm

    @property
    def range_nm(self) -> float:
        return self._range_nm

    def take_torque(self) -> list[TorqueReading]:
        return self._inbox.take()

    def _put(self, number: float, arrival_ns: int, device_ns: int | None = None, *, sound: bool = True) -> None:
        """A number that the sensor sent, ``sound`` by its own word; beyond its range it measured nothing."""
        torque_nm = self._nm_per_unit * number
        valid = sound and isfinite(torque_nm) and abs(torque_nm) <= self._range_nm
        self._inbox.put(TorqueReading(self._inbox.count, arrival_ns, torque_nm, device_ns, valid))

    def _comes(self, timeout_s: float) -> bool:
        """Whether a reading comes of a sensor that streams by itself."""
        before = self._inbox.count
        return wait_until(lambda: self._inbox.count > before, self._link, timeout_s)
