"""Devices during a check: opened, identified, and watched while nothing moves."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from statistics import pstdev
from typing import Any, cast

from norton_bench.check.buses import claims_on, in_words, senders_on
from norton_bench.check.survey import BusCheck, BusSurvey, Problem, Sender, StreamCheck, Survey
from norton_bench.errors import ExperimentError
from norton_bench.records import STREAMS, Stream
from norton_bench.rig.driver_options import declared_by
from norton_bench.rig.files import keys_of
from norton_bench.rig.rig import Rig
from norton_drivers.devices import Amplifier
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.ports import Backend
from norton_drivers.readings import (
    DeviceIdentity,
    DriveState,
    DriveStatus,
    TorqueReading,
)
from norton_drivers.registry import AMPLIFIERS, Question, Recognition, group_of, open_device
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
    result, begun_ns = Watched(settings), link.clock.now_ns()
    try:
        device = open_device(settings, link)
        result.streams = {_name(each): each for each in STREAMS if each.role == settings.role}
        result.takes = {name: getattr(device, each.kind.take) for name, each in result.streams.items()}
        if group_of(settings.role) == AMPLIFIERS:
            drive = cast(Amplifier, device)
            result.status, result.command_unit = drive.status, drive.command_unit
        link.set_tap(survey.note)
        result.identity = device.identify()
    except DeviceError as error:
        result.problems.append(error)
    result.asked_ns = (begun_ns, link.clock.now_ns())
    return result


def watch(watched: Sequence[Watched], link: Link, watch_s: float, tick_ns: int) -> Problem | None:
    """Listen for ``watch_s``, as often as the loop will; returns what ended it early: a bus or port that was lost."""
    for each in watched:
        for take in each.takes.values():
            take()  # what came while the others were asked is no sign of a steady rate
    deadline_ns = link.clock.now_ns()
    end_ns = deadline_ns + round(watch_s * 1e9)
    try:
        link.ask_adapters()
        while (now_ns := link.clock.now_ns()) < end_ns:
            deadline_ns = max(deadline_ns + tick_ns, now_ns)
            link.wait(deadline_ns - now_ns)
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


# How steadily readings came, and what is wrong with that.
def streams_of(each: Watched, watch_s: float) -> tuple[StreamCheck, ...]:
    """One figure for each stream that the device has."""
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


_NAMED = 6  # of what nobody knows, no more are named than this


# A device that does not answer: why, as far as what is heard can tell, and where it is instead.
def explain_silence(
    settings: DeviceSettings, error: DeviceTimeoutError, bus: BusCheck, rates: str
) -> DeviceTimeoutError:
    """Why a device on a bus does not answer, as far as what is heard there can tell.

    ``error`` in better words; itself where the device is heard, so that something else is amiss.
    """
    if any(sender.role == settings.role for sender in bus.senders):
        return error
    place = f"[{settings.role}] {settings.driver} on bus {bus.name}"
    if bus.frames == 0:
        return DeviceTimeoutError(f"{place}: {_nothing_heard(bus, rates)}")
    strangers = [sender for sender in bus.senders if sender.role is None]
    own_kind = [sender for sender in strangers if sender.driver == settings.driver]
    if own_kind:
        return DeviceTimeoutError(f"{place}: {_elsewhere(settings, own_kind)}")
    if strangers:
        return DeviceTimeoutError(f"{place}: nobody is heard; {_other_kind(strangers)}")
    return DeviceTimeoutError(f"{place}: does not answer; {_who_is_heard(bus, rates)}")


def _nothing_heard(bus: BusCheck, rates: str) -> str:
    if bus.troubles:
        return (
            f"not one frame is heard, but errors are ({_troubles(bus)}): bitrate = {rates} is probably "
            "not the devices', or wiring or termination is wrong"
        )
    return f"not one frame is heard: check power, cable and termination, and that its bitrate is {rates}"


def _troubles(bus: BusCheck) -> str:
    return ", ".join(f"{what} {count} times" for what, count in bus.troubles.items())


def _elsewhere(settings: DeviceSettings, result: Sequence[Sender]) -> str:
    """Its kind is heard, at another address."""
    wanted = {name: settings.options[name] for name in result[0].options if name in settings.options}
    received = " and ".join(f"{sender.device} at {in_words(sender.options)} ({sender.says[0]})" for sender in result)
    which = f"set {in_words(result[0].options)}" if len(result) == 1 else "set the one that is meant"
    if not wanted:
        return f"nobody is heard, but {received}: {which}"
    return f"nobody is heard at {in_words(wanted)}, but {received}: {which}, or give the device {in_words(wanted)}"


def _other_kind(result: Sequence[Sender]) -> str:
    received = " and ".join(
        f'{sender.device} (driver = "{sender.driver}"{", " if sender.options else ""}{in_words(sender.options)})'
        for sender in result
    )
    return f"heard instead: {received}; is driver right, is the device powered?"


def _who_is_heard(bus: BusCheck, rates: str) -> str:
    known = " and ".join(f"[{sender.role}]" for sender in bus.senders if sender.role is not None)
    if bus.strangers:
        names = ", ".join(bus.strangers[:_NAMED]) + (", ..." if len(bus.strangers) > _NAMED else "")
        return f"frames are heard that no driver knows ({names}): is it a device of this kind, with this address?"
    if bus.troubles:
        return f"only {known} can be heard, and errors ({_troubles(bus)}): is it set to {rates}, and its cable sound?"
    return f"only {known} can be heard: is it powered, and on this bus?"


# The last one asked may take its time.
_ANSWER_NS = 50_000_000


def ask_everybody(
    watched: Sequence[Watched], link: Link, survey: Survey, recognition: Mapping[str, Recognition]
) -> None:
    """Devices that speak only when spoken to, at an address that the rig file does not know, or of another kind: found
    by asking everybody.

    Where a device did not answer, put its kind's questions to every address on its bus; where nobody answers these,
    those of the other kinds. Nothing moves.
    """
    devices = [each.settings for each in watched]
    absent = {(each.settings.bus, each.settings.driver): each for each in watched if _is_absent(each)}
    for (bus, driver), each in absent.items():
        if bus is None or bus not in link.can_ports:
            continue
        own = recognition.get(driver, Recognition()).probes
        others = {offered.probes for offered in recognition.values()} - {own, None}
        with suppress(DeviceError):  # a lost bus has been told
            if own is not None:
                _put(own(each.settings.options, survey.buses[bus].standard_ids()), bus, link)
            for probes in sorted(filter(None, others), key=lambda probes: probes.__module__):
                if not _is_alone(survey.buses[bus], recognition, devices):
                    break
                _put(probes({}, survey.buses[bus].standard_ids()), bus, link)


def _put(questions: Iterable[Question], bus: str, link: Link) -> None:
    for question in questions:
        link.can_ports[bus].send(question.arbitration_id, question.data, extended=question.extended)
        link.wait(POLL_NS)
    link.wait(_ANSWER_NS)


def _is_alone(survey: BusSurvey, recognition: Mapping[str, Recognition], devices: Sequence[DeviceSettings]) -> bool:
    """Whether nobody is heard but the rig's devices."""
    return all(sender.role for sender in senders_on(survey, claims_on(survey, recognition, devices)))


