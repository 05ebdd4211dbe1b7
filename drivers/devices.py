"""What the bench may ask of a device. Drivers implement these; the bench knows nothing else of them.

Drivers never read a port themselves: whoever owns the ports polls them (see :class:`Link`), and each driver's
subscription turns what arrived into readings, which the bench then takes.
"""

from typing import Protocol

from drivers.readings import CurrentReading, DeviceIdentity, DriveStatus, MotionReading, TorqueReading


class Device(Protocol):
    """Anything on the bench."""

    @property
    def role(self) -> str: ...

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask the device who it is, without moving anything. Raises DeviceTimeoutError, DeviceError."""
        ...


class Amplifier(Device, Protocol):
    """A motor drive commanded in torque [N m] (signs are the bench's)."""

    def enable(self, timeout_s: float = 2.0) -> None:
        """Clear errors, arm the watchdog, close the torque loop at zero torque, and wait until the drive says so.

        Raises DeviceTimeoutError or DeviceError with the drive's own errors in words. The caller must then send a
        command within every watchdog period.
        """
        ...

    def command_torque(self, torque_nm: float) -> None:
        """Command a torque; also feeds the drive's watchdog. Raises ConnectionFailedError."""
        ...

    def take_motion(self) -> list[MotionReading]:
        """The motion readings since the last call, oldest first."""
        ...

    def take_current(self) -> list[CurrentReading]:
        """The current readings since the last call, oldest first; always empty for drives that report none."""
        ...

    def status(self) -> DriveStatus:
        """What the drive last said of itself."""
        ...

    @property
    def heartbeat_timeout_ns(self) -> int:
        """Silence longer than this means that the drive is lost."""
        ...

    @property
    def position_resolution_rad(self) -> float:
        """The step of the position reading, as the device states it (0 where it is unknown)."""
        ...

    def stop(self) -> None:
        """Zero torque, then idle. Never raises: it is called when things have already gone wrong."""
        ...


class TorqueSensor(Device, Protocol):
    """A torque sensor between actuator and load."""

    def take_torque(self) -> list[TorqueReading]:
        """The torque readings since the last call, oldest first."""
        ...

    @property
    def range_nm(self) -> float:
        """Beyond this torque the sensor's reading means nothing (inf where it is unknown)."""
        ...
