"""What drives on a serial line of their own share: they are commanded in every tick, and speak only when spoken to.

A driver says how bytes become answers (:meth:`SerialDrive._answers_in`) and what is asked in every tick
(:meth:`SerialDrive._next_question`); a tick passes without where the last answer is not there yet, and a lost one is
asked for again. What is asked now and then (:meth:`SerialDrive._next_aside`) goes behind a command, so that no reading
is missed for it. A reading belongs to the instant of its question plus a constant: that instant is its ``device_ns``.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple, Protocol

from norton_drivers.drive_base import DriveBase
from norton_drivers.errors import ConnectionFailedError, DeviceError, DeviceTimeoutError
from norton_drivers.link import Link, Questions, wait_until
from norton_drivers.ports import SerialPort
from norton_drivers.serial_timing import BITS_PER_BYTE, ByteStamps, opened_at
from norton_drivers.wiring import DeviceSettings

# A command that the line cannot begin to send within this time waits, and the next takes its place.
_LATEST_NS = 2_000_000
_FEED_INTERVAL_NS = 10_000_000  # while waiting; half of the shortest watchdog
_UNCOMMANDED_NS = 20_000_000  # then nothing is behind commands any more


class NewestFirst:
    """Sends what must not be late on a line that may be busy: of commands that pile up, the newest alone.

    Bytes that a system has taken cannot be taken back: a line that is given more than it carries delays every command
    after that.
    """

    def __init__(self, port: SerialPort, link: Link, baud: int) -> None:
        self._port = port
        self._clock = link.clock
        self._byte_ns = BITS_PER_BYTE * 1e9 / opened_at(baud)
        self._free_ns = 0  # when the line will have carried what it was given
        self._waiting: bytes | None = None
        link.questions.append(self._send_waiting)

    def send(self, data: bytes) -> None:
        """At once. Raises ConnectionFailedError."""
        now_ns = self._clock.now_ns()
        self._free_ns = max(self._free_ns, now_ns) + round(len(data) * self._byte_ns)
        self._port.send(data)

    def send_newest(self, data: bytes) -> None:
        """At once, or, where the line is behind, in the place of the last that waits. Raises ConnectionFailedError."""
        self._waiting = data
        self._send_waiting()

    @property
    def is_behind(self) -> bool:
        """Whether a command waits."""
        return self._waiting is not None

    def drop(self) -> None:
        """What waits is not to be sent any more."""
        self._waiting = None

    def _send_waiting(self) -> None:
        if self._waiting is not None and self._free_ns - self._clock.now_ns() <= _LATEST_NS:
            data, self._waiting = self._waiting, None
            self.send(data)


class Question(NamedTuple):
    """``fits(answer)`` tells whether an answer can be this question's; ``take(answer, asked_ns, arrival_ns)`` makes
    something of it."""

    data: bytes
    fits: Callable[[Any], bool]
    take: Callable[[Any, int, int], None]


class LineOptions(Protocol):
    """The part of their options that is needed here."""

    @property
    def baud(self) -> int: ...
    @property
    def timeout_s(self) -> float: ...


class SerialDrive(DriveBase):
    """One drive on one line. ``strangers`` counts answers that nobody asked for."""

    command_unit = ""

    def __init__(self, settings: DeviceSettings, options: LineOptions, link: Link) -> None:
        super().__init__(settings)
        baud = opened_at(options.baud)
        self._port = link.serial_port(settings, baud)
        self._link = link
        self._stamps = ByteStamps(baud)
        self.strangers = 0
        self._line = NewestFirst(self._port, link, options.baud)
        self._told: deque[Question] = deque()  # to be asked before anything else, once each
        self._asked: Question | None = None
        self._aside: Question | None = None  # asked behind a command
        self._aside_ns = self._commanded_ns = self._fed_ns = 0
        self._timeout_ns = round(options.timeout_s * 1e9)
        self.questions = Questions(link, self._ask, options.timeout_s, once_a_tick=True)
        self._port.subscribe(self._on_bytes)

    # ---- What a driver says --------------------------------------------------------------------------------------

    def _answers_in(self, data: bytes) -> Iterator[tuple[Any, int]]:
        """The answers completed by ``data``, each with how many of its bytes came later. Never raises."""
        raise NotImplementedError

    def _next_question(self) -> Question:
        """What is asked in every tick."""
        raise NotImplementedError

    def _next_aside(self) -> Question | None:
        """What is due now and then; its answers must not fit the questions of every tick, nor theirs its own."""
        return None

    @property
    def _place(self) -> str:
        raise NotImplementedError

    def command(self, value: float) -> float:
        raise NotImplementedError

    # ---- Questions -----------------------------------------------------------------------------------------------

    def _asks(self, data: bytes, fits: Callable[[Any], bool], timeout_s: float) -> Any:
        """The answer to one question, asked again until ``timeout_s`` is over; None where none came.

        Raises ConnectionFailedError.
        """
        wait_until(lambda: self._aside is None, self._link, self._timeout_ns * 1e-9)
        self._aside = None
        found: list[Any] = []
        question = Question(data, fits, lambda answer, _asked_ns, _arrival_ns: found.append(answer))
        self._told.append(question)
        wait_until(lambda: bool(found), self._link, timeout_s, self._feed)
        if question in self._told:
            self._told.remove(question)
        return found[0] if found else None

    def _wait_for(self, arrived: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
        if not wait_until(arrived, self._link, timeout_s, self._feed):
            raise self._late(timeout_s, otherwise)

    def _late(self, timeout_s: float, otherwise: str) -> DeviceTimeoutError:
        return DeviceTimeoutError(f"{self._place}: {otherwise} ({timeout_s:g} s waited)")

    def _cannot(self, value: float) -> DeviceError:
        return DeviceError(f"{self._place}: cannot command {value} {self.command_unit}")

    def _feed(self) -> None:
        """Called while an answer is waited for: a drive that is armed wants commands. Does nothing where none is."""

    def _feed_now_and_then(self) -> None:
        now_ns = self._link.clock.now_ns()
        if now_ns - self._fed_ns >= _FEED_INTERVAL_NS:
            self._fed_ns = now_ns
            self.command(0.0)

    def _send_command(self, data: bytes) -> None:
        """A command, and behind it what is due now and then. Raises ConnectionFailedError."""
        self._line.send_newest(data)
        now_ns = self._commanded_ns = self._link.clock.now_ns()
        lost = self._aside is not None and now_ns - self._aside_ns >= self._timeout_ns
        if self._told or self._line.is_behind or not (self._aside is None or lost):
            return
        self._aside, self._aside_ns = self._next_aside(), now_ns
        if self._aside is not None:
            self._line.send(self._aside.data)

    def _ask(self) -> None:
        self._asked = self._told[0] if self._told else self._due_aside() or self._next_question()
        self._line.send(self._asked.data)

    def _due_aside(self) -> Question | None:
        """Where no commands are sent that it could go behind."""
        idle = self._link.clock.now_ns() - self._commanded_ns >= _UNCOMMANDED_NS
        return self._next_aside() if idle else None

    def _on_bytes(self, data: bytes, arrival_ns: int) -> None:
        for answer, later_bytes in self._answers_in(data):
            self._on_answer(answer, self._stamps.complete_ns(arrival_ns, later_bytes))

    def _on_answer(self, answer: Any, arrival_ns: int) -> None:
        asked, aside = self._asked, self._aside
        if asked is None or not asked.fits(answer):
            if aside is not None and aside.fits(answer):
                self._aside = None
                aside.take(answer, self._aside_ns, arrival_ns)
            else:
                self.strangers += 1
            return
        self._asked = None
        if self._told and self._told[0] is asked:
            self._told.popleft()
        asked_ns = self.questions.answered(arrival_ns)
        if asked_ns is not None:
            asked.take(answer, asked_ns, arrival_ns)

    def _send_last(self, *messages: bytes) -> None:
        """Each at once, whatever became of the other; never raises."""
        self._line.drop()
        self._aside = None
        for data in messages:
            with suppress(ConnectionFailedError):
                self._line.send(data)
