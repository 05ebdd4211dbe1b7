"""The simulated world in wall time, on real interfaces: another process meets the devices as it would meet hardware.

Installed as the entry point ``serve`` of the group ``norton_bench.simulators``; ``norton-bench sim serve RIG`` finds it
there. CAN buses are served on the rig's own python-can interface ("slcan" and "fdcanusb" at the rig's ``channel``, as a
serial device), serial devices on pseudo-terminals at the rig's ports, or over TCP where these are ``socket://`` URLs.
"""

import select
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random
from typing import Any, Protocol

import can

from norton_drivers.adapters.adapter import FullQueueError
from norton_drivers.errors import ConnectionFailedError, WiringError
from norton_drivers.hardware import HardwareBackend
from norton_drivers.ports import Backend, CanPort
from norton_drivers.real_time import SERVER_PRIORITY, in_real_time
from norton_drivers.wiring import CanBusSettings, Wiring
from norton_sim.assembly import build_world, mount
from norton_sim.connectors import CanConnector, HostEnd, SerialConnector, Trouble
from norton_sim.faults.injection import inject, read_faults
from norton_sim.faults.stage import Stage
from norton_sim.firmware.context import Wires
from norton_sim.served_adapters import ADAPTERS, ServedAdapter
from norton_sim.served_ports import served_port
from norton_sim.truth import FAULTS, read_truth
from norton_sim.witness import Standstills, WitnessFile
from norton_sim.world import World

# The plant is never further behind the wall clock than this while nothing is planned, nor is a frame answered later:
# like a drive's firmware, which looks for frames once in its cycle, this process is not woken by every one of them.
CYCLE_S = 0.25e-3


class _Served(HostEnd, Protocol):
    """A wire that can be emptied and taken down, and that faults can reach."""

    def receive(self) -> None:
        """Deliver what the host has sent."""
        ...

    def close(self) -> None: ...


class _Waking(_Served, Protocol):
    """A wire that can be waited on, since its bytes do not say when they came."""

    @property
    def lost(self) -> bool:
        """Whether nothing can be waited for any more."""
        ...

    def fileno(self) -> int: ...


class _WallTime:
    """Lets the world keep up with the wall clock."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.start_ns = time.monotonic_ns()

    def catch_up(self, to_ns: int | None = None) -> None:
        """To the monotonic clock's ``to_ns``, or to now."""
        self._world.advance((time.monotonic_ns() if to_ns is None else to_ns) - self.start_ns)

    def due_s(self) -> float:
        """How long nothing is planned to happen."""
        elapsed_ns = time.monotonic_ns() - self.start_ns
        return max((self._world.next_event_ns or 0) - elapsed_ns, 0) * 1e-9


class ServedBus:
    """A CAN bus on one of python-can's interfaces. Frames of our own that it echoes are dropped by ``drivers``.

    A command acts when it came, even where this process was not there to see it: a real drive never sleeps. The host's
    adapter is not ours to break: one that is unplugged or off the bus is merely cut off from it.
    """

    def __init__(self, settings: CanBusSettings, backend: Backend, wall: _WallTime) -> None:
        self._wall = wall
        self._port: CanPort = backend.open_can(settings)
        self._plugs: list[CanConnector] = []
        self._cut_off = False
        self._port.subscribe(self._deliver)

    def attach(self, plug: CanConnector) -> None:
        self._plugs.append(plug)

    def suffer(self, trouble: Trouble | None) -> None:
        self._cut_off = trouble in (Trouble.UNPLUGGED, Trouble.BUS_OFF)

    def report_error(self, error_class: int) -> None:
        self._port.bus.send(can.Message(arbitration_id=error_class, is_error_frame=True, data=bytes(8)))

    def to_host(self, arbitration_id: int, data: bytes, extended: bool, fd: bool) -> None:
        if self._cut_off:
            return
        try:
            self._port.send(arbitration_id, data, extended=extended, fd=fd)
        except ConnectionFailedError as error:
            if not isinstance(error.__cause__, FullQueueError):  # what does not fit is lost, as on a real bus
                raise

    def receive(self) -> None:
        self._port.poll()

    def close(self) -> None:
        self._port.close()

    def _deliver(self, message: can.Message, arrival_ns: int) -> None:
        self._wall.catch_up(arrival_ns)
        for plug in () if self._cut_off else self._plugs:
            plug.deliver(message)


