"""Where an emulated device is mounted: what its firmware may touch."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from random import Random
from typing import Protocol

from norton_drivers.errors import WiringError
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.hookup import AS_WRITTEN, Hookup, bitrate_of
from norton_sim.plugs import CanPlug, SerialPlug
from norton_sim.truth import Truth
from norton_sim.world import Action, World

# Crystals of such devices are good to some tens of parts per million.
CRYSTAL_PPM = 50.0


class Firmware(Protocol):
    """An emulated device. It speaks only through its plug; the bench's tests can break it."""

    def freeze(self) -> None:
        """From now on report the values of this instant, in ever new messages."""
        ...


class DriveFault(Enum):
    """What can go wrong in any drive, whatever its maker calls it."""

    FAULT = "fault"
    UNDERVOLTAGE = "undervoltage"
    OVER_TEMPERATURE = "over-temperature"


class DriveFirmware(Firmware, Protocol):
    """An emulated drive."""

    @property
    def armed(self) -> bool:
        """Whether it drives its motor, be it with a current of zero."""
        ...

    def break_down(self, fault: DriveFault) -> None:
        """Detect ``fault`` now: react and report as the real drive would."""
        ...


@dataclass(frozen=True)
class Wires:
    """Makes the plug for a device: ``can(bus)`` and ``serial(port)``."""

    can: Callable[[str], CanPlug]
    serial: Callable[[str], SerialPlug]


@dataclass(frozen=True)
class Site:
    """One device's place on the bench. Its clock has its own rate and phase, drawn from ``random``."""

    settings: DeviceSettings
    wiring: Wiring
    world: World
    wires: Wires
    truth: Truth
    random: Random
    clock_ppm: float
    hookup: Hookup = AS_WRITTEN

    def cyclic(self, period_ns: int, action: Action) -> None:
        """Do ``action`` every ``period_ns`` of the device's own clock, from a random phase on."""
        period_ns = round(period_ns * (1 + self.clock_ppm * 1e-6))
        self.world.every(period_ns, action, first_ns=self.world.now_ns + self.random.randrange(period_ns))

    def can_plug(self) -> CanPlug:
        """Connect the device to its bus. Raises WiringError where the rig has no such bus."""
        names = [bus.name for bus in self.wiring.buses]
        if self.settings.bus not in names:
            known = ", ".join(names) or "none"
            raise WiringError(
                f"[{self.settings.role}] bus = {self.settings.bus!r} is not a bus of this rig (known: {known})"
            )
        plug = self.wires.can(self.settings.bus)
        self.world.wires[self.settings.role] = plug
        self.hookup.connect_can(plug, bitrate_of(self.wiring, self.settings.bus))
        return plug

    def serial_plug(self) -> SerialPlug:
        """Connect the device to its port. Raises WiringError where the rig names none."""
        if self.settings.port is None:
            raise WiringError(
                f'[{self.settings.role}] driver = {self.settings.driver!r} needs a serial port: add port = "..."'
            )
        plug = self.wires.serial(self.settings.port)
        self.world.wires[self.settings.role] = plug
        self.hookup.connect_serial(plug)
        return plug
