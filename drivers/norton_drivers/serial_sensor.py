"""What the drivers of serial torque sensors have in common, whatever it is that comes over the line."""

from typing import Protocol

from norton_drivers.link import Link
from norton_drivers.ports import SerialPort
from norton_drivers.readings import TorqueReading
from norton_drivers.stamps import ByteStamps
from norton_drivers.torque_readings import TorqueReadings
from norton_drivers.waiting import wait_until
from norton_drivers.wiring import DeviceSettings


class SerialOptions(Protocol):
    """The part of their options that is needed here."""

    @property
    def range_nm(self) -> float: ...
    @property
    def baud(self) -> int: ...


class SerialSensor:
    """A sensor on a line of its own: a driver hands on the bytes that come, and puts readings."""

    def __init__(
        self, settings: DeviceSettings, options: SerialOptions, port: SerialPort, link: Link, nm_per_unit: float
    ) -> None:
        self.role = settings.role
        self._port = port
        self._link = link
        self._stamps = ByteStamps(options.baud)
        self._readings = TorqueReadings(settings.direction * nm_per_unit, options.range_nm)

    @property
    def range_nm(self) -> float:
        return self._readings.range_nm

    def take_torque(self) -> list[TorqueReading]:
        return self._readings.take()

    def _comes(self, timeout_s: float) -> bool:
        """Whether a reading comes of a sensor that streams by itself."""
        before = self._readings.count
        return wait_until(lambda: self._readings.count > before, self._link, timeout_s)
