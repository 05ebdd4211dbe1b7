"""Everything that passes on the wires while a rig is checked, by identifier and by serial port."""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import can

from norton_bench.errors import BenchError
from norton_drivers.errors import DeviceError
from norton_drivers.readings import ERROR_FRAME, DeviceIdentity, DriveStatus, RawFrame
from norton_drivers.registry import Answers

Problem = BenchError | DeviceError


# What a look at a rig has found: plain data, for the command line to show.
@dataclass(frozen=True)
class StreamCheck:
    """One stream of readings over the time it was watched.

    ``jitter_s`` is the standard deviation of the time between arrivals, ``age_s`` the mean age of the newest
    reading when the loop would look, and ``longest_gap_s`` the longest silence.
    """

    name: str
    readings: int
    rate_hz: float
    jitter_s: float
    age_s: float
    longest_gap_s: float


@dataclass(frozen=True)
class DeviceCheck:
    """One device: what it says it is, how quickly it answers, what it sends, and what is wrong with it."""

    role: str
    driver: str
    identity: DeviceIdentity | None
    status: DriveStatus | None
    streams: tuple[StreamCheck, ...]
    problems: tuple[Problem, ...]
    answer_s: float | None = None  # from a question to its answer, the median; None where none was seen


@dataclass(frozen=True)
class Sender:
    """Somebody heard on a bus: by which driver it would be spoken to, with which options, and what it sends."""

    driver: str
    device: str
    options: Mapping[str, Any]
    says: tuple[str, ...]
    frames: int
    role: str | None = None  # of the rig's device that this is


@dataclass(frozen=True)
class BusCheck:
    """One bus: how busy it is, who is heard, what went wrong on it."""

    name: str
    interface: str
    channel: str
    frames: int
    rate_hz: float
    load: float  # share of the time, estimated from the frames' lengths and the bit rates
    senders: tuple[Sender, ...] = ()
    strangers: tuple[str, ...] = ()  # identifiers that no driver knows
    troubles: Mapping[str, int] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()
    overfull: Problem | None = None  # that of the problems which no device is to blame for: the bus cannot carry them


@dataclass(frozen=True)
class LineCheck:
    """The serial line of one drive: how busy the rig's loop makes it, and how often it lets the drive be read.

    ``answer_s`` is the median time from a question to the first bytes after it; None where none was seen.
    """

    role: str
    port: str
    baud: int  # 0 for a USB port of the drive's own
    share_there: float  # of what it carries, at the rig's rate
    share_back: float
    greatest_rate_hz: float  # of a loop with a reading in every tick, as far as the line goes
    answer_s: float | None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class HostCheck:
    """This computer: whether the loop may run in real time, and how late it wakes up [s]."""

    real_time: bool
    late_median_s: float
    late_99_s: float
    late_most_s: float


@dataclass(frozen=True)
class RigCheck:
    """All of it. ``remarks`` are worth knowing, but keep nothing from working."""

    devices: tuple[DeviceCheck, ...]
    buses: tuple[BusCheck, ...] = ()
    lines: tuple[LineCheck, ...] = ()
    host: HostCheck | None = None
    moved: tuple[str, ...] = ()  # what was found when the shaft was moved
    whole: tuple[Problem, ...] = ()  # of no single device or bus
    remarks: tuple[str, ...] = ()

    def problems(self) -> tuple[Problem, ...]:
        """Everything that is wrong, each told once."""
        result = [
            *(problem for bus in self.buses for problem in bus.problems),
            *(problem for device in self.devices for problem in device.problems),
            *self.whole,
        ]
        return tuple({str(problem): problem for problem in result}.values())

    def overfull(self) -> tuple[Problem, ...]:
        """Those of the buses that cannot carry what their devices send."""
        return tuple(bus.overfull for bus in self.buses if bus.overfull is not None)


# Of one identifier: enough to see a rhythm, and no more than some seconds of the fastest stream.
_KEPT = 5000
_KINDS = 16  # of one identifier
# An answer comes within this time after its question, or is none.
_ANSWER_NS = 100_000_000
_QUESTIONS = 500
_LOGGED = 30_000
STUFFED = 1.05  # with stuff bits, a typical share
_SERIAL = -1  # the identifier of what is no CAN frame


@dataclass
class HeardId:
    """Everything that crosses the wires while a rig is looked at, by identifier and by serial port.

    What came under one identifier: when each frame came and with which byte it began, and the last of each kind.

    Frames that begin differently are of different kinds: several devices may answer under one identifier.
    """

    extended: bool
    arbitration_id: int
    count: int = 0
    arrivals_ns: list[int] = field(default_factory=list)
    begun: list[bytes] = field(default_factory=list)  # the first byte of each, beside its arrival
    samples: dict[bytes, RawFrame] = field(default_factory=dict)
    counts: dict[bytes, int] = field(default_factory=dict)

    def note(self, frame: RawFrame) -> None:
        self.count += 1
        begins = frame.data[:1]
        if len(self.arrivals_ns) < _KEPT:
            self.arrivals_ns.append(frame.stamp_ns)
            self.begun.append(begins)
        if begins in self.samples or len(self.samples) < _KINDS:
            self.samples[begins] = frame
            self.counts[begins] = self.counts.get(begins, 0) + 1

    @property
    def name(self) -> str:
        """As a person writes it."""
        return f"0x{self.arbitration_id:08X}" if self.extended else f"0x{self.arbitration_id:03X}"


