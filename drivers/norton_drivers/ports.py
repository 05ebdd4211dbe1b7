"""A bench's clock, its CAN buses and its serial lines, and who opens them.

A bus or a line is shared by the drivers on it: it sends, drains what arrived, hands it on, and keeps a tap. Nothing
here blocks: ``poll`` takes what the transport already holds.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import can

from norton_drivers.adapters.adapter import Health, LinkError, StateOnly
from norton_drivers.codecs.can_errors import CanErrorFrame
from norton_drivers.errors import ConnectionFailedError, reason_of
from norton_drivers.readings import ERROR_FRAME, RawFrame
from norton_drivers.wiring import CanBusSettings, Wiring

# Sleeping alone wakes 50-100 µs late; the last stretch before a deadline is spent awake instead,
SPIN_NS = 150_000
# twice as long where there is something to do then, but nothing of it is begun when so little is left. With less of it
# the latest hundredth of the ticks began 20 to 300 µs late.
BUSY_NS, LATEST_NS = 300_000, 50_000
# Of the time until the deadline, at most: a system may stop for a while who never sleeps in real time.
BUSY_SHARE = 0.7


# Time as the loop and the drivers know it: integer nanoseconds from one clock, which is passed in.
class Clock(Protocol):
    """A source of time. In simulation, waiting on it is what makes the plant move."""

    def now_ns(self) -> int:
        """The present instant [ns] since an arbitrary epoch."""
        ...

    def wait_until_ns(self, deadline_ns: int, awake: Callable[[], object] | None = None) -> None:
        """Return at ``deadline_ns``, or at once where it has passed.

        A clock that has to stay awake shortly before the deadline may call ``awake`` then, again and again.
        """
        ...


class MonotonicClock:
    """The machine's monotonic clock."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def wait_until_ns(self, deadline_ns: int, awake: Callable[[], object] | None = None) -> None:
        remaining_ns = deadline_ns - time.monotonic_ns()
        spin_ns = SPIN_NS if awake is None else min(BUSY_NS, BUSY_SHARE * remaining_ns)
        if remaining_ns > spin_ns:
            time.sleep((remaining_ns - spin_ns) * 1e-9)
        if awake is not None:
            while deadline_ns - time.monotonic_ns() > LATEST_NS:
                awake()
        while time.monotonic_ns() < deadline_ns:
            pass


Tap = Callable[[RawFrame], None]
FrameHandler = Callable[[can.Message, int], None]
BytesHandler = Callable[[bytes, int], None]

_UNEXPECTED_FD = "CAN FD frames on a bus that is not said to carry them, left out: add fd = true to it"


class SerialLine(Protocol):
    """One CAN bus or one serial line, shared by the drivers on it: sends, drains what arrived, hands it on, keeps a
    tap.

    Nothing here blocks: :meth:`poll` takes what the transport already holds.

    The part of pyserial's ``Serial`` that is used.
    """

    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1) -> bytes: ...
    def write(self, data: bytes, /) -> int | None: ...
    def close(self) -> None: ...


