"""A host in raw bytes, of the actuator's drive on a simulated serial line."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.backend import SimulatedBackend

MS = 1_000_000
PORT = "/tmp/drive"


class SerialHost:
    """``backend``'s actuator is at the other end."""

    def __init__(self, backend: SimulatedBackend, baud: int) -> None:
        self.world = backend.world
        self.plant = backend.world.plant
        self.line = backend.open_serial(PORT, baud).line
        self.firmware: Any = backend.world.devices["actuator"]

    def send(self, data: bytes) -> None:
        self.line.write(data)

    def wait(self, duration_ms: float) -> None:
        self.world.advance(self.world.now_ns + round(duration_ms * MS))

    def ask(self, data: bytes, within_ms: float = 5) -> bytes:
        """What comes within that time."""
        self.heard()
        self.send(data)
        self.wait(within_ms)
        return self.heard()

    def heard(self) -> bytes:
        return b"".join(iter(lambda: self.line.read(self.line.in_waiting or 1), b""))

    @property
    def current_a(self) -> float:
        return self.plant.true_current_a("actuator")


def host_of(
    open_bench: Callable[..., SimulatedBackend],
    wiring: Wiring,
    truth: dict[str, Any],
    driver: str,
    unit: str,
    baud: int,
    **options: Any,
) -> SerialHost:
    actuator = DeviceSettings("actuator", driver, port=PORT, options={"baud": baud, **options})
    return SerialHost(open_bench(replace(wiring, actuator=actuator, command_unit=unit), actuator=truth), baud)
