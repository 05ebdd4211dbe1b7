"""Runs one case in lock step: a whole session on the simulated backend, with a record of the true state."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import BenchError, UsageError
from norton_bench.events import PartMeasured, SessionEvent
from norton_bench.faults.case import Allowed, Case, CaseResult, Detection, Verdict, judge
from norton_bench.loop.devices import open_devices
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.excitations import imposed_multisine
from norton_bench.procedures.free import command_multisine
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from norton_bench.procedures.waves import back, imposed
from norton_bench.records import Measured, join
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use
from norton_bench.session.engine import record_procedures
from norton_bench.session.schema import Session, WrittenFault
from norton_drivers.errors import DeviceError
from norton_drivers.ports import Rehearsal, TrueState
from norton_drivers.registry import load_backend

DURATION_S = 1.5
MOTION_SHARE = 0.3
COMMAND_SHARE = 0.5
SWINGS = 2  # of a modulator
REST_S = 0.2


@dataclass(frozen=True)
class Exercise:
    """What the bench is doing when a fault strikes: motion imposed by one drive, a changing command on the other.

    A second and a half of it; then both drives let go, slowly where the actuator may be a spring.
    """

    name: ClassVar[str] = "exercise"

    def require(self, rig: Rig) -> None:
        require_load(rig, "faults", "so that there is motion to be disturbed")

    def duration_s(self, rig: Rig) -> float:
        return DURATION_S + REST_S

    def plan(self, known: Knowledge) -> Plan:
        limit = COMMAND_SHARE * known.rig.command.limit
        motion = imposed_multisine(known, MOTION_SHARE, DURATION_S, seed=3)
        command = command_multisine(known, (-limit, limit), DURATION_S, seed=4)
        moving = imposed(self.name, "motion and command", Use.PREPARE, command, motion)
        moved = yield replace(moving, modulation=_modulation(known.rig, moving.ticks))
        yield back(self.name, "rest", known.rig, moved, REST_S)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known


def _modulation(rig: Rig, ticks: int) -> FloatArray:
    """To and fro from zero; none where nothing is modulated."""
    if rig.modulation is None:
        return np.empty(0)
    phase = 2 * np.pi * SWINGS * np.arange(ticks) / ticks
    return np.asarray(0.5 * COMMAND_SHARE * rig.modulation.limit * (1 - np.cos(phase)))


# Just enough to impose motion.
BEFORE = (TareProcedure(TareOptions(duration_s=0.5)), CalibrateProcedure(CalibrateOptions(duration_s=2.0)))
# After the drives are armed, which is up to a heartbeat before the exercise begins.
STRIKES = {"after": "armed", "at": "600 ms"}
# How long the world is watched after the session has ended, beyond what the drives may take.
WATCH_ON_NS = 100_000_000
COUNTS = ("bus", "device")  # events in which a recording counts what was wrong


@dataclass
class _Listener:
    """Keeps what was measured, however the session ends."""

    parts: list[Measured] = field(default_factory=list)

    def __call__(self, event: SessionEvent) -> None:
        if isinstance(event, PartMeasured):
            self.parts.append(event.measured)


@dataclass(frozen=True)
class _Run:
    """What is known after a session: what ended it, what was measured, what was true; ``bug`` is what should not be."""

    error: str | None
    bug: str | None
    ended_ns: int
    measured: Measured
    states: Sequence[TrueState]


@dataclass(frozen=True)
class Prepared:
    """A rig that is ready for its faults: what its first session learned, and how long its drives may go on."""

    rig: Rig
    known: Knowledge
    allowed: Allowed


def prepare(rig: Rig, seed: int | None = None) -> Prepared:
    """A session that learns enough of the rig to impose motion.

    Raises RigError where the rig cannot be simulated or has no load drive, and what :func:`record_procedures` raises.
    """
    Exercise().require(rig)
    with TemporaryDirectory() as folder:
        session = Session((), "faults, calibration")
        known = record_procedures(rig, session, BEFORE, out=Path(folder), seed=seed, live=False).knowledge
    seen = replace(rig, supervision=replace(rig.supervision, verify_watchdogs=False))  # just now: once is enough
    return Prepared(seen, known, allowed_on(rig))


def rehearse(prepared: Prepared, case: Case, seed: int | None = None) -> CaseResult:
    """The exercise, and the fault in the middle of it. Raises UsageError for a backend that cannot rehearse."""
    rig = prepared.rig
    backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place)
    if not isinstance(backend, Rehearsal):
        raise UsageError(f'{rig.place}: backend = "{rig.backend}" cannot rehearse faults; use "simulated"')
    run = _run(prepared, case, backend, seed)
    fault = backend.injected[-1] if backend.injected else None
    outcome = nothing_yet(rig, case, prepared.allowed)
    if run.bug is not None:
        return _failed(outcome, run.bug)
    if fault is None or fault.begun_ns is None:
        return _failed(outcome, f"the session ended before the fault: {run.error or 'as planned'}")
    if "count" in case.table and not fault.hits:
        return _failed(outcome, "the fault hit no frame")
    return _judged(outcome, run, fault.begun_ns, fault.hits, prepared, case)


def allowed_on(rig: Rig) -> Allowed:
    """From the drives' watchdogs, as their drivers set them. Raises RigError, DeviceError."""
    backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=None, place=rig.place)
    try:
        devices = open_devices(rig, backend)
        result = Allowed.of([drive.watchdog_s for drive in devices.drives], rig.limits, rig.tick_ns)
        devices.link.close()
    finally:
        backend.close()
    return result