def message_of(frame: RawFrame) -> can.Message:
    """A frame as a driver sees it."""
    return can.Message(
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        data=None if frame.remote else frame.data,
        dlc=len(frame.data),
        is_fd=frame.fd,
        bitrate_switch=frame.switched,
    )


Key = tuple[int, bool]  # identifier, and whether it is an extended one


@dataclass
class BusSurvey:
    """One bus: what was heard by identifier, and everything that passed, both ways, in order."""

    heard: dict[Key, HeardId] = field(default_factory=dict)
    bits: int = 0
    data_bits: int = 0  # those at the second bit rate of a CAN FD bus
    frames: int = 0  # heard, not sent
    log: deque[RawFrame] = field(default_factory=lambda: deque(maxlen=_LOGGED))

    def note(self, frame: RawFrame) -> None:
        bits, data_bits = bits_of(frame)
        self.bits += bits
        self.data_bits += data_bits
        self.log.append(frame)
        if not frame.sent:
            self.frames += 1
            key = (frame.arbitration_id, frame.extended)
            self.heard.setdefault(key, HeardId(frame.extended, frame.arbitration_id)).note(frame)

    def standard_ids(self) -> set[int]:
        """The 11-bit identifiers heard."""
        return {identifier for identifier, extended in self.heard if not extended}

    def answered(self, answers: Sequence[Answers]) -> Iterator[tuple[RawFrame, list[RawFrame]]]:
        """For each question that has any: its answers, until something is asked under its identifier again."""
        log, questions = list(self.log), 0
        for place, question in enumerate(log):
            if question.sent and questions < _QUESTIONS:
                result = list(_answers_to(question, islice(log, place + 1, None), answers))
                questions += 1
                if result:
                    yield question, result


def _answers_to(question: RawFrame, after: Iterable[RawFrame], answers: Sequence[Answers]) -> Iterator[RawFrame]:
    for frame in after:
        if frame.stamp_ns - question.stamp_ns > _ANSWER_NS:
            return
        if frame.sent:
            if (frame.arbitration_id, frame.extended) == (question.arbitration_id, question.extended):
                return
        elif any(is_answer(question, frame) for is_answer in answers):
            yield frame


@dataclass
class LineSurvey:
    """One serial line: how many bytes came, and how long each question waited for the first of them [s]."""

    bytes_heard: int = 0
    delays_s: deque[float] = field(default_factory=lambda: deque(maxlen=_QUESTIONS))
    _asked_ns: int | None = None

    def note(self, frame: RawFrame) -> None:
        if frame.sent:
            self._asked_ns = frame.stamp_ns
            return
        self.bytes_heard += len(frame.data)
        if self._asked_ns is not None:
            self.delays_s.append((frame.stamp_ns - self._asked_ns) * 1e-9)
            self._asked_ns = None


@dataclass
class Survey:
    """All buses and ports; :meth:`note` is the link's tap."""

    buses: dict[str, BusSurvey] = field(default_factory=lambda: defaultdict(BusSurvey))
    lines: dict[str, LineSurvey] = field(default_factory=lambda: defaultdict(LineSurvey))

    def note(self, frame: RawFrame) -> None:
        if frame.arbitration_id == _SERIAL:
            self.lines[frame.channel].note(frame)
        elif not frame.arbitration_id & ERROR_FRAME:  # those are counted by the port
            self.buses[frame.channel].note(frame)


def bits_of(frame: RawFrame) -> tuple[int, int]:
    """About how many bits a frame takes on the bus, with a typical share of stuff bits and the gap after it: at the
    bus's first bit rate, and at the second.

    Source: ISO 11898-1:2015, 10.4. Classical: 47 bits about the data of a standard frame, 67 of an extended one, 3 of
    them the gap; of those before the CRC's end, at most every fifth is stuffed, in practice about one in twenty. CAN
    FD: 17 or 36 bits until the rate is switched and 12 after it is switched back; between them, beside the data, 10
    bits, a CRC of 17 or 21 and every fifth bit of it and its count stuffed.
    """
    data_bits = 8 * (0 if frame.remote else len(frame.data))
    if not frame.fd:
        return round(((67 if frame.extended else 47) + data_bits) * STUFFED), 0
    first = round((36 if frame.extended else 17) * STUFFED) + 12
    second = round((5 + data_bits) * STUFFED) + (28 if len(frame.data) <= 16 else 33)
    return (first, second) if frame.switched else (first + second, 0)
