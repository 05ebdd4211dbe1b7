"""Where faults happen: the world, and what of it a fault may touch."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from random import Random
from typing import cast

from norton_drivers.registry import DRIVES
from norton_drivers.wiring import Wiring
from norton_sim.connectors import CanConnector, HostEnd, SerialConnector
from norton_sim.faults.schema import Fault
from norton_sim.firmware.context import DriveFirmware
from norton_sim.world import World

Undo = Callable[[], None]


@dataclass(frozen=True)
class Stage:
    """``ends`` are the host's ends of the wires, by bus or serial port; ``stall`` makes the host stand still [ns], and
    is None where the host is another process."""

    world: World
    wiring: Wiring
    ends: Mapping[str, HostEnd]
    stall: Callable[[int], None] | None
    random: Random

    def plugs(self, on: str) -> list[CanConnector | SerialConnector]:
        """That of a device, or all on a bus."""
        return [self.world.wires[role] for role in self._roles(on)]

    def drive(self, role: str) -> DriveFirmware:
        return cast(DriveFirmware, self.world.devices[role])

    def armed(self) -> bool:
        """Whether all drives of the bench drive their motors."""
        drives = (device for device in self.wiring.devices() if device.role in DRIVES)
        return all(self.drive(device.role).armed for device in drives)

    def end(self, on: str) -> HostEnd:
        """The host's end of a bus, or of the wire of a device."""
        names = (device.bus or device.port for device in self.wiring.devices() if device.role == on)
        return self.ends[next(names, on) or on]

    def bitrate_bit_s(self, bus: str) -> int:
        return next(each.bitrate_bit_s for each in self.wiring.buses if each.name == bus)

    def bus_of(self, on: str) -> str | None:
        """The bus that ``on`` is, or is on; None on a serial line."""
        if any(bus.name == on for bus in self.wiring.buses):
            return on
        return next((device.bus for device in self.wiring.devices() if device.role == on), None)

    def _roles(self, on: str) -> Iterator[str]:
        return (device.role for device in self.wiring.devices() if on in (device.role, device.bus))


@dataclass
class Injected:
    """A fault that the world was given: when it began and ended, and how many frames or writes it hit."""

    fault: Fault
    begun_ns: int | None = field(default=None, init=False)
    ended_ns: int | None = field(default=None, init=False)
    hits: int = field(default=0, init=False)

    @property
    def said(self) -> str:
        """In words, for a recording."""
        options = self.fault.model_dump(exclude_defaults=True, exclude={"on", "at_s", "after"})
        details = ", ".join(f"{name} = {value:g}" for name, value in options.items() if isinstance(value, float))
        return f"{self.fault.kind} on {self.fault.where}" + (f" ({details})" if details else "")
