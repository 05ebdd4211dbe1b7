"""Devices while they are looked at: opened, asked who they are, and listened to with nothing moving."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from norton_bench.check.findings import Problem
from norton_bench.check.survey import Survey
from norton_drivers.errors import DeviceError
from norton_drivers.link import Link
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveStatus, MotionReading, TorqueReading
from norton_drivers.registry import open_amplifier, open_torque_sensor
from norton_drivers.wiring import DeviceSettings

POLL_NS = 1_000_000

Reading = MotionReading | CurrentReading | TorqueReading


@dataclass
class Watched:
    """A device while it is looked at: how its readings are taken, by stream, and what came."""

    settings: DeviceSettings
    identity: DeviceIdentity | None = None
    status: Callable[[], DriveStatus] | None = None
    takes: Mapping[str, Callable[[], Sequence[Reading]]] = field(default_factory=dict)
    readings: dict[str, list[Reading]] = field(default_factory=dict)
    ages_ns: dict[str, list[int]] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    asked_ns: tuple[int, int] = (0, 0)  # when it was being asked who it is
    command_unit: str | None = None  # of an open drive's commands

    def values(self, stream: str) -> list[float]:
        """The stream's readings as one number each: position, torque or current."""
        return [_value(reading) for reading in self.readings.get(stream, ())]


def open_watched(settings: DeviceSettings, link: Link, survey: Survey) -> Watched:
    """Open a device and ask who it is; what goes wrong is kept as its problem."""
    found, begun_ns = Watched(settings), link.clock.now_ns()
    try:
        if settings.role == "torque_sensor":
            sensor = open_torque_sensor(settings, link)
            found.takes = {"torque": sensor.take_torque}
            link.set_tap(survey.note)
            found.identity = sensor.identify()
        else:
            drive = open_amplifier(settings, link)
            found.takes = {"motion": drive.take_motion, "current": drive.take_current}
            found.status, found.command_unit = drive.status, drive.command_unit
            link.set_tap(survey.note)
            found.identity = drive.identify()
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


def _value(reading: Reading) -> float:
    if isinstance(reading, MotionReading):
        return reading.position_rad
    return reading.torque_nm if isinstance(reading, TorqueReading) else reading.current_a
