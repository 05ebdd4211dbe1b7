"""Everything that crosses the wires while a rig is looked at, by identifier and by serial port."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import can

from drivers.readings import RawFrame

# Of one identifier: enough to see a rhythm, and no more than some seconds of the fastest stream.
_KEPT = 5000
# An answer comes within this time after its question, or is none.
_ANSWER_NS = 100_000_000
_SERIAL = -1  # the identifier of what is no CAN frame


@dataclass
class HeardId:
    """What came under one identifier: ``arrivals_ns`` of the frames, and the last of them."""

    last: RawFrame
    count: int = 0
    arrivals_ns: list[int] = field(default_factory=list)

    def message(self) -> can.Message:
        """The last one, as a driver would see it."""
        frame = self.last
        return can.Message(
            arbitration_id=frame.arbitration_id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            data=None if frame.remote else frame.data,
            dlc=len(frame.data),
        )

    @property
    def name(self) -> str:
        """As a person writes it."""
        return f"0x{self.last.arbitration_id:08X}" if self.last.extended else f"0x{self.last.arbitration_id:03X}"


Key = tuple[int, bool]  # identifier, and whether it is an extended one


@dataclass
class BusSurvey:
    """One bus. Questions are remote frames, whose answers carry the same identifier."""

    heard: dict[Key, HeardId] = field(default_factory=dict)
    bits: int = 0
    frames: int = 0  # heard, not sent
    asked_ns: dict[Key, list[int]] = field(default_factory=lambda: defaultdict(list))

    def note(self, frame: RawFrame) -> None:
        key = (frame.arbitration_id, frame.extended)
        self.bits += bits_of(frame)
        if frame.sent:
            if frame.remote:
                self.asked_ns[key].append(frame.stamp_ns)
            return
        self.frames += 1
        heard = self.heard.setdefault(key, HeardId(frame))
        heard.last = frame
        heard.count += 1
        if len(heard.arrivals_ns) < _KEPT:
            heard.arrivals_ns.append(frame.stamp_ns)

    def answers_ns(self) -> Iterator[tuple[Key, int, list[int]]]:
        """For each question: its identifier, when it was asked, and how long each of its answers took."""
        for key, asked in self.asked_ns.items():
            arrivals = self.heard[key].arrivals_ns if key in self.heard else []
            for at_ns in asked:
                yield key, at_ns, [stamp - at_ns for stamp in arrivals if 0 <= stamp - at_ns < _ANSWER_NS]


@dataclass
class Survey:
    """All buses and ports; :meth:`note` is the link's tap."""

    buses: dict[str, BusSurvey] = field(default_factory=lambda: defaultdict(BusSurvey))
    bytes_heard: dict[str, int] = field(default_factory=lambda: defaultdict(int))

    def note(self, frame: RawFrame) -> None:
        if frame.arbitration_id != _SERIAL:
            self.buses[frame.channel].note(frame)
        elif not frame.sent:
            self.bytes_heard[frame.channel] += len(frame.data)


def bits_of(frame: RawFrame) -> int:
    """About how many bits a classic frame takes on the bus, with a typical share of stuff bits and the gap after it.

    Source: ISO 11898-1: 47 bits about the data of a standard frame, 67 of an extended one, 3 of them the gap; of those
    before the CRC's end, at most every fifth is stuffed, in practice about one in twenty.
    """
    plain = (67 if frame.extended else 47) + 8 * (0 if frame.remote else len(frame.data))
    return round(plain * 1.05)