class CanPort:
    """One CAN bus, shared by the drivers on it.

    Parameters: the open bus; ``arrival_ns(message)``, which puts a received message's time stamp on ``clock``; the
    state that the bus reports; whether a frame that is not marked as received is one of our own, sent back;
    whether error frames say what they mean as Linux' do; whether it carries CAN FD frames (``fd``), and their data
    at a bit rate of their own (``switches_bitrate``).
    """

    def __init__(
        self,
        name: str,
        bus: can.BusABC,
        clock: Clock,
        arrival_ns: Callable[[can.Message], int],
        *,
        health: Health | None = None,
        marks_own_frames: bool = True,
        linux_error_frames: bool = True,
        fd: bool = False,
        switches_bitrate: bool = False,
    ) -> None:
        self.name = name
        self.fd = fd
        self.bus = bus
        self.tap: Tap | None = None
        self.error_frames = 0
        self.own_frames = 0  # those that came back, and were left out
        self._clock = clock
        self._arrival_ns = arrival_ns
        self._health = StateOnly(bus) if health is None else health
        self._marks_own_frames = marks_own_frames
        self._linux_error_frames = linux_error_frames
        self._switches_bitrate = switches_bitrate
        self._errors: dict[str, int] = {}
        self._off_bus = False
        self._subscribed: list[tuple[FrameHandler, Collection[int] | None]] = []
        self._handlers: dict[int, list[FrameHandler]] = {}  # by the identifiers that some of them named
        self._of_others: list[FrameHandler] = []  # of all other identifiers

    def subscribe(self, handler: FrameHandler, identifiers: Collection[int] | None = None) -> None:
        """Call ``handler(message, arrival_ns)`` for every data or remote frame received, or for those with one of
        ``identifiers``, standard or extended."""
        self._subscribed.append((handler, identifiers))
        named = {identifier for _, each in self._subscribed for identifier in each or ()}
        self._handlers = {identifier: self._listening_to(identifier) for identifier in named}
        self._of_others = [each for each, its in self._subscribed if its is None]

    def _listening_to(self, identifier: int) -> list[FrameHandler]:
        return [each for each, its in self._subscribed if its is None or identifier in its]

    def send(
        self, arbitration_id: int, data: bytes, *, extended: bool = False, remote: bool = False, fd: bool = False
    ) -> None:
        """Put one frame on the bus; a CAN FD frame has one of the lengths that such a frame can have.

        Raises ConnectionFailedError where the transport refuses it.
        """
        switched, length = fd and self._switches_bitrate, 8 if remote else len(data)
        # Positions: stamp, identifier, extended, remote, error frame, channel, length, data, FD, received, switched.
        message = can.Message(0.0, arbitration_id, extended, remote, False, None, length, data, fd, True, switched)
        try:
            self.bus.send(message)
        except (can.CanError, OSError) as error:
            raise ConnectionFailedError(
                f"bus {self.name}: cannot send ({reason_of(error)}); {_mend(error, 'is the adapter plugged in?')}"
            ) from error
        if self.tap is not None:
            now_ns = self._clock.now_ns()
            self.tap(RawFrame(now_ns, self.name, True, data, arbitration_id, extended, remote, fd, switched))

    def poll(self) -> int:
        """Hand on every frame that has arrived; returns how many.

        Raises ConnectionFailedError for a lost bus, and for one that the controller has left (bus-off).
        """
        count, receive = 0, self.bus.recv
        while True:
            try:
                message = receive(0)
            except (can.CanError, OSError, ValueError) as error:
                raise ConnectionFailedError(
                    f"bus {self.name}: lost ({reason_of(error)}); {_mend(error, 'check adapter and cable')}"
                ) from error
            if message is None:
                break
            count += 1
            if message.is_error_frame:
                self._note_error(message)
            elif self._marks_own_frames and not message.is_rx:
                self.own_frames += 1
            elif message.is_fd and not self.fd:
                self._errors[_UNEXPECTED_FD] = self._errors.get(_UNEXPECTED_FD, 0) + 1
            else:
                self._hand_on(message)
        if self._off_bus:
            raise self._bus_off("an error frame says so")
        return count

    def _hand_on(self, message: can.Message) -> None:
        arrival_ns, identifier = self._arrival_ns(message), message.arbitration_id
        if self.tap is not None:
            self.tap(received_frame(message, arrival_ns, self.name))
        for handler in self._handlers.get(identifier, self._of_others):
            handler(message, arrival_ns)

    def ask(self) -> None:
        """Ask the adapter how it is; about once a second, not every tick. Raises ConnectionFailedError."""
        try:
            self._health.ask()
        except (can.CanError, OSError) as error:
            raise ConnectionFailedError(
                f"bus {self.name}: lost ({reason_of(error)}); check adapter and cable"
            ) from error
        if (known := self._health.off_bus) is not None:
            raise self._bus_off(known)

    def troubles(self) -> Mapping[str, int]:
        """What has gone wrong on the bus since it was opened, in words, and how often."""
        return {**self._errors, **{words: count for words, count in self._health.troubles().items() if count}}

    def _bus_off(self, known: str) -> ConnectionFailedError:
        return ConnectionFailedError(
            f"bus {self.name}: the controller has left the bus after too many errors (bus-off: {known}); "
            "check bitrate, wiring and termination, then set the bus up again"
        )

    def _note_error(self, message: can.Message) -> None:
        self.error_frames += 1
        if self.tap is not None:
            marked = message.arbitration_id | ERROR_FRAME
            self.tap(RawFrame(self._arrival_ns(message), self.name, False, bytes(message.data), marked))
        words: tuple[str, ...] = ("error frame",)
        if self._linux_error_frames:
            frame = CanErrorFrame.decode(message.arbitration_id, message.data)
            words = frame.words()
            self._off_bus = frame.bus_off or (self._off_bus and not frame.restarted)
        for each in words:
            self._errors[each] = self._errors.get(each, 0) + 1

    def close(self) -> None:
        """Release the bus."""
        self.bus.shutdown()


