"""The contract of a torque sensor's driver."""

from statistics import fmean
from typing import ClassVar

import pytest

from norton_bench.testing.contract import DriverContract, Plug, Plugged
from norton_bench.testing.emulated import SetUp
from norton_drivers import registry
from norton_drivers.devices import TorqueSensor
from norton_drivers.errors import ConnectionFailedError
from norton_drivers.link import Link


class TorqueSensorContract(DriverContract):
    """Subclass it, and say in :meth:`set_up` which sensor is tested; its far end is a :class:`EmulatedTorqueSensor`.

    ``some_torque_nm`` is one that the sensor can measure; it must be read within ``torque_tolerance_nm``.
    """

    group: ClassVar[str] = registry.TORQUE_SENSORS
    some_torque_nm: ClassVar[float] = 0.25
    torque_tolerance_nm: ClassVar[float] = 1e-3
    slowest_s: ClassVar[float] = 0.1  # from one reading to the next, at most

    @staticmethod
    def open_driver(set_up: SetUp, link: Link) -> TorqueSensor:
        return registry.open_torque_sensor(set_up.settings, link)

    def test_its_range_makes_sense(self, plugged: Plugged) -> None:
        assert plugged.device.range_nm > 0

    def test_readings_come_once_in_order_with_their_arrival(self, plugged: Plugged) -> None:
        plugged.device.identify()
        plugged.device.take_torque()
        begun_ns = plugged.now_ns
        plugged.wait(5 * self.slowest_s)
        readings = plugged.device.take_torque()
        assert plugged.device.take_torque() == []
        assert len(readings) >= 3
        sequence = [reading.sequence for reading in readings]
        assert sequence == list(range(sequence[0], sequence[0] + len(sequence)))
        arrivals = [reading.arrival_ns for reading in readings]
        assert arrivals == sorted(arrivals)
        assert all(begun_ns - self.slowest_s * 1e9 <= arrival <= plugged.now_ns for arrival in arrivals)
        assert all(reading.valid for reading in readings)

    @pytest.mark.parametrize("direction", [1, -1])
    def test_direction_turns_the_torque(self, plug: Plug, direction: int) -> None:
        plugged = plug(direction)
        plugged.device.identify()
        plugged.emulated.twist(self.some_torque_nm)
        assert self._torque_nm(plugged) == pytest.approx(direction * self.some_torque_nm, abs=self.torque_tolerance_nm)
        plugged.emulated.twist(-self.some_torque_nm)
        assert self._torque_nm(plugged) == pytest.approx(-direction * self.some_torque_nm, abs=self.torque_tolerance_nm)

    def test_after_junk_it_reads_right_again(self, plugged: Plugged) -> None:
        plugged.endure_junk()
        plugged.emulated.twist(self.some_torque_nm)
        assert self._torque_nm(plugged) == pytest.approx(self.some_torque_nm, abs=self.torque_tolerance_nm)

    def test_a_sensor_that_is_lost_gives_no_readings(self, plugged: Plugged) -> None:
        plugged.device.identify()
        plugged.emulated.vanish()
        plugged.wait(self.slowest_s)
        plugged.device.take_torque()
        plugged.wait(5 * self.slowest_s)
        assert plugged.device.take_torque() == [], "it makes readings up"

    def test_a_port_that_is_lost_is_told(self, plugged: Plugged) -> None:
        plugged.device.identify()
        plugged.proxy.unplugged = True
        with pytest.raises(ConnectionFailedError):
            plugged.wait(2 * self.slowest_s)

    def _torque_nm(self, plugged: Plugged) -> float:
        """The mean of what is read once the change has come through."""
        plugged.wait(3 * self.slowest_s)
        plugged.device.take_torque()
        plugged.wait(5 * self.slowest_s)
        return fmean(reading.torque_nm for reading in plugged.device.take_torque())
