"""A look at a rig with nothing moving: who is there, how fast and how evenly each device speaks, what is wrong."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from statistics import median

from bench.check.absent import explain_silence
from bench.check.baud import explain_noise
from bench.check.buses import check_bus, remarks_on
from bench.check.doubles import contradictory
from bench.check.findings import BusCheck, DeviceCheck, Problem, RigCheck
from bench.check.host import host_remarks, look_at_host
from bench.check.streams import status_problems, stream_problems, streams_of
from bench.check.survey import Survey
from bench.check.watch import Watched, open_watched, watch
from bench.errors import ExperimentError
from bench.rig.rig import Rig
from drivers.backend import Backend
from drivers.errors import DeviceTimeoutError
from drivers.link import Link
from drivers.registry import load_backend, recognisers

WATCH_S = 1.0


def check_rig(rig: Rig, *, seed: int | None = None, watch_s: float = WATCH_S) -> RigCheck:
    """Open and watch every device of the rig; nothing moves.

    Raises DeviceError where the backend itself cannot be opened.
    """
    with ExitStack() as stack:
        backend: Backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place)
        stack.callback(backend.close)
        return look(rig, backend, watch_s)


def look(rig: Rig, backend: Backend, watch_s: float = WATCH_S) -> RigCheck:
    """As :func:`check_rig`, on a backend that is open already and stays so; its ports are closed again."""
    survey, link = Survey(), Link(backend, rig.wiring.buses)
    try:
        watched = [open_watched(settings, link, survey) for settings in rig.wiring.devices()]
        begun_ns = link.clock.now_ns()
        lost = watch(watched, link, watch_s)
        took_s = (link.clock.now_ns() - begun_ns) * 1e-9
        troubles = link.troubles()
    finally:
        link.close()
    host = None if backend.lock_step else look_at_host(rig, backend.clock)
    buses = _buses(rig, survey, troubles, took_s or watch_s)
    remarks = [remark for bus in rig.wiring.buses for remark in remarks_on(buses[bus.name], bus.bitrate_bit_s)]
    return RigCheck(
        devices=tuple(_device(each, rig, buses, survey, backend, watch_s) for each in watched),
        buses=tuple(buses.values()),
        host=host,
        whole=() if lost is None else (lost,),
        remarks=(*remarks, *(host_remarks(host, rig) if host is not None else ())),
    )


def _buses(rig: Rig, survey: Survey, troubles: Mapping[tuple[str, str], int], took_s: float) -> dict[str, BusCheck]:
    known, found = recognisers(), {}
    for settings in rig.wiring.buses:
        name = settings.name
        devices = [device for device in rig.wiring.devices() if device.bus == name]
        counted = {what: count for (place, what), count in troubles.items() if place == f"bus {name}"}
        found[name] = check_bus(settings, survey.buses[name], devices, known, counted, took_s)
    return found


def _device(
    each: Watched, rig: Rig, buses: Mapping[str, BusCheck], survey: Survey, backend: Backend, watch_s: float
) -> DeviceCheck:
    settings, streams = each.settings, streams_of(each, watch_s)
    status = each.status() if each.status is not None else None
    problems = [_explained(problem, each, rig, buses, survey, backend) for problem in each.problems]
    if each.identity is not None:
        problems += stream_problems(each, streams, rig)
        problems += status_problems(settings.role, status)
        problems += _contradictions(each)
    answer_s = _answer_s(each, survey)
    return DeviceCheck(settings.role, settings.driver, each.identity, status, streams, tuple(problems), answer_s)


def _explained(
    problem: Problem,
    each: Watched,
    rig: Rig,
    buses: Mapping[str, BusCheck],
    survey: Survey,
    backend: Backend,
) -> Problem:
    """A device's silence in the light of what else is heard."""
    settings = each.settings
    if not isinstance(problem, DeviceTimeoutError):
        return problem
    if settings.bus is not None and settings.bus in buses:
        bitrate_bit_s = next(bus.bitrate_bit_s for bus in rig.wiring.buses if bus.name == settings.bus)
        return explain_silence(settings, problem, buses[settings.bus], bitrate_bit_s)
    if settings.port is not None:
        return explain_noise(settings, problem, survey.bytes_heard[settings.port], backend)
    return problem


def _contradictions(each: Watched) -> Iterator[Problem]:
    for name in each.readings:
        if name != "current" and contradictory(each.values(name)):
            yield ExperimentError(
                f"[{each.settings.role}] {name} readings jump to and fro between two values: two devices share its "
                "address; give each one of its own"
            )


def _answer_s(each: Watched, survey: Survey) -> float | None:
    """The median time from a question to its first answer, while the device was asked who it is."""
    bus = survey.buses.get(each.settings.bus or "")
    first_ns, last_ns = each.asked_ns
    questions = bus.answers_ns() if bus is not None else ()
    delays = [min(answers) for _, at_ns, answers in questions if answers and first_ns <= at_ns <= last_ns]
    return median(delays) * 1e-9 if delays else None
