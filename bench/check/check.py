"""A look at a rig: who is there, how fast and how evenly each device speaks, what is wrong."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from statistics import median

from bench.check.absent import explain_silence
from bench.check.baud import explain_noise
from bench.check.buses import check_bus, remarks_on
from bench.check.doubles import contradictory
from bench.check.findings import BusCheck, DeviceCheck, Problem, RigCheck
from bench.check.host import host_remarks, look_at_host
from bench.check.moving import announcement, check_moving
from bench.check.streams import status_problems, stream_problems, streams_of
from bench.check.survey import Survey
from bench.check.watch import Watched, open_watched, watch
from bench.errors import BenchError, ExperimentError, OperatorStopError
from bench.loop.loop import never_stop
from bench.rig.rig import Rig
from drivers.backend import Backend
from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.link import Link
from drivers.registry import load_backend, recognisers

WATCH_S = 1.0


@dataclass(frozen=True)
class Permission:
    """To move the shaft: ``say`` is told what is about to happen, ``stop_request`` is asked every tick."""

    say: Callable[[str], None]
    stop_request: Callable[[], str | None] = never_stop


def check_rig(
    rig: Rig, *, seed: int | None = None, watch_s: float = WATCH_S, move: Permission | None = None
) -> RigCheck:
    """Open and watch every device of the rig. Nothing moves, but with ``move``, and then only where nothing is wrong.

    Raises DeviceError where the backend itself cannot be opened, OperatorStopError where somebody stopped it.
    """
    with ExitStack() as stack:
        backend: Backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place)
        stack.callback(backend.close)
        found = look(rig, backend, watch_s)
        return found if move is None else _moved(rig, backend, found, move)


def _moved(rig: Rig, backend: Backend, found: RigCheck, move: Permission) -> RigCheck:
    if found.problems():
        move.say("nothing is moved until what was found is mended")
        return found
    move.say(announcement(rig))
    try:
        moved = check_moving(rig, backend, move.stop_request)
    except OperatorStopError:
        raise
    except (BenchError, DeviceError) as error:
        return replace(found, whole=(*found.whole, error))
    return replace(found, moved=moved.said, whole=(*found.whole, *moved.problems))


def look(rig: Rig, backend: Backend, watch_s: float = WATCH_S) -> RigCheck:
    """As :func:`check_rig`, on a backend that is open already and stays so; its ports are closed again."""
    survey, link = Survey(), Link(backend, rig.wiring.buses)
    begun_ns = link.clock.now_ns()
    try:
        watched = [open_watched(settings, link, survey) for settings in rig.wiring.devices()]
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
