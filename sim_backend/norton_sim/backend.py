"""The simulated backend: buses and ports into a simulated world, and the clock that makes it move."""

from collections.abc import Callable, Mapping, Sequence
from random import Random
from typing import Any

import can

from norton_drivers.errors import ConnectionFailedError
from norton_drivers.ports import CanPort, SerialPort, TrueState
from norton_drivers.wiring import CanBusSettings, Wiring
from norton_sim.assembly import build_world, mount
from norton_sim.buses import SimulatedBus, SimulatedCanWire, SimulatedLine, SimulatedSerialWire
from norton_sim.connectors import CanConnector, Delay, HostEnd, SerialConnector
from norton_sim.faults.injection import inject, read_faults
from norton_sim.faults.schema import Fault
from norton_sim.faults.stage import Injected, Stage
from norton_sim.firmware.context import Wires
from norton_sim.truth import FAULTS, Truth, read_truth
from norton_sim.witness import watch
from norton_sim.world import Timeline, World


class SimulatedClock:
    """Simulated time, from zero; waiting makes it pass, and everything happen that falls due."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._awake_ns = 0

    def now_ns(self) -> int:
        return self._world.now_ns

    def wait_until_ns(self, deadline_ns: int, awake: Callable[[], object] | None = None) -> None:
        self._world.advance(deadline_ns)
        while self._awake_ns > self._world.now_ns:
            self._world.advance(self._awake_ns)

    def stall(self, duration_ns: int) -> None:
        """Whoever waits now wakes up only after that; the world goes on meanwhile."""
        self._awake_ns = self._world.now_ns + duration_ns


class SimulatedBackend:
    """See :class:`norton_drivers.ports.Rehearsal`. ``world`` is for tests and benchmarks that know the truth.

    A ``timeline`` is given where other benches live in the same time.
    """

    lock_step = True

    def __init__(self, wiring: Wiring, truth: Truth, place: str, timeline: Timeline | None = None) -> None:
        self.world = build_world(wiring, truth, place, timeline)
        self.clock = SimulatedClock(self.world)
        self._injected: list[Injected] = []
        self._wiring = wiring
        self._truth = truth
        self._can_wires: dict[str, SimulatedCanWire] = {}
        self._serial_wires: dict[str, SimulatedSerialWire] = {}
        self._ports: list[CanPort | SerialPort] = []
        mount(self.world, wiring, truth, Wires(self._can_plug, self._serial_plug), place)

    def open_can(self, settings: CanBusSettings) -> CanPort:
        bus = SimulatedBus(settings.name, self.world, self._can_wire(settings.name))
        fd, switches_bitrate = settings.fd, settings.switches_bitrate
        port = CanPort(settings.name, bus, self.clock, _stamp_ns, fd=fd, switches_bitrate=switches_bitrate)
        self._ports.append(port)
        return port

    def open_serial(self, port: str, baud: int) -> SerialPort:
        wire = self._serial_wires.get(port)
        if wire is None:
            known = ", ".join(self._serial_wires) or "none"
            raise ConnectionFailedError(f"port {port}: no simulated device is there (there is: {known})")
        line = SimulatedLine(self.world, wire, baud)
        serial_port = SerialPort(port, line, self.clock, line.arrival_ns)
        self._ports.append(serial_port)
        return serial_port

    def close(self) -> None:
        for port in self._ports:
            port.close()
        self._ports.clear()

    def read_faults(self, tables: object, *, place: str) -> tuple[Fault, ...]:
        return read_faults(tables, self._wiring, place=place, section="fault")

    def inject(self, *faults: Fault) -> tuple[Injected, ...]:
        for fault in faults:
            self._injected.append(inject(fault, self._stage(fault)))
        return tuple(self._injected[len(self._injected) - len(faults) :])

    @property
    def injected(self) -> Sequence[Injected]:
        return self._injected

    def watch(self) -> Sequence[TrueState]:
        return watch(self.world)

    def _stage(self, fault: Fault) -> Stage:
        # Seeded by number and kind: the same faults draw the same numbers, whatever else happens.
        random = Random(f"{self._truth.seed} {len(self._injected)} {fault.kind}")
        ends: dict[str, HostEnd] = {**self._can_wires, **self._serial_wires}
        return Stage(self.world, self._wiring, ends, self.clock.stall, random)

    def _can_wire(self, bus: str) -> SimulatedCanWire:
        if bus not in self._can_wires:
            transport = self._truth.transport
            delays = [
                Delay(transport.can_delay_ns, transport.can_jitter_ns, self._random(bus, direction))
                for direction in ("to host", "to devices")
            ]
            switches_bitrate = any(each.switches_bitrate for each in self._wiring.buses if each.name == bus)
            self._can_wires[bus] = SimulatedCanWire(self.world, *delays, switches_bitrate=switches_bitrate)
        return self._can_wires[bus]

    def _can_plug(self, bus: str) -> CanConnector:
        return CanConnector(self._can_wire(bus))

    def _serial_plug(self, port: str) -> SerialConnector:
        transport = self._truth.transport
        delays = [
            Delay(transport.serial_delay_ns, transport.serial_jitter_ns, self._random(port, direction))
            for direction in ("to host", "to device")
        ]
        self._serial_wires[port] = SimulatedSerialWire(self.world, *delays)
        return SerialConnector(self._serial_wires[port])

    def _random(self, wire: str, direction: str) -> Random:
        return Random(f"{self._truth.seed} {wire} {direction}")


def _stamp_ns(message: can.Message) -> int:
    # A float64 of seconds tells nanoseconds apart for the first hundred days of simulated time.
    return round(message.timestamp * 1e9)


def open_backend(wiring: Wiring, simulated: Mapping[str, Any], *, seed: int | None, place: str) -> SimulatedBackend:
    """A bench as ``wiring`` and the rig file's ``[simulated]`` describe it, at standstill at time zero.

    Raises WiringError, with place and mend, for true values that are wrong or missing.
    """
    return simulated_backend(wiring, simulated, seed=seed, place=place)


def simulated_backend(
    wiring: Wiring, simulated: Mapping[str, Any], *, seed: int | None, place: str, timeline: Timeline | None = None
) -> SimulatedBackend:
    """As :func:`open_backend`, in a ``timeline`` of its own or in that of other benches."""
    truth = read_truth(
        simulated,
        seed=seed,
        place=place,
        command_unit=wiring.command_unit,
        modulation_unit=wiring.modulation_unit,
    )
    backend = SimulatedBackend(wiring, truth, place, timeline)
    backend.inject(*read_faults(simulated.get(FAULTS, ()), wiring, place=place, section=f"simulated.{FAULTS}"))
    return backend
