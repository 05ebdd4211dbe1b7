"""A world of its own for each test: time that moves only when somebody waits, a bus and a line with scripted ends."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import can
import pytest

from drivers.errors import ConnectionFailedError
from drivers.link import Link
from drivers.ports import CanPort, SerialPort
from drivers.wiring import CanBusSettings, DeviceSettings


class FakeClock:
    def __init__(self) -> None:
        self.ns = 1_000_000_000
        self.alarms: list[Callable[[int], None]] = []

    def now_ns(self) -> int:
        return self.ns

    def wait_until_ns(self, deadline_ns: int) -> None:
        self.ns = max(self.ns, deadline_ns)
        for alarm in list(self.alarms):
            alarm(self.ns)


class FakeBus(can.BusABC):
    """What is sent goes to ``peer``; what the peer puts into ``arriving`` is received."""

    def __init__(self) -> None:
        self.arriving: deque[can.Message] = deque()
        self.sent: list[can.Message] = []
        self.peer: Callable[[can.Message], None] = lambda _message: None
        self.broken = False
        super().__init__("fake")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.broken:
            raise can.CanOperationError("unplugged")
        self.sent.append(msg)
        self.peer(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return (self.arriving.popleft() if self.arriving else None), True

    def arrive(self, arbitration_id: int, data: bytes = b"", *, extended: bool = False, remote: bool = False) -> None:
        self.arriving.append(
            can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=extended, is_remote_frame=remote)
        )


class FakeLine:
    """What is written goes to ``peer``; what the peer puts into ``arriving`` is read."""

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
        pass


@dataclass
class FakeWorld:
    """A backend, and the far ends of its one bus and its one line."""

    clock: FakeClock = field(default_factory=FakeClock)
    bus: FakeBus = field(default_factory=FakeBus)
    line: FakeLine = field(default_factory=FakeLine)
    lock_step: bool = True

    def open_can(self, settings: CanBusSettings) -> CanPort:
        if settings.interface == "missing":
            raise ConnectionFailedError("no adapter")
        return CanPort(settings.name, self.bus, self.clock, lambda _message: self.clock.ns)

    def open_serial(self, port: str, baud: int) -> SerialPort:
        return SerialPort(port, self.line, self.clock)

    def close(self) -> None:
        self.bus.shutdown()

    def link(self) -> Link:
        return Link(self, (CanBusSettings("can0", "fake", "fake"),))


@pytest.fixture
def world():
    made = FakeWorld()
    yield made
    made.close()


@pytest.fixture
def device() -> Callable[..., DeviceSettings]:
    def make(role: str, driver: str, *, direction: int = 1, **options: object) -> DeviceSettings:
        return DeviceSettings(role, driver, bus="can0", port="fake", direction=direction, options=options)

    return make