def family(rig: Rig) -> str:
    """By its drives."""
    drivers = [device.driver for device in (rig.wiring.actuator, rig.wiring.load) if device is not None]
    return "+".join(dict.fromkeys(drivers))


def _run(prepared: Prepared, case: Case, backend: Rehearsal, seed: int | None) -> _Run:
    states, listener = backend.watch(), _Listener()
    error: str | None = None
    bug: str | None = None
    session = Session((), f"faults, {case.name}", faults=(WrittenFault({**STRIKES, **case.table}, Exercise.name),))
    with TemporaryDirectory() as folder:
        try:
            record_procedures(
                prepared.rig,
                session,
                (Exercise(),),
                out=Path(folder),
                backend=backend,
                known=prepared.known,
                seed=seed,
                on_event=listener,
                live=False,
            )
        except (BenchError, DeviceError) as stopped_by:
            error = str(stopped_by)
        except Exception as stumbled_over:  # a host that a fault makes stumble is a finding, among all the others
            bug = f"the program itself failed ({type(stumbled_over).__name__}: {stumbled_over})"
    ended_ns = backend.clock.now_ns()
    backend.clock.wait_until_ns(ended_ns + prepared.allowed.ns + WATCH_ON_NS)
    return _Run(error, bug, ended_ns, join(listener.parts), states)


def nothing_yet(rig: Rig, case: Case, allowed: Allowed) -> CaseResult:
    """What is known of a case before it is tried."""
    return CaseResult(
        case.name,
        case.on,
        family(rig),
        rig.name,
        case.expected,
        Verdict.FAILED,
        allowed_s=allowed.ns * 1e-9,
        watchdogs=allowed.watchdogs,
    )


def _failed(outcome: CaseResult, why: str) -> CaseResult:
    return replace(outcome, guard=why)


def _judged(outcome: CaseResult, run: _Run, begun_ns: int, hits: int, prepared: Prepared, case: Case) -> CaseResult:
    detection = _detection(run)
    if detection is not None and detection.stamp_ns < begun_ns:
        return _failed(outcome, f"the session ended before the fault: {detection.words}")
    limits = prepared.rig.limits
    result = judge(run.states, begun_ns, detection, case, allowed=prepared.allowed, limits=limits)
    return replace(
        outcome,
        **vars(result),
        guard="" if detection is None else detection.words,
        detected_s=None if detection is None else (detection.stamp_ns - begun_ns) * 1e-9,
        hits=hits,
        longest_silence_s=_longest_silence_s(run.measured, begun_ns),
        counted=tuple(event.text for event in run.measured.events if event.kind in COUNTS),
    )


def _detection(run: _Run) -> Detection | None:
    if run.error is None:
        return None
    stops = [event for event in run.measured.events if event.kind == "stop"]
    return Detection(stops[-1].stamp_ns if stops else run.ended_ns, run.error)


def _longest_silence_s(measured: Measured, begun_ns: int) -> float:
    """The longest time without a reading of any one stream, from just before the fault on."""
    streams = [table["arrival_ns"] for table in (measured.motion, measured.load_motion, measured.torque) if len(table)]
    later = [stamps[max(0, np.searchsorted(stamps, begun_ns) - 1) :] for stamps in streams]
    gaps = [float(np.max(np.diff(stamps))) for stamps in later if len(stamps) > 1]
    return max(gaps) * 1e-9 if gaps else nan
