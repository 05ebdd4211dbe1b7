"""``rig check``: which devices are there, how fast and how evenly each sends, and what is wrong."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from norton_bench.check.buses import check_bus, contradictory, remarks_on
from norton_bench.check.lines import check_lines, explain_silent_line
from norton_bench.check.survey import BusCheck, DeviceCheck, HostCheck, Problem, RigCheck, Survey
from norton_bench.check.watch import (
    Watched,
    ask_everybody,
    explain_silence,
    open_watched,
    status_problems,
    stream_problems,
    streams_of,
    watch,
)
from norton_bench.errors import BenchError, ExperimentError, OperatorStopError, RigError
from norton_bench.loop.stop_word import never_stop
from norton_bench.on_demand import deferred
from norton_bench.rig.driver_options import wrong_unit_of
from norton_bench.rig.rig import Rig
from norton_drivers.adapters.table import remarks as link_remarks
from norton_drivers.discovery import held_back_words, serial_obstacles
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.ports import Backend, Clock
from norton_drivers.real_time import LOOP_PRIORITY, permitted_priority
from norton_drivers.registry import Recognition, answers_remotely, load_backend, recognition
from norton_drivers.wiring import CanBusSettings, DeviceSettings

WATCH_S = 1.0
SIMULATED = "simulated"  # a backend that opens nothing outside of this program

announcement = deferred("norton_bench.check.moving:announcement")
check_moving = deferred("norton_bench.check.moving:check_moving")


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
        result = look(rig, backend, watch_s)
        return result if move is None else _moved(rig, backend, result, move)


def refuse_impossible(rig: Rig, seed: int | None) -> None:
    """As :func:`refuse_overfull` for a simulated bench, whose buses would carry more than any real one."""
    if rig.backend == SIMULATED:
        refuse_overfull(rig, seed)


def refuse_overfull(rig: Rig, seed: int | None) -> None:
    """Raises ExperimentError where :func:`check_rig` of the simulated twin finds a bus that cannot carry its traffic.

    Never for a rig without a twin: how busy its buses are shows only when they are opened.
    """
    if rig.simulated:
        raise_overfull(check_rig(replace(rig, backend=SIMULATED), seed=seed).overfull())


def raise_overfull(problems: Sequence[Problem]) -> None:
    """Raises ExperimentError where there is a bus that cannot carry what its devices send."""
    if problems:
        raise ExperimentError("\n".join(map(str, problems)))


def _moved(rig: Rig, backend: Backend, result: RigCheck, move: Permission) -> RigCheck:
    if result.problems():
        move.say("nothing is moved until what was found is mended")
        return result
    move.say(announcement(rig))
    try:
        moved = check_moving(rig, backend, move.stop_request)
    except OperatorStopError:
        raise
    except (BenchError, DeviceError) as error:
        return replace(result, whole=(*result.whole, error))
    return replace(result, moved=moved.said, whole=(*result.whole, *moved.problems))


def look(rig: Rig, backend: Backend, watch_s: float = WATCH_S) -> RigCheck:
    """As :func:`check_rig`, on a backend that is open already and stays so; its ports are closed again."""
    survey, link, known = Survey(), Link(backend, rig.wiring.buses), recognition()
    begun_ns = link.clock.now_ns()
    try:
        watched = [open_watched(settings, link, survey) for settings in rig.wiring.devices()]
        lost = watch(watched, link, watch_s, rig.tick_ns)
        ask_everybody(watched, link, survey, known)
        took_s = (link.clock.now_ns() - begun_ns) * 1e-9
        troubles = link.troubles()
        held_back = {name: words for name in link.serial_ports if (words := held_back_words(name))}
    finally:
        link.close()
    host = None if backend.lock_step else look_at_host(rig, backend.clock)
    seen = _Seen(rig, backend, survey, known, troubles, took_s or watch_s, watch_s)
    buses = {settings.name: seen.bus(settings) for settings in rig.wiring.buses}
    lines = check_lines(rig, survey.lines, held_back, exact=backend.lock_step)
    remarks = [remark for bus in rig.wiring.buses for remark in remarks_on(buses[bus.name], bus.rates)]
    remarks += [remark for line in lines for remark in line.remarks]
    remarks += [f"port {name}: {words}" for name, words in held_back.items()]
    if host is not None:
        remarks += [f"bus {bus.name}: {remark}" for bus in rig.wiring.buses for remark in link_remarks(bus)]
    return RigCheck(
        devices=tuple(seen.device(each, buses) for each in watched),
        buses=tuple(buses.values()),
        lines=lines,
        host=host,
        whole=() if lost is None else (lost,),
        remarks=(*remarks, *(host_remarks(host, rig) if host is not None else ())),
    )


@dataclass(frozen=True)
class _Seen:
    """What was seen, and by whose help it is understood."""

    rig: Rig
    backend: Backend
    survey: Survey
    recognition: Mapping[str, Recognition]
    troubles: Mapping[tuple[str, str], int]
    took_s: float
    watched_s: float

    def bus(self, settings: CanBusSettings) -> BusCheck:
        """One bus judged."""
        name = settings.name
        devices = [device for device in self.rig.wiring.devices() if device.bus == name]
        counted = {what: count for (place, what), count in self.troubles.items() if place == f"bus {name}"}
        return check_bus(settings, self.survey.buses[name], devices, self.recognition, counted, self.took_s)

    def device(self, each: Watched, buses: Mapping[str, BusCheck]) -> DeviceCheck:
        """One device judged, in the light of what else is heard on its bus."""
        settings, streams = each.settings, streams_of(each, self.watched_s)
        status = each.status() if each.status is not None else None
        problems = [self._explained(problem, settings, buses) for problem in each.problems]
        if each.command_unit is not None and (wrong := wrong_unit_of(self.rig, settings, each.command_unit)):
            problems.append(RigError(wrong))
        if each.identity is not None:
            problems += stream_problems(each, streams, self.rig)
            problems += status_problems(settings.role, status)
            problems += _contradictions(each)
        answer_s = self._answer_s(each)
        return DeviceCheck(settings.role, settings.driver, each.identity, status, streams, tuple(problems), answer_s)

    def _explained(self, problem: Problem, settings: DeviceSettings, buses: Mapping[str, BusCheck]) -> Problem:
        if not isinstance(problem, DeviceTimeoutError):
            return problem
        if settings.bus is not None and settings.bus in buses:
            rates = next(bus.rates for bus in self.rig.wiring.buses if bus.name == settings.bus)
            return explain_silence(settings, problem, buses[settings.bus], rates)
        if settings.port is not None:
            others = [each for each in self.rig.wiring.devices() if each.port == settings.port and each is not settings]
            heard = self.survey.lines[settings.port].bytes_heard
            return explain_silent_line(settings, problem, others, heard, self.backend, self.recognition)
        return problem

    def _answer_s(self, each: Watched) -> float | None:
        """The median time from a question to its first answer, while the device was asked who it is."""
        bus = self.survey.buses.get(each.settings.bus or "")
        offered = self.recognition.get(each.settings.driver, Recognition()).answers
        answers = [answers_remotely] if offered is None else [answers_remotely, offered]
        first_ns, last_ns = each.asked_ns
        delays = [
            result[0].stamp_ns - question.stamp_ns
            for question, result in (() if bus is None else bus.answered(answers))
            if first_ns <= question.stamp_ns <= last_ns
        ]
        return median(delays) * 1e-9 if delays else None


def _contradictions(each: Watched) -> Iterator[Problem]:
    for name in each.readings:
        if each.streams[name].required and contradictory(each.values(name)):
            yield ExperimentError(
                f"[{each.settings.role}] {name} readings jump to and fro between two values: two devices share its "
                "address; give each one of its own"
            )


_TICKS = 500


# What of this computer matters to the loop: whether it may run in real time, and how late it wakes up.
def look_at_host(rig: Rig, clock: Clock) -> HostCheck:
    """Wait for some hundred ticks as the loop does, and note how late each came [s]."""
    late_s = np.empty(_TICKS)
    deadline_ns = clock.now_ns()
    for index in range(_TICKS):
        deadline_ns += rig.tick_ns
        clock.wait_until_ns(deadline_ns)
        now_ns = clock.now_ns()
        late_s[index] = (now_ns - deadline_ns) * 1e-9
        deadline_ns = max(deadline_ns, now_ns - rig.tick_ns)  # a stall is one late tick, not many
    median_s, tail_s = np.percentile(late_s, (50, 99))
    return HostCheck(permitted_priority(LOOP_PRIORITY) > 0, float(median_s), float(tail_s), float(late_s.max()))


def host_remarks(host: HostCheck, rig: Rig) -> Iterator[str]:
    """What should be mended of it, or allowed for in the rig file."""
    if not host.real_time:
        yield (
            f"this computer: the loop may not run in real time; add `@realtime - rtprio {LOOP_PRIORITY}` for your "
            "group to /etc/security/limits.conf and log in again"
        )
    most_s, stall_s, stale_s = host.late_most_s, rig.limits.stall_after_ns * 1e-9, rig.limits.stale_after_ns * 1e-9
    for key, limit_s in (("stall_after", stall_s), ("stale_after", stale_s)):
        if most_s > 0.5 * limit_s:
            yield (
                f"this computer: it stood still for {most_s * 1e3:.0f} ms while it was watched, more than half of "
                f"[limits] {key} = {limit_s * 1e3:g} ms; quieten it, or raise the limit"
            )
    for device in rig.wiring.devices():
        for obstacle in serial_obstacles(device.port) if device.port else ():
            yield f"[{device.role}] port {device.port}: {obstacle}"
