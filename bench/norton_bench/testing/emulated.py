"""What a contract needs of the device that a driver is tested against: an emulation, or a script of it.

Values are in the device's own positive sense: what ``direction`` makes of them is what is tested.
"""

from dataclasses import dataclass
from typing import Protocol

from norton_drivers.ports import Backend
from norton_drivers.wiring import CanBusSettings, DeviceSettings


class EmulatedDevice(Protocol):
    """Any device."""

    def vanish(self) -> None:
        """From now on say nothing and hear nothing, as with the plug pulled."""
        ...


class EmulatedAmplifier(EmulatedDevice, Protocol):
    """A drive."""

    @property
    def armed(self) -> bool:
        """Whether it drives its motor now, be it with a command of zero."""
        ...

    @property
    def command(self) -> float:
        """What it acts upon now, in the driver's ``command_unit``; 0 where it is not armed."""
        ...

    def turn(self, position_rad: float, velocity_rad_s: float) -> None:
        """Let the shaft be there, and turn so fast."""
        ...


class EmulatedTorqueSensor(EmulatedDevice, Protocol):
    """A torque sensor."""

    def twist(self, torque_nm: float) -> None:
        """From now on measure this torque."""
        ...


Device = EmulatedAmplifier | EmulatedTorqueSensor


@dataclass(frozen=True)
class SetUp:
    """An emulated device at the end of a backend's wire, and how a rig file would name it.

    ``backend`` may be a :class:`ScriptedWorld`, the simulated backend, or the hardware's.
    """

    backend: Backend
    settings: DeviceSettings
    emulated: Device
    buses: tuple[CanBusSettings, ...] = ()

    @property
    def address(self) -> str:
        """The bus or port that every complaint about the device must name."""
        return self.settings.bus or self.settings.port or ""
