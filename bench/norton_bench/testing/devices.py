"""The tests that a driver of a torque sensor, and one of an amplifier, inherits."""

from math import inf, nan
from statistics import fmean
from typing import ClassVar

import pytest

from norton_bench.testing.contract import GRACE_S, SHORT_S, DriverContract, EmulatedAmplifier, Plug, Plugged, SetUp
from norton_bench.units import same_dimension
from norton_drivers import registry
from norton_drivers.devices import Amplifier, TorqueSensor
from norton_drivers.errors import ConnectionFailedError, DeviceError
from norton_drivers.link import Link
from norton_drivers.readings import DriveState


class TorqueSensorContract(DriverContract):
    """The contract of a torque sensor's driver.

    Subclass it, and say in :meth:`set_up` which sensor is tested; its far end is a :class:`EmulatedTorqueSensor`.

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


ARRIVED_S = 0.02  # a command must have acted by then
IDLE_S = 0.5
FRESH_NS = 100_000_000


class AmplifierContract(DriverContract):
    """The contract of a motor drive's driver.

    Subclass it, and say in :meth:`set_up` which drive is tested; its far end is an :class:`EmulatedAmplifier`.

    ``some_command`` is one that the drive takes, in its own unit; it must arrive within ``command_resolution``. A
    drive that has no state "enabled" ``lets_go_at_zero``: its far end is armed by a command alone.
    """

    group: ClassVar[str] = registry.AMPLIFIERS
    some_command: ClassVar[float] = 0.1
    command_resolution: ClassVar[float] = 1e-6
    lets_go_at_zero: ClassVar[bool] = False
    position_tolerance_rad: ClassVar[float] = 0.01

    @staticmethod
    def open_driver(set_up: SetUp, link: Link) -> Amplifier:
        return registry.open_amplifier(set_up.settings, link)

    # ---- What it says of itself ----------------------------------------------------------------------------------

    def test_what_it_says_of_itself_makes_sense(self, plugged: Plugged) -> None:
        drive = plugged.device
        assert any(same_dimension(drive.command_unit, unit) for unit in ("N*m", "A", "1"))
        assert 0 < drive.heartbeat_timeout_ns < inf
        assert 0 <= drive.position_resolution_rad < inf
        assert 0 <= drive.watchdog_s < inf

    # ---- Enabling ------------------------------------------------------------------------------------------------

    def test_it_enables_at_zero(self, plugged: Plugged) -> None:
        assert plugged.device.status().state is not DriveState.ENABLED
        plugged.device.enable()
        assert plugged.device.status().state is DriveState.ENABLED
        assert plugged.emulated.armed is not self.lets_go_at_zero
        assert plugged.emulated.command == pytest.approx(0.0, abs=self.command_resolution)

    def test_it_is_not_enabled_where_nobody_answers(self, plugged: Plugged) -> None:
        plugged.emulated.vanish()
        plugged.wait(0.05)
        begun_ns = plugged.now_ns
        with pytest.raises(DeviceError) as caught:
            plugged.device.enable(SHORT_S)
        plugged.assert_told(caught.value)
        assert (plugged.now_ns - begun_ns) * 1e-9 < 2 * SHORT_S + GRACE_S
        assert plugged.device.status().state is not DriveState.ENABLED

    # ---- Commanding ----------------------------------------------------------------------------------------------

    def test_a_command_goes_out_at_once_and_acts(self, plugged: Plugged) -> None:
        plugged.device.enable()
        begun_ns, sent = plugged.now_ns, plugged.proxy.sent
        plugged.device.command(self.some_command)
        if plugged.set_up.backend.lock_step:
            assert plugged.now_ns == begun_ns, "it waited"
        plugged.link.poll()
        assert plugged.proxy.sent > sent, "nothing was sent within a poll"
        _keep(plugged, self.some_command, ARRIVED_S)
        assert plugged.emulated.command == pytest.approx(self.some_command, abs=self.command_resolution)

    @pytest.mark.parametrize("direction", [1, -1])
    def test_direction_turns_commands(self, plug: Plug, direction: int) -> None:
        plugged = plug(direction)
        plugged.device.enable()
        _keep(plugged, self.some_command, ARRIVED_S)
        assert plugged.emulated.command == pytest.approx(direction * self.some_command, abs=self.command_resolution)

    @pytest.mark.parametrize("value", [nan, inf, -inf])
    def test_what_is_no_number_is_refused(self, plugged: Plugged, value: float) -> None:
        plugged.device.enable()
        _keep(plugged, self.some_command, ARRIVED_S)
        sent = plugged.proxy.sent
        with pytest.raises(DeviceError) as caught:
            plugged.device.command(value)
        plugged.assert_told(caught.value)
        assert plugged.proxy.sent == sent
        assert plugged.emulated.command == pytest.approx(self.some_command, abs=self.command_resolution)

    # ---- Reading -------------------------------------------------------------------------------------------------

    def test_readings_come_once_in_order_with_their_arrival(self, plugged: Plugged) -> None:
        drive = plugged.device
        drive.enable()
        drive.take_motion()
        drive.take_current()
        begun_ns = plugged.now_ns
        _keep(plugged, 0.0, 0.1)
        motion, current = drive.take_motion(), drive.take_current()
        assert drive.take_motion() == []
        assert drive.take_current() == []
        assert motion, "no motion readings"
        for readings in (motion, current):
            sequence = [reading.sequence for reading in readings]
            arrivals = [reading.arrival_ns for reading in readings]
            assert sequence == [sequence[0] + k for k in range(len(sequence))]
            assert arrivals == sorted(arrivals)
            assert all(begun_ns - FRESH_NS <= arrival <= plugged.now_ns for arrival in arrivals)

    @pytest.mark.parametrize("direction", [1, -1])
    def test_direction_turns_readings(self, plug: Plug, direction: int) -> None:
        plugged = plug(direction)
        plugged.device.enable()
        plugged.emulated.turn(0.0, 0.0)
        before_rad = _position_rad(plugged)
        plugged.emulated.turn(2.0, 0.0)
        after_rad = _position_rad(plugged)
        assert after_rad - before_rad == pytest.approx(2.0 * direction, abs=self.position_tolerance_rad)
        plugged.emulated.turn(2.0, 8.0)
        _keep(plugged, 0.0, 0.01)
        assert plugged.device.take_motion()[-1].velocity_rad_s * direction > 0.5

    # ---- Losing it -----------------------------------------------------------------------------------------------

    def test_a_drive_that_is_lost_shows(self, plugged: Plugged) -> None:
        """Its state, or the age of its heartbeat, says so: the guard looks at both."""
        drive = plugged.device
        drive.enable()
        plugged.emulated.vanish()
        _keep(plugged, 0.0, drive.heartbeat_timeout_ns * 1e-9 + GRACE_S)
        status = drive.status()
        silent = status.heartbeat_ns is None or plugged.now_ns - status.heartbeat_ns > drive.heartbeat_timeout_ns
        assert silent or status.state is not DriveState.ENABLED
        drive.take_motion()
        _keep(plugged, 0.0, 0.1)
        assert drive.take_motion() == [], "it makes readings up"

    def test_a_port_that_is_lost_is_told_and_does_not_keep_it_from_stopping(self, plugged: Plugged) -> None:
        plugged.device.enable()
        plugged.proxy.unplugged = True
        with pytest.raises(ConnectionFailedError):
            _keep(plugged, 0.0, ARRIVED_S)
        plugged.device.stop()

    # ---- Stopping ------------------------------------------------------------------------------------------------

    def test_it_stops(self, plugged: Plugged) -> None:
        plugged.device.enable()
        _keep(plugged, self.some_command, ARRIVED_S)
        plugged.device.stop()
        plugged.wait(IDLE_S)
        assert not plugged.emulated.armed
        assert plugged.emulated.command == 0.0
        assert plugged.device.status().state is DriveState.IDLE

    def test_it_can_be_enabled_again(self, plugged: Plugged) -> None:
        plugged.device.enable()
        plugged.device.stop()
        plugged.wait(IDLE_S)
        plugged.device.enable()
        _keep(plugged, self.some_command, ARRIVED_S)
        assert plugged.emulated.armed

    def test_its_watchdog_acts_as_it_says(self, plugged: Plugged) -> None:
        """And it can be enabled again afterwards. A drive that has none, or cannot show it, must say so."""
        drive: Amplifier = plugged.device
        drive.enable()
        drive.provoke_watchdog()
        begun_ns, limit_s = plugged.now_ns, drive.watchdog_s + drive.heartbeat_timeout_ns * 1e-9
        while not drive.made_itself_safe() and (plugged.now_ns - begun_ns) * 1e-9 < limit_s:
            plugged.link.wait()
        emulated: EmulatedAmplifier = plugged.emulated
        if drive.watchdog_s > 0:
            assert drive.made_itself_safe() in (True, None)
            assert not emulated.armed or emulated.command == pytest.approx(0.0, abs=self.command_resolution)
        drive.stop()
        plugged.wait(IDLE_S)
        drive.enable()
        assert drive.status().state is DriveState.ENABLED


def _keep(plugged: Plugged, command: float, duration_s: float) -> None:
    """Command this every millisecond, as the loop does."""
    end_ns = plugged.now_ns + round(duration_s * 1e9)
    while plugged.now_ns < end_ns:
        plugged.device.command(command)
        plugged.link.wait()


def _position_rad(plugged: Plugged) -> float:
    """What is read once the shaft stands still."""
    _keep(plugged, 0.0, 0.1)
    return float(plugged.device.take_motion()[-1].position_rad)
