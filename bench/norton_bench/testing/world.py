"""A world to script a device in: time that moves only when somebody waits, one CAN bus and one serial line."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import can

from norton_drivers.errors import ConnectionFailedError
from norton_drivers.link import Link
from norton_drivers.ports import CanPort, SerialPort
from norton_drivers.wiring import CanBusSettings

# Waiting for longer goes by in steps of this, so that a device acts in time.
STEP_NS = 1_000_000


class ScriptedClock:
    """``ns`` is now. ``alarms`` are called with it whenever it has moved, at least once a millisecond."""

    def __init__(self) -> None:
        self.ns = 1_000_000_000
        self.alarms: list[Callable[[int], None]] = []

    def now_ns(self) -> int:
        return self.ns

    def wait_until_ns(self, deadline_ns: int, awake: Callable[[], object] | None = None) -> None:
        while True:
            self.ns = max(self.ns, min(deadline_ns, self.ns + STEP_NS))
            for alarm in list(self.alarms):
                alarm(self.ns)
            if self.ns >= deadline_ns:
                return


class ScriptedBus(can.BusABC):
    """What is sent goes to ``peer`` and is kept in ``sent``; what the peer lets :meth:`arrive` is received."""

    def __init__(self) -> None:
        self.arriving: deque[can.Message] = deque()
        self.sent: list[can.Message] = []
        self.peer: Callable[[can.Message], None] = lambda _message: None
        self.broken = False
        super().__init__("scripted")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.broken:
            raise can.CanOperationError("unplugged")
        self.sent.append(msg)
        self.peer(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return (self.arriving.popleft() if self.arriving else None), True

    def arrive(
        self,
        arbitration_id: int,
        data: bytes = b"",
        *,
        extended: bool = False,
        remote: bool = False,
        fd: bool = False,
    ) -> None:
        """Let a frame come from the other end."""
        kind = {"is_extended_id": extended, "is_remote_frame": remote, "is_fd": fd}
        self.arriving.append(can.Message(arbitration_id=arbitration_id, data=data, **kind))


class ScriptedLine:
    """What is written goes to ``peer`` and is kept in ``sent``; what the peer adds to ``arriving`` is read."""

    def __init__(self) -> None:
        self.arriving = b""
        self.sent: list[bytes] = []
        self.peer: Callable[[bytes], None] = lambda _data: None

    @property
    def in_waiting(self) -> int:
        return len(self.arriving)

    def read(self, size: int = 1) -> bytes:
        data, self.arriving = self.arriving[:size], self.arriving[size:]
        return data

    def write(self, data: bytes, /) -> int:
        self.sent.append(data)
        self.peer(data)
        return len(data)

    def close(self) -> None:
        """Nothing to release."""


@dataclass
class ScriptedWorld:
    """A backend with one CAN bus, ``can0``, and one serial line under any name; both with scripted far ends.

    A bus whose interface is ``"missing"`` cannot be opened.
    """

    clock: ScriptedClock = field(default_factory=ScriptedClock)
    bus: ScriptedBus = field(default_factory=ScriptedBus)
    line: ScriptedLine = field(default_factory=ScriptedLine)
    lock_step: bool = True
    buses: tuple[CanBusSettings, ...] = (CanBusSettings("can0", "scripted", "scripted"),)

    def open_can(self, settings: CanBusSettings) -> CanPort:
        if settings.interface == "missing":
            raise ConnectionFailedError("no adapter")
        return CanPort(
            settings.name,
            self.bus,
            self.clock,
            lambda _message: self.clock.ns,
            fd=settings.fd,
            switches_bitrate=settings.switches_bitrate,
        )

    def open_serial(self, port: str, baud: int) -> SerialPort:
        return SerialPort(port, self.line, self.clock)

    def close(self) -> None:
        self.bus.shutdown()

    def link(self) -> Link:
        """For drivers that are opened by hand."""
        return Link(self, self.buses)
