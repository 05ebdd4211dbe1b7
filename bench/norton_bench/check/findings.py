"""What a look at a rig has found: plain data, for the command line to show."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from norton_bench.errors import BenchError
from norton_drivers.errors import DeviceError
from norton_drivers.readings import DeviceIdentity, DriveStatus

Problem = BenchError | DeviceError


@dataclass(frozen=True)
class StreamCheck:
    """One stream of readings over the time it was watched.

    ``jitter_s`` is the standard deviation of the time between arrivals, ``age_s`` the mean age of the newest reading
    when the loop would look, and ``longest_gap_s`` the longest silence.
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
    load: float  # share of the bitrate, estimated from the frames' lengths
    senders: tuple[Sender, ...] = ()
    strangers: tuple[str, ...] = ()  # identifiers that no driver knows
    troubles: Mapping[str, int] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


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
    host: HostCheck | None = None
    moved: tuple[str, ...] = ()  # what was found when the shaft was moved
    whole: tuple[Problem, ...] = ()  # of no single device or bus
    remarks: tuple[str, ...] = ()

    def problems(self) -> tuple[Problem, ...]:
        """Everything that is wrong, each told once."""
        found = [
            *(problem for bus in self.buses for problem in bus.problems),
            *(problem for device in self.devices for problem in device.problems),
            *self.whole,
        ]
        return tuple({str(problem): problem for problem in found}.values())
