"""Devices while they are looked at: opened, asked who they are, and listened to with nothing moving."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import pstdev
from typing import Any, cast

from norton_bench.check.findings import Problem, StreamCheck
from norton_bench.check.survey import Survey
from norton_bench.errors import ExperimentError
from norton_bench.records import STREAMS, Stream
from norton_bench.rig.rig import Rig
from norton_drivers.devices import Amplifier
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.readings import DeviceIdentity, DriveState, DriveStatus, TorqueReading
from norton_drivers.registry import AMPLIFIERS, group_of, open_device
from norton_drivers.wiring import DeviceSettings

POLL_NS = 1_000_000


@dataclass
class Watched:
    """A device while it is looked at: how its readings are taken, by stream, and what came."""

    settings: DeviceSettings
    identity: DeviceIdentity | None = None
    status: Callable[[], DriveStatus] | None = None
    streams: Mapping[str, Stream] = field(default_factory=dict)
    takes: Mapping[str, Callable[[], Sequence[Any]]] = field(default_factory=dict)
    readings: dict[str, list[Any]] = field(default_factory=dict)
    ages_ns: dict[str, list[int]] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    asked_ns: tuple[int, int] = (0, 0)  # when it was being asked who it is
    command_unit: str | None = None  # of an open drive's commands

    def values(self, stream: str) -> list[float]:
        """The stream's readings as one number each, such as the position, torque or current."""
        column = self.streams[stream].kind.quantities[0].column
        return [getattr(reading, column) for reading in self.readings.get(stream, ())]


def open_watched(settings: DeviceSettings, link: Link, survey: Survey) -> Watched:
    """Open a device and ask who it is; what goes wrong is kept as its problem."""
    found, begun_ns = Watched(settings), link.clock.now_ns()
    try:
        device = open_device(settings, link)
        found.streams = {_name(each): each for each in STREAMS if each.role == settings.role}
        found.takes = {name: getattr(device, each.kind.take) for name, each in found.streams.items()}
        if group_of(settings.role) == AMPLIFIERS:
            drive = cast(Amplifier, device)
            found.status, found.command_unit = drive.status, drive.command_unit
        link.set_tap(survey.note)
        found.identity = device.identify()
    except DeviceError as error:
        found.problems.append(error)
    found.asked_ns = (begun_ns, link.clock.now_ns())
    return found


def watch(watched: Sequence[Watched], link: Link, watch_s: float) -> Problem | None:
    """Listen for ``watch_s``; returns what ended it early: a bus or port that was lost."""
    for each in watched:
        for take in each.takes.values():
            take()  # what came while the others were asked is no sign of a steady rate
    end_ns = link.clock.now_ns() + round(watch_s * 1e9)
    try:
        link.ask_adapters()
        while link.clock.now_ns() < end_ns:
            link.wait(POLL_NS)
            for each in watched:
                _take(each, link.clock.now_ns())
    except DeviceError as error:
        return error
    return None


def _take(each: Watched, now_ns: int) -> None:
    for name, take in each.takes.items():
        readings = each.readings.setdefault(name, [])
        readings.extend(take())
        if readings:
            each.ages_ns.setdefault(name, []).append(now_ns - readings[-1].arrival_ns)


def _name(stream: Stream) -> str:
    """What a check calls it, the device being named beside: "motion", "current"."""
    return stream.kind.message.lower()


def streams_of(each: Watched, watch_s: float) -> tuple[StreamCheck, ...]:
    """How steadily readings came, and what is wrong with that.

    One figure for each stream that the device has.
    """
    return tuple(
        _stream(name, [reading.arrival_ns for reading in readings], each.ages_ns.get(name, []), watch_s)
        for name, readings in each.readings.items()
    )


def _stream(name: str, stamps: Sequence[int], ages_ns: Sequence[int], watch_s: float) -> StreamCheck:
    gaps = [(later - earlier) * 1e-9 for earlier, later in pairwise(stamps)]
    return StreamCheck(
        name,
        len(stamps),
        len(gaps) / sum(gaps) if sum(gaps) > 0 else len(stamps) / watch_s,
        pstdev(gaps) if gaps else 0.0,
        sum(ages_ns) / len(ages_ns) * 1e-9 if ages_ns else 0.0,
        max(gaps, default=watch_s),
    )


def stream_problems(each: Watched, streams: Sequence[StreamCheck], rig: Rig) -> Iterator[Problem]:
    """Streams that are missing, too slow for the guard, or invalid by their own word."""
    role, stale_s = each.settings.role, rig.limits.stale_after_ns * 1e-9
    for stream in streams:
        needed = each.streams[stream.name].required
        if needed and stream.readings == 0:
            yield DeviceTimeoutError(
                f"[{role}] sends no {stream.name} readings; switch on its cyclic messages, check power and cable"
            )
        elif needed and stream.longest_gap_s > stale_s:
            yield ExperimentError(
                f"[{role}] {stream.name} readings come at {stream.rate_hz:.0f} Hz with gaps of up to "
                f"{stream.longest_gap_s * 1e3:.1f} ms, beyond stale_after = {stale_s * 1e3:g} ms: "
                "let the device send more often, or raise [limits] stale_after"
            )
    invalid = sum(isinstance(r, TorqueReading) and not r.valid for r in each.readings.get("torque", ()))
    if invalid:
        yield ExperimentError(f"[{role}] marks {invalid} of its readings as invalid; check it for overload or faults")


def status_problems(role: str, status: DriveStatus | None) -> Iterator[Problem]:
    """A drive that is in fault."""
    if status is not None and status.state is DriveState.FAULT:
        words = ", ".join(status.errors) or "no reason given"
        yield ExperimentError(f"[{role}] drive is in fault: {words}; mend the cause, it is cleared on enabling")
