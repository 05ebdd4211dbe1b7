"""The simulated world in wall time, on real interfaces: another process meets the devices as it would meet hardware.

Installed as the entry point ``serve`` of the group ``norton_bench.simulators``; ``norton-bench sim serve RIG`` finds it
there. CAN buses are served on the rig's own python-can interface (for "slcan" on a pseudo-terminal at the rig's
``channel``), serial devices on pseudo-terminals at the rig's ports.
"""

import select
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, Protocol

import can

from drivers.backend import Backend
from drivers.codecs.slcan import SlcanFrame, SlcanStream
from drivers.hardware import HardwareBackend
from drivers.ports import CanPort
from drivers.punctual import punctual
from drivers.wiring import CanBusSettings, Wiring
from sim_backend.assembly import build_world, mount
from sim_backend.firmware.site import Wires
from sim_backend.plugs import CanPlug, SerialPlug
from sim_backend.pseudo_terminals import ServedPort
from sim_backend.truth import read_truth
from sim_backend.world import World

# The plant is never further behind the wall clock than this while nothing is planned.
LONGEST_SLEEP_S = 0.5e-3


class _Served(Protocol):
    """A wire that can be waited on, emptied and taken down."""

    def fileno(self) -> int: ...
    def receive(self) -> None:
        """Deliver what the host has sent."""
        ...

    def close(self) -> None: ...


class _WallTime:
    """Lets the world keep up with the wall clock."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._start_ns = time.monotonic_ns()

    def catch_up(self, to_ns: int | None = None) -> None:
        """To the monotonic clock's ``to_ns``, or to now."""
        self._world.advance((time.monotonic_ns() if to_ns is None else to_ns) - self._start_ns)

    def due_s(self) -> float:
        """How long nothing is planned to happen."""
        elapsed_ns = time.monotonic_ns() - self._start_ns
        return max((self._world.next_event_ns or 0) - elapsed_ns, 0) * 1e-9


class ServedBus:
    """A CAN bus on one of python-can's interfaces. Frames of our own that it echoes are dropped by ``drivers``.

    A command acts when it came, even where this process was not there to see it: a real drive never sleeps.
    """

    def __init__(self, settings: CanBusSettings, backend: Backend, wall: _WallTime) -> None:
        self._wall = wall
        self._port: CanPort = backend.open_can(settings)
        self._plugs: list[CanPlug] = []
        self._port.subscribe(self._deliver)

    def attach(self, plug: CanPlug) -> None:
        self._plugs.append(plug)

    def to_host(self, arbitration_id: int, data: bytes, extended: bool) -> None:
        self._port.send(arbitration_id, data, extended=extended)

    def fileno(self) -> int:
        return self._port.bus.fileno()

    def receive(self) -> None:
        self._port.poll()

    def close(self) -> None:
        self._port.close()

    def _deliver(self, message: can.Message, arrival_ns: int) -> None:
        self._wall.catch_up(arrival_ns)
        for plug in self._plugs:
            plug.deliver(message)


class ServedSlcan:
    """A CAN bus behind an emulated slcan adapter; like many, it answers no commands and is always open."""

    def __init__(self, settings: CanBusSettings, wall: _WallTime) -> None:
        self._wall = wall
        self._port = ServedPort(settings.channel.partition("@")[0])
        self._stream = SlcanStream()
        self._plugs: list[CanPlug] = []

    def attach(self, plug: CanPlug) -> None:
        self._plugs.append(plug)

    def to_host(self, arbitration_id: int, data: bytes, extended: bool) -> None:
        self._port.write(SlcanFrame(arbitration_id, data, len(data), extended).encode())

    def fileno(self) -> int:
        return self._port.fileno()

    def receive(self) -> None:
        self._stream.feed(self._port.read())
        self._wall.catch_up()  # the line says nothing of when its bytes came
        while self._stream.frames:
            message = _message(self._stream.frames.popleft())
            for plug in self._plugs:
                plug.deliver(message)

    def close(self) -> None:
        self._port.close()


class ServedLine:
    """A serial line on a pseudo-terminal, with one device."""

    def __init__(self, path: str, wall: _WallTime) -> None:
        self._wall = wall
        self._port = ServedPort(path)
        self._plug: SerialPlug | None = None

    def attach(self, plug: SerialPlug) -> None:
        self._plug = plug

    def to_host(self, data: bytes) -> None:
        self._port.write(data)

    def fileno(self) -> int:
        return self._port.fileno()

    def receive(self) -> None:
        data = self._port.read()
        if data and self._plug is not None:
            self._wall.catch_up()  # the line says nothing of when its bytes came
            self._plug.deliver(data)

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
) -> None:
    """Serve the rig's devices until ``stop()``; ``on_ready`` is called once when everything is open.

    An interrupt takes everything down too and goes on to the caller as KeyboardInterrupt; so does SIGTERM. Raises
    WiringError for wrong true values, ConnectionFailedError where an interface or a port cannot be opened.
    """
    truth = read_truth(simulated, seed=seed, place=place, command_unit=wiring.command_unit)
    world = build_world(wiring, truth, place)
    with _termination_interrupts(), ExitStack() as open_wires:
        wall = _WallTime(world)
        wires = _ServedWires(wiring, open_wires, wall)
        mount(world, wiring, truth, Wires(wires.can, wires.serial))
        on_ready()
        with punctual():
            while not stop():
                for wire in wires.waiting(min(wall.due_s(), LONGEST_SLEEP_S)):
                    wire.receive()
                wall.catch_up()


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
        self._buses: dict[str, ServedBus | ServedSlcan] = {}
        self._wires: list[_Served] = []
        self._unwatched: list[_Served] = []

    def can(self, bus: str) -> CanPlug:
        if bus not in self._buses:
            settings = self._settings[bus]
            wire = self._open(settings)
            self._buses[bus] = wire
            self._keep(wire)
        return CanPlug(self._buses[bus])

    def _open(self, settings: CanBusSettings) -> ServedBus | ServedSlcan:
        if settings.interface == "slcan":
            return ServedSlcan(settings, self._wall)
        return ServedBus(settings, self._backend, self._wall)

    def serial(self, port: str) -> SerialPlug:
        wire = ServedLine(port, self._wall)
        self._keep(wire)
        return SerialPlug(wire)

    def waiting(self, timeout_s: float) -> list[_Served]:
        """The wires on which something waits to be received, after at most ``timeout_s``."""
        ready, _, _ = select.select(self._wires, [], [], timeout_s)
        return [*ready, *self._unwatched]

    def _keep(self, wire: _Served) -> None:
        self._stack.callback(wire.close)
        try:
            wire.fileno()
        except NotImplementedError:
            # Some of python-can's interfaces have nothing to wait on: those are looked at every time.
            self._unwatched.append(wire)
        else:
            self._wires.append(wire)


def _message(frame: SlcanFrame) -> can.Message:
    return can.Message(
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=frame.length,
        data=None if frame.remote else frame.data,
    )