def _is_absent(each: Watched) -> bool:
    return each.identity is None and any(isinstance(problem, DeviceTimeoutError) for problem in each.problems)


OPTION = "baud"
# The usual ones, the likeliest first.
BAUDS = (115_200, 460_800, 9_600, 921_600, 57_600, 38_400, 19_200, 230_400, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
_TRY_S = 0.3


def explain_noise(
    settings: DeviceSettings, error: DeviceTimeoutError, bytes_heard: int, backend: Backend
) -> DeviceTimeoutError:
    """A serial device that speaks at another baud rate than the rig file says: found by trying the others.

    ``error`` in better words, where bytes came of which the driver could make nothing; itself where none came.
    """
    if not bytes_heard:
        return error
    place, used = f"[{settings.role}] {settings.driver} on {settings.port}", baud_of(settings)
    if used is None:
        return DeviceTimeoutError(f"{place}: {bytes_heard} bytes came, but nothing that is its; is driver right?")
    result = next((baud for baud in BAUDS if baud != used and _speaks(settings, baud, backend)), None)
    if result is None:
        return DeviceTimeoutError(
            f"{place}: {bytes_heard} bytes came, but nothing that is its, neither at {used} baud nor at the other "
            "usual ones; is driver right, is the device set to stream?"
        )
    return DeviceTimeoutError(f"{place}: it speaks at {result} baud, not at {used}: set {OPTION} = {result}")


def baud_of(settings: DeviceSettings) -> int | None:
    """What the rig file says, else the driver's default; None for a driver that has no such option."""
    group = group_of(settings.role)
    model = declared_by(group, settings.driver).model
    info = keys_of(model).get(OPTION) if model is not None else None
    return None if info is None else int(settings.options.get(OPTION, info.default))


def _speaks(settings: DeviceSettings, baud: int, backend: Backend) -> bool:
    """Whether the driver understands the device at this rate. A port that refuses the rate does not."""
    link = Link(backend, ())
    tried = replace(settings, options={**settings.options, OPTION: baud})
    try:
        open_device(tried, link).identify(_TRY_S)
    except DeviceError:
        return False
    finally:
        link.close()
    return True
