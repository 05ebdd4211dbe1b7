"""A host in raw frames, of the actuator's drive on a simulated bus."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar, TypeVar

import can

from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend

MS = 1_000_000


class CanHost:
    """Sends and hears frames with identifiers of one kind. ``backend``'s actuator is at the other end."""

    extended: ClassVar[bool]

    def __init__(self, backend: SimulatedBackend, wiring: Wiring) -> None:
        self.world, self.plant = backend.world, backend.world.plant
        self.firmware: Any = self.world.devices["actuator"]
        self.bus = backend.open_can(wiring.buses[0]).bus

    def wait(self, ms: float) -> None:
        self.world.advance(self.world.now_ns + round(ms * MS))

    def put(self, identifier: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=self.extended))

    def heard(self) -> list[can.Message]:
        """What came since the last call."""
        return [each for each in iter(lambda: self.bus.recv(0), None) if each.is_extended_id is self.extended]

    @property
    def current_a(self) -> float:
        return self.plant.true_current_a("actuator")


AnyHost = TypeVar("AnyHost", bound=CanHost)


def opener(
    host: type[AnyHost],
    open_bench: Callable[..., SimulatedBackend],
    wiring: Wiring,
    driver: str,
    options: Mapping[str, Any],
) -> Callable[..., AnyHost]:
    """Opens a host of the ``driver``'s drive with these options and others."""

    def opened(**others: Any) -> AnyHost:
        actuator = DeviceSettings("actuator", driver, bus="can0", options={**options, **others})
        with_drive = replace(wiring, actuator=actuator)
        return host(open_bench(with_drive), with_drive)

    return opened
