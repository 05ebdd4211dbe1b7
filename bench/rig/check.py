"""A look at a rig with nothing moving: who is there, how fast and how evenly each device speaks, what is wrong."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import pstdev

from bench.errors import BenchError, ExperimentError
from bench.rig.rig import Rig
from drivers.backend import Backend
from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.link import Link
from drivers.readings import CurrentReading, DeviceIdentity, DriveState, DriveStatus, MotionReading, TorqueReading
from drivers.registry import load_backend, open_amplifier, open_torque_sensor
from drivers.wiring import DeviceSettings

WATCH_S = 1.0
POLL_NS = 1_000_000


Reading = MotionReading | CurrentReading | TorqueReading
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
    """One device: what it says it is, what it sends, and what is wrong with it."""

    role: str
    driver: str
    identity: DeviceIdentity | None
    status: DriveStatus | None
    streams: tuple[StreamCheck, ...]
    problems: tuple[Problem, ...]


@dataclass
class _Watched:
    """A device while it is looked at: how its readings are taken, by stream, and when they arrived."""

    settings: DeviceSettings
    identity: DeviceIdentity | None = None
    status: Callable[[], DriveStatus] | None = None
    takes: Mapping[str, Callable[[], Sequence[Reading]]] = field(default_factory=dict)
    arrivals: dict[str, list[int]] = field(default_factory=dict)
    ages_ns: dict[str, list[int]] = field(default_factory=dict)
    invalid: int = 0
    problems: list[Problem] = field(default_factory=list)


def check_rig(rig: Rig, *, seed: int | None = None, watch_s: float = WATCH_S) -> tuple[DeviceCheck, ...]:
    """Open and watch every device of the rig. Raises DeviceError where the backend itself cannot be opened."""
    with ExitStack() as stack:
        backend: Backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place)
        stack.callback(backend.close)
        link = Link(backend, rig.wiring.buses)
        stack.callback(link.close)
        watched = [_open(settings, link) for settings in rig.wiring.devices()]
        _watch(watched, link, watch_s)
    return tuple(_judge(each, rig, watch_s) for each in watched)


def _open(settings: DeviceSettings, link: Link) -> _Watched:
    found = _Watched(settings)
    try:
        if settings.role == "torque_sensor":
            sensor = open_torque_sensor(settings, link)
            found.takes = {"torque": sensor.take_torque}
            found.identity = sensor.identify()
        else:
            drive = open_amplifier(settings, link)
            found.takes = {"motion": drive.take_motion, "current": drive.take_current}
            found.status = drive.status
            found.identity = drive.identify()
    except DeviceError as error:
        found.problems.append(error)
    return found


def _watch(watched: Sequence[_Watched], link: Link, watch_s: float) -> None:
    for each in watched:
        for take in each.takes.values():
            take()  # what came while the others were asked is no sign of a steady rate
    end_ns = link.clock.now_ns() + round(watch_s * 1e9)
    while link.clock.now_ns() < end_ns:
        link.wait(POLL_NS)
        for each in watched:
            for name, take in each.takes.items():
                _note(each, name, take(), link.clock.now_ns())


def _note(each: _Watched, name: str, readings: Sequence[Reading], now_ns: int) -> None:
    arrivals = each.arrivals.setdefault(name, [])
    arrivals.extend(reading.arrival_ns for reading in readings)
    each.invalid += sum(isinstance(reading, TorqueReading) and not reading.valid for reading in readings)
    if arrivals:
        each.ages_ns.setdefault(name, []).append(now_ns - arrivals[-1])


def _judge(each: _Watched, rig: Rig, watch_s: float) -> DeviceCheck:
    streams = tuple(
        _stream(name, stamps, each.ages_ns.get(name, []), watch_s) for name, stamps in each.arrivals.items()
    )
    status = each.status() if each.status is not None else None
    problems = list(each.problems)
    if each.identity is not None:
        problems += _stream_problems(each, streams, rig)
        problems += _status_problems(each.settings.role, status)
    return DeviceCheck(each.settings.role, each.settings.driver, each.identity, status, streams, tuple(problems))


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


def _stream_problems(each: _Watched, streams: Sequence[StreamCheck], rig: Rig) -> list[Problem]:
    role, problems = each.settings.role, list[Problem]()
    stale_s = rig.limits.stale_after_ns * 1e-9
    for stream in streams:
        needed = stream.name != "current"
        if needed and stream.readings == 0:
            text = f"[{role}] sends no {stream.name} readings; switch on its cyclic messages, check power and cable"
            problems.append(DeviceTimeoutError(text))
        elif needed and stream.longest_gap_s > stale_s:
            problems.append(
                ExperimentError(
                    f"[{role}] {stream.name} readings come at {stream.rate_hz:.0f} Hz with gaps of up to "
                    f"{stream.longest_gap_s * 1e3:.1f} ms, beyond stale_after = {stale_s * 1e3:g} ms: "
                    "let the device send more often, or raise [limits] stale_after"
                )
            )
    if each.invalid:
        problems.append(
            ExperimentError(
                f"[{role}] marks {each.invalid} of its readings as invalid; check it for overload or faults"
            )
        )
    return problems


def _status_problems(role: str, status: DriveStatus | None) -> list[Problem]:
    if status is None or status.state is not DriveState.FAULT:
        return []
    words = ", ".join(status.errors) or "no reason given"
    return [ExperimentError(f"[{role}] drive is in fault: {words}; mend the cause, it is cleared on enabling")]