def received_frame(message: can.Message, arrival_ns: int, channel: str) -> RawFrame:
    """For the recording."""
    data, switched = bytes(message.data), message.is_fd and message.bitrate_switch
    extended, remote = message.is_extended_id, message.is_remote_frame
    return RawFrame(arrival_ns, channel, False, data, message.arbitration_id, extended, remote, message.is_fd, switched)


def _mend(error: Exception, usual: str) -> str:
    """The remedy: what the bus knows, or the usual one."""
    return error.mend if isinstance(error, LinkError) else usual


class SerialPort:
    """A serial line with its one listener."""

    def __init__(self, name: str, line: SerialLine, clock: Clock, arrival_ns: Callable[[], int] | None = None) -> None:
        self.name = name
        self.line = line
        self.tap: Tap | None = None
        self._clock = clock
        self._arrival_ns = arrival_ns or clock.now_ns
        self._handler: BytesHandler | None = None

    def subscribe(self, handler: BytesHandler) -> None:
        """Call ``handler(data, arrival_ns)`` for what was received; arrival is that of the last byte."""
        self._handler = handler

    def send(self, data: bytes) -> None:
        """Write bytes. Raises ConnectionFailedError where the port refuses them."""
        try:
            self.line.write(data)
        except OSError as error:
            raise ConnectionFailedError(
                f"port {self.name}: cannot write ({reason_of(error)}); is it plugged in?"
            ) from error
        if self.tap is not None:
            self.tap(RawFrame(self._clock.now_ns(), self.name, True, data))

    def poll(self) -> int:
        """Hand on the bytes that have arrived; returns how many. Raises ConnectionFailedError for a lost port."""
        total = 0
        # A line that knows when its bytes came hands them out burst by burst, each with its own arrival.
        while True:
            try:
                waiting = self.line.in_waiting
                data = self.line.read(waiting) if waiting else b""
            except OSError as error:
                raise ConnectionFailedError(f"port {self.name}: lost ({reason_of(error)}); check the cable") from error
            if not data:
                return total
            total += len(data)
            arrival_ns = self._arrival_ns()
            if self.tap is not None:
                self.tap(RawFrame(arrival_ns, self.name, False, data))
            if self._handler is not None:
                self._handler(data, arrival_ns)

    def close(self) -> None:
        """Release the line."""
        self.line.close()


# The seam between the bench and the world: who opens ports and owns the clock. A driver cannot tell which it has.
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


class TrueState(NamedTuple):
    """A simulated bench at one instant, whatever its devices say of it; signs are the bench's.

    ``driving`` are the roles of the drives whose amplifiers head for a current other than zero, ``armed`` of those
    whose firmware has its loop closed.
    """

    stamp_ns: int
    torque_nm: float  # at the port
    velocity_rad_s: float  # of the actuator
    load_velocity_rad_s: float
    driving: tuple[str, ...]
    armed: tuple[str, ...]


class InjectedFault(Protocol):
    """What became of a fault; None for what has not happened yet."""

    @property
    def begun_ns(self) -> int | None: ...
    @property
    def ended_ns(self) -> int | None: ...
    @property
    def hits(self) -> int:
        """Frames or writes that it lost, held up or changed, where it is a fault of those."""
        ...

    @property
    def said(self) -> str:
        """What it is, in words."""
        ...


@runtime_checkable
class Rehearsal(Backend, Protocol):
    """A backend whose world can be made to fail."""

    def read_faults(self, tables: object, *, place: str) -> tuple[Any, ...]:
        """The faults written as ``[[fault]]`` tables in the file ``place``. Raises WiringError with place and mend."""
        ...

    def inject(self, *faults: Any) -> tuple[InjectedFault, ...]:
        """Let them happen, their times counted from now. Raises WiringError for what this bench has no place for."""
        ...

    @property
    def injected(self) -> Sequence[InjectedFault]:
        """Every fault so far, those of the rig file first."""
        ...

    def watch(self) -> Sequence[TrueState]:
        """From now on note what is true, four times a millisecond; the sequence grows as time passes."""
        ...
