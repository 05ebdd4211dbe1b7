"""What an emulated device's firmware is given: its settings, the world, its wires, its true values."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import exp
from random import Random
from typing import Protocol

from norton_drivers.errors import WiringError
from norton_drivers.wiring import DeviceSettings, Wiring
from norton_sim.connectors import CanConnector, SerialConnector
from norton_sim.half_duplex import HalfDuplexLine
from norton_sim.hookup import AS_WRITTEN, Hookup
from norton_sim.plant import Plant
from norton_sim.truth import Truth
from norton_sim.world import Action, Firmware, World

# Crystals of such devices are good to some tens of parts per million.
CRYSTAL_PPM = 50.0


class DriveFault(Enum):
    """What can go wrong in any drive, whatever its maker calls it."""

    FAULT = "fault"
    UNDERVOLTAGE = "undervoltage"
    OVER_TEMPERATURE = "over-temperature"


class DriveFirmware(Firmware, Protocol):
    """An emulated drive."""

    @property
    def armed(self) -> bool:
        """Whether it drives its motor, even with a current of zero."""
        ...

    def break_down(self, fault: DriveFault) -> None:
        """Detect ``fault`` now: react and report as the real drive would."""
        ...


@dataclass(frozen=True)
class Wires:
    """Makes the connector of a device: ``can(bus)`` and ``serial(port)``."""

    can: Callable[[str], CanConnector]
    serial: Callable[[str], SerialConnector]


@dataclass(frozen=True)
class DeviceContext:
    """What one device's firmware is given. Its clock has its own rate and phase, drawn from ``random``."""

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

    def can_connector(self) -> CanConnector:
        """Connect the device to its bus. Raises WiringError where the rig has no such bus."""
        buses = {bus.name: bus for bus in self.wiring.buses}
        if self.settings.bus not in buses:
            known = ", ".join(buses) or "none"
            raise WiringError(
                f"[{self.settings.role}] bus = {self.settings.bus!r} is not a bus of this rig (known: {known})"
            )
        plug = self.wires.can(self.settings.bus)
        self.world.wires[self.settings.role] = plug
        self.hookup.connect_can(plug, buses[self.settings.bus])
        return plug

    def serial_connector(self) -> SerialConnector:
        """Connect the device to its port. Raises WiringError where the rig names none."""
        return self._connected(self.wires.serial(self._port()))

    def half_duplex_connector(self, baud: int) -> SerialConnector:
        """Connect the device to the line that it shares with others. Raises WiringError where the rig names none."""
        port, lines = self._port(), self.world.lines
        if port not in lines:
            lines[port] = HalfDuplexLine(self.world, self.wires.serial(port))
        return self._connected(lines[port].connector(baud))

    def _port(self) -> str:
        if self.settings.port is None:
            raise WiringError(
                f'[{self.settings.role}] driver = {self.settings.driver!r} needs a serial port: add port = "..."'
            )
        return self.settings.port

    def _connected(self, plug: SerialConnector) -> SerialConnector:
        self.world.wires[self.settings.role] = plug
        self.hookup.connect_serial(plug)
        return plug


class TorqueSignal:
    """What a torque sensor measures, and how a test makes it lie.

    The plant's torque sensor, which can be made to stand still or to give a value of the test's choosing.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._forced_nm: float | None = None

    def measure_nm(self) -> float:
        """One measurement now, in the sensor's own sense."""
        return self._plant.sensor_torque_nm() if self._forced_nm is None else self._forced_nm

    def freeze(self) -> None:
        """From now on give the value of this instant."""
        self._forced_nm = self.measure_nm()

    def force(self, torque_nm: float) -> None:
        """From now on give ``torque_nm``, which may be NaN."""
        self._forced_nm = torque_nm


AMBIENT_C = 25.0
LIMIT_C = 100.0
RISE_K_PER_A2 = 0.1  # in the end, for each ampere squared
TIME_CONSTANT_S = 20.0


class Heating:
    """How warm a drive's transistors are.

    One heat capacity that tends to ambient + rise · current²; a test may set ``temperature_c``.
    """

    def __init__(self) -> None:
        self.temperature_c = AMBIENT_C

    def carry(self, current_a: float, duration_s: float) -> None:
        """Let a current flow for a while."""
        end_c = AMBIENT_C + RISE_K_PER_A2 * current_a**2
        self.temperature_c += (end_c - self.temperature_c) * (1 - exp(-duration_s / TIME_CONSTANT_S))

    @property
    def too_hot(self) -> bool:
        return self.temperature_c > LIMIT_C


SHORTEST_PERIOD_NS = 1_000_000  # the firmware itself looks no oftener


class Watchdog:
    """A drive's watchdog: acts where the host has fallen silent.

    Off until it is switched on; then ``expire`` is called where nobody feeds it, again and again.
    """

    def __init__(self, world: World, expire: Callable[[], None]) -> None:
        self.enabled = False
        self.timeout_ns = 0
        self._world = world
        self._expire = expire
        self._fed_ns = 0
        self._look_ns = 0

    def feed(self) -> None:
        self._fed_ns = self._world.now_ns

    def configure(self, *, enabled: bool, timeout_ns: int) -> None:
        """From now on bite, where ``enabled``, after ``timeout_ns`` without being fed."""
        self.enabled, self.timeout_ns = enabled, timeout_ns
        if enabled:
            self._look_after(self._fed_ns)

    def _look_after(self, instant_ns: int) -> None:
        """See a timeout after ``instant_ns`` whether the drive starves: once, instead of at each of many feedings."""
        self._look_ns = max(instant_ns + self.timeout_ns, self._world.now_ns + SHORTEST_PERIOD_NS)
        self._world.at(self._look_ns, self._look)

    def _look(self, stamp_ns: int) -> None:
        # A look that was planned before it was configured anew has been replaced by another.
        if not self.enabled or stamp_ns != self._look_ns:
            return
        starved = stamp_ns >= self._fed_ns + self.timeout_ns
        if starved:
            self._expire()
        self._look_after(stamp_ns if starved else self._fed_ns)