class ServedLine:
    """A serial line with one device, on a pseudo-terminal at a path, or over TCP."""

    paced = False

    def __init__(self, path: str, wall: _WallTime) -> None:
        self._wall = wall
        self._port = served_port(path)
        self._connector: SerialConnector | None = None

    @property
    def lost(self) -> bool:
        return self._port.hung_up

    @property
    def host_baud(self) -> int | None:
        return self._port.baud

    def suffer(self, trouble: Trouble | None) -> None:
        if trouble is Trouble.UNPLUGGED:
            self._port.hang_up()

    def report_error(self, error_class: int) -> None:
        """Serial adapters do not tell."""

    def attach(self, plug: SerialConnector) -> None:
        self._connector = plug

    def to_host(self, data: bytes, begun_ns: int | None = None) -> None:
        self._port.write(data)

    def fileno(self) -> int:
        return self._port.fileno()

    def receive(self) -> None:
        data = self._port.read()
        if data and self._connector is not None:
            self._wall.catch_up()  # the line says nothing of when its bytes came
            self._connector.deliver(data)

    def close(self) -> None:
        self._port.close()


def serve(
    wiring: Wiring,
    simulated: Mapping[str, Any],
    *,
    seed: int | None,
    place: str,
    on_ready: Callable[[], None],
    stop: Callable[[], bool],
    witness: Path | None = None,
) -> Standstills:
    """Serve the rig's devices until ``stop()``; ``on_ready`` is called once when everything is open.

    Returns how long this process stood still, which its devices did with it.

    The rig's faults happen in wall time. What is true goes to the file ``witness``, a line a millisecond. An interrupt
    takes everything down too and goes on to the caller as KeyboardInterrupt; so does SIGTERM. Raises WiringError for
    wrong true values or faults, ConnectionFailedError where an interface or a port cannot be opened.
    """
    truth = read_truth(
        simulated,
        seed=seed,
        place=place,
        command_unit=wiring.command_unit,
        modulation_unit=wiring.modulation_unit,
    )
    faults = read_faults(simulated.get(FAULTS, ()), wiring, place=place, section=f"simulated.{FAULTS}")
    world = build_world(wiring, truth, place)
    with _termination_interrupts(), ExitStack() as open_wires:
        wall = _WallTime(world)
        wires = _ServedWires(wiring, open_wires, wall)
        mount(world, wiring, truth, Wires(wires.can, wires.serial), place)
        for number, fault in enumerate(faults):
            inject(fault, Stage(world, wiring, wires.ends, None, Random(f"{truth.seed} {number} {fault.kind}")))
        if witness is not None:
            open_wires.callback(_witness(witness, world, wall.start_ns).close)
        on_ready()
        standstills = Standstills()
        with in_real_time(SERVER_PRIORITY):
            while not stop():
                waiting = wires.waiting(min(wall.due_s(), CYCLE_S))
                now_ns = time.monotonic_ns()  # what comes while others are received must find the world as it was
                standstills.goes_on(now_ns)
                for wire in waiting:
                    wire.receive()
                wall.catch_up(now_ns)
        return standstills


def _witness(path: Path, world: World, epoch_ns: int) -> WitnessFile:
    try:
        return WitnessFile(path, world, epoch_ns)
    except OSError as error:
        raise WiringError(f"witness {path}: cannot be written ({error.strerror}); name another file") from error


@contextmanager
def _termination_interrupts() -> Iterator[None]:
    """SIGTERM unwinds as an interrupt does; only the main thread may say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


class _ServedWires:
    """Opens each bus and port once, and closes all of them with ``stack``."""

    def __init__(self, wiring: Wiring, stack: ExitStack, wall: _WallTime) -> None:
        self._wall = wall
        self._settings = {bus.name: bus for bus in wiring.buses}
        self._stack = stack
        self._backend = HardwareBackend()
        self._buses: dict[str, ServedBus | ServedAdapter] = {}
        self._lines: dict[str, ServedLine] = {}
        self._waking: list[_Waking] = []
        self._looked_at: list[_Served] = []

    def can(self, bus: str) -> CanConnector:
        if bus not in self._buses:
            self._buses[bus] = self._open(self._settings[bus])
            self._stack.callback(self._buses[bus].close)
        return CanConnector(self._buses[bus])

    def _open(self, settings: CanBusSettings) -> ServedBus | ServedAdapter:
        if settings.interface in ADAPTERS:
            adapter = ADAPTERS[settings.interface](settings, self._wall.catch_up)
            self._waking.append(adapter)
            return adapter
        bus = ServedBus(settings, self._backend, self._wall)
        self._looked_at.append(bus)
        return bus

    def serial(self, port: str) -> SerialConnector:
        wire = ServedLine(port, self._wall)
        self._stack.callback(wire.close)
        self._lines[port] = wire
        self._waking.append(wire)
        return SerialConnector(wire)

    @property
    def ends(self) -> Mapping[str, HostEnd]:
        """By bus and by port."""
        return {**self._buses, **self._lines}

    def waiting(self, timeout_s: float) -> list[_Served]:
        """The wires on which something may wait to be received, after at most ``timeout_s``."""
        ready: list[_Waking] = []
        if waking := [wire for wire in self._waking if not wire.lost]:
            ready, _, _ = select.select(waking, [], [], timeout_s)
        else:  # Windows selects from something, or not at all
            time.sleep(timeout_s)
        return [*ready, *self._looked_at]
