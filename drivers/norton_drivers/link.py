"""The open ports of a bench, so that all of them are polled, tapped and closed as one."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

from norton_drivers.errors import ConnectionFailedError, WiringError
from norton_drivers.ports import Backend, CanPort, Clock, SerialPort, Tap
from norton_drivers.wiring import CanBusSettings, DeviceSettings

Shared = TypeVar("Shared")

# How long a waiting driver lets pass between two looks at its ports.
POLL_INTERVAL_NS = 1_000_000


@dataclass
class Link:
    """Opens ports on first use and shares each between the devices on it.

    ``keep_alive`` is called while a driver waits: drives that are already enabled want their watchdogs fed.
    ``questions`` are called before every poll: a device that speaks only when it is spoken to is asked there. Neither
    may wait. What is asked once a tick is not asked where the bench ``reads_ahead``.
    """

    backend: Backend
    buses: tuple[CanBusSettings, ...]
    can_ports: dict[str, CanPort] = field(default_factory=dict)
    serial_ports: dict[str, SerialPort] = field(default_factory=dict)
    keep_alive: Callable[[], None] | None = None
    questions: list[Callable[[], None]] = field(default_factory=list)
    reads_ahead: bool = field(default=False, init=False)
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

    def read_ahead(self) -> None:
        """A poll between two ticks. Raises ConnectionFailedError as :meth:`poll`."""
        self.reads_ahead = True
        try:
            self.poll()
        finally:
            self.reads_ahead = False

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


def wait_until(
    arrived: Callable[[], bool], link: Link, timeout_s: float, meanwhile: Callable[[], object] | None = None
) -> bool:
    """Wait for a device's answer.

    Poll until ``arrived()``; False where ``timeout_s`` passed first. ``meanwhile`` is called before each poll.

    Raises ConnectionFailedError, and whatever the two functions raise.
    """
    deadline_ns = link.clock.now_ns() + round(timeout_s * 1e9)
    while not arrived():
        if link.clock.now_ns() >= deadline_ns:
            return False
        if meanwhile is not None:
            meanwhile()
        link.wait()
    return True


# The first answer after a port was opened may be to a question that somebody else asked.
ANSWERS_THAT_TELL = 2


class Questions:
    """Asks a device that speaks only when spoken to: one question at a time; a lost answer is asked for again.

    Asks again as soon as the last answer is there, or after ``timeout_s`` where none came.

    Answers do not say what they answer. One that comes after a question was given up may be that question's own,
    late; so nothing more is asked until the other, if there is one, must have come too, and found nobody waiting.

    ``ask`` sends the question. ``pause_s`` is how long the device or its line wants to be left alone after an
    answer. ``once_a_tick``: what answers quickly is not asked twice in a tick, so that its readings come evenly.
    ``answers`` and ``unanswered`` count. While ``hushed``, nothing is asked.
    """

    def __init__(
        self,
        link: Link,
        ask: Callable[[], None],
        timeout_s: float,
        pause_s: float = 0.0,
        *,
        once_a_tick: bool = False,
    ) -> None:
        self.answers = 0
        self.unanswered = 0
        self.hushed = False
        self._ask = ask
        self._clock = link.clock
        self._timeout_ns = round(timeout_s * 1e9)
        self._pause_ns = round(pause_s * 1e9)
        self._asked_ns: int | None = None
        self._overdue = False
        self._given_up = False  # whether the question before the present one got no answer
        self._free_ns = 0  # when the next question may be asked
        self._once_a_tick = once_a_tick
        self._asked_in_tick = False
        self._link = link
        link.questions.append(self._begin_poll)

    def _begin_poll(self) -> None:
        if self._once_a_tick and self._link.reads_ahead:
            return
        self._asked_in_tick = False
        self.ask_if_due()

    def ask_if_due(self) -> None:
        """Ask, where nothing is awaited and the line may be used. Raises ConnectionFailedError."""
        now_ns = self._clock.now_ns()
        if self.hushed:
            return
        if self._asked_ns is None:
            if now_ns >= self._free_ns:
                self._given_up = False
                self._send(now_ns)
        elif now_ns < self._asked_ns + self._timeout_ns:
            return
        elif not self._overdue:
            # This computer may have stood still, with the answer waiting in its buffers: the ports come first.
            self._overdue = True
        else:
            self.unanswered += 1
            self._given_up = True
            self._send(now_ns)

    def answered(self, arrival_ns: int) -> int | None:
        """Take note of an answer, and ask anew. Returns when it was asked for, None where nothing was awaited.

        Raises ConnectionFailedError.
        """
        asked_ns = self._asked_ns
        if asked_ns is not None:
            self.answers += 1
            self._asked_ns = None
            self._free_ns = asked_ns + self._timeout_ns if self._given_up else arrival_ns + self._pause_ns
            # At once rather than at the next poll: a tick is as long as some devices take to answer. But a device that
            # takes no time at all must not keep the poll from ending.
            if self._clock.now_ns() > asked_ns and not (self._once_a_tick and self._asked_in_tick):
                self.ask_if_due()
        return asked_ns

    def _send(self, now_ns: int) -> None:
        self._asked_ns, self._overdue, self._asked_in_tick = now_ns, False, True
        self._ask()
