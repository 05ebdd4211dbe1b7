"""The interfaces that drivers implement. The bench knows nothing else of a device.

Drivers never read a port themselves: whoever owns the ports polls them (see :class:`Link`), and each driver's
subscription turns what arrived into readings, which the bench then takes.
"""

from typing import Protocol

from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveStatus, MotionReading, TorqueReading


class Device(Protocol):
    """Anything on the bench."""

    @property
    def role(self) -> str: ...

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Ask the device who it is, without moving anything. Raises DeviceTimeoutError, DeviceError."""
        ...


class Amplifier(Device, Protocol):
    """A motor drive (signs are the bench's)."""

    @property
    def command_unit(self) -> str:
        """What a command of 1 is: "N*m", "A", or "1" for a share of the supply's voltage."""
        ...

    def enable(self, timeout_s: float = 2.0) -> None:
        """Clear errors, arm the watchdog, close the drive's loop at a command of zero, and wait until it says so.

        Raises DeviceTimeoutError or DeviceError with the drive's own errors in words. The caller must then send a
        command within every watchdog period.
        """
        ...

    def command(self, value: float) -> float:
        """Command ``value``, in :attr:`command_unit`; also feeds the drive's watchdog.

        Returns the command that the wire really carries: rounded as the protocol rounds, limited as it limits. Raises
        ConnectionFailedError, and DeviceError for what cannot be sent, such as a value that is no number.
        """
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

    @property
    def watchdog_s(self) -> float:
        """Silence after which the drive makes itself safe; 0 where it does not, or nobody knows."""
        ...

    def provoke_watchdog(self) -> None:
        """The last command before the caller falls silent to see whether the drive makes itself safe.

        Where the drive tells its state that is a command of zero; a drive that does not is given a command so small
        that nothing moves, but large enough to see it end. Raises ConnectionFailedError.
        """
        ...

    def made_itself_safe(self) -> bool | None:
        """Whether the watchdog has acted since :meth:`provoke_watchdog`; None where this drive cannot show it."""
        ...

    def stop(self) -> None:
        """A command of zero, then idle. Never raises: it is called when things have already gone wrong."""
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
