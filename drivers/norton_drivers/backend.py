"""The seam between the bench and the world: who opens ports and owns the clock. A driver cannot tell which it has."""

from collections.abc import Mapping
from typing import Any, Protocol

from norton_drivers.clock import Clock
from norton_drivers.ports import CanPort, SerialPort
from norton_drivers.wiring import CanBusSettings, Wiring


class Backend(Protocol):
    """Opens CAN buses and serial ports, and owns the clock."""

    @property
    def clock(self) -> Clock: ...

    @property
    def lock_step(self) -> bool:
        """True where time advances only while somebody waits on the clock, so that nothing can be late."""
        ...

    def open_can(self, settings: CanBusSettings) -> CanPort:
        """Raises ConnectionFailedError."""
        ...

    def open_serial(self, port: str, baud: int) -> SerialPort:
        """Raises ConnectionFailedError."""
        ...

    def close(self) -> None:
        """Release everything that was opened; may be called twice."""
        ...


class BackendFactory(Protocol):
    """What an entry point in the group ``norton_bench.backends`` names.

    ``simulated`` is the rig file's ``[simulated]`` table as read, which only a simulated backend looks into; ``seed``
    overrides its seed; ``place`` names the rig file for error messages. Raises WiringError with place and mend.
    """

    def __call__(self, wiring: Wiring, simulated: Mapping[str, Any], *, seed: int | None, place: str) -> Backend: ...
