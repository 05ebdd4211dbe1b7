"""The open ports of a bench, so that all of them are polled, tapped and closed as one."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

from norton_drivers.backend import Backend
from norton_drivers.clock import Clock
from norton_drivers.errors import ConnectionFailedError, WiringError
from norton_drivers.ports import CanPort, SerialPort, Tap
from norton_drivers.wiring import CanBusSettings, DeviceSettings

Shared = TypeVar("Shared")

# How long a waiting driver lets pass between two looks at its ports.
POLL_INTERVAL_NS = 1_000_000


@dataclass
class Link:
    """Opens ports on first use and shares each between the devices on it.

    ``keep_alive`` is called while a driver waits: drives that are already enabled want their watchdogs fed.
    ``questions`` are called before every poll: a device that speaks only when it is spoken to is asked there. Neither
    may wait.
    """

    backend: Backend
    buses: tuple[CanBusSettings, ...]
    can_ports: dict[str, CanPort] = field(default_factory=dict)
    serial_ports: dict[str, SerialPort] = field(default_factory=dict)
    keep_alive: Callable[[], None] | None = None
    questions: list[Callable[[], None]] = field(default_factory=list)
    _polls: list[Callable[[], int]] = field(default_factory=list, init=False)  # of every open port
    _shared: dict[object, Any] = field(default_factory=dict, init=False)

    @property
    def clock(self) -> Clock:
        return self.backend.clock

    def can_port(self, device: DeviceSettings) -> CanPort:
        """The bus a device is on. Raises WiringError where the rig names no such bus."""
        settings = next((bus for bus in self.buses if bus.name == device.bus), None)
        if settings is None:
            known = ", ".join(bus.name for bus in self.buses) or "none"
            raise WiringError(f"[{device.role}] bus = {device.bus!r} is not a bus of this rig (known: {known})")
        if settings.name not in self.can_ports:
            self.can_ports[settings.name] = port = self.backend.open_can(settings)
            self._polls.append(port.poll)
        return self.can_ports[settings.name]

    def serial_port(self, device: DeviceSettings, baud: int) -> SerialPort:
        """The serial port a device is on. Raises WiringError where the rig names none."""
        if device.port is None:
            raise WiringError(f'[{device.role}] driver = {device.driver!r} needs a serial port: add port = "..."')
        if device.port not in self.serial_ports:
            self.serial_ports[device.port] = port = self.backend.open_serial(device.port, baud)
            self._polls.append(port.poll)
        return self.serial_ports[device.port]

    def shared(self, key: object, make: Callable[[], Shared]) -> Shared:
        """What the drivers on this bench have only one of, such as a bus's master: made by the first that asks."""
        if key not in self._shared:
            self._shared[key] = make()
        return cast(Shared, self._shared[key])

    def poll(self) -> None:
        """Ask those that want to be asked, then hand on all that has arrived.

        Raises ConnectionFailedError where a port is lost, but not before the others were heard.
        """
        lost: ConnectionFailedError | None = None
        for act in (*self.questions, *self._polls):
            try:
                act()
            except ConnectionFailedError as error:
                lost = error
        if lost is not None:
            raise lost

    def wait(self, duration_ns: int = POLL_INTERVAL_NS) -> None:
        """Let ``duration_ns`` pass, then poll: what a driver does while it waits for an answer."""
        if self.keep_alive is not None:
            self.keep_alive()
        self.clock.wait_until_ns(self.clock.now_ns() + duration_ns)
        self.poll()

    def ask_adapters(self) -> None:
        """Let every bus ask its adapter how it is; about once a second. Raises ConnectionFailedError."""
        for port in self.can_ports.values():
            port.ask()

    def troubles(self) -> dict[tuple[str, str], int]:
        """What has gone wrong on the buses since they were opened: (where, what) and how often."""
        return {
            (f"bus {name}", words): count
            for name, port in self.can_ports.items()
            for words, count in port.troubles().items()
        }

    def set_tap(self, tap: Tap | None) -> None:
        """Send a copy of every frame and chunk, both ways, to ``tap``."""
        for port in self._ports():
            port.tap = tap

    def close(self) -> None:
        """Close every port; the backend's clock keeps running."""
        for port in self._ports():
            port.close()
        self.can_ports.clear()
        self.serial_ports.clear()
        self.questions.clear()
        self._polls.clear()
        self._shared.clear()

    def _ports(self) -> list[CanPort | SerialPort]:
        return [*self.can_ports.values(), *self.serial_ports.values()]
