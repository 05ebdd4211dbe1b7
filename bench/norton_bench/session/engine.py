"""A session from beginning to end: check, open the devices, run the steps, close the recording, fit."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TypeVar

from norton_bench.errors import ExitCode, UsageError
from norton_bench.events import Ended, Note, Planned, SessionState, StateChanged, Watcher, ignore
from norton_bench.loop.bench_loop import BenchLoop
from norton_bench.loop.in_process import loop_in_process
from norton_bench.on_demand import deferred
from norton_bench.procedures.knowledge import Adaptive, Knowledge, Procedure
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.recording.disk import Need
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.records import Measured
from norton_bench.result import Result
from norton_bench.rig.rig import Rig
from norton_bench.session.conclusion import conclude, ended, ended_by
from norton_bench.session.items import judge
from norton_bench.session.live_feed import NoFeed, feeding
from norton_bench.session.operator import NO_ANSWERS, Answers, Nobody, Operator, OperatorOrders
from norton_bench.session.program import Rehearsed, make_experiment, of_procedures, rehearsed
from norton_bench.session.provenance import provenance
from norton_bench.session.resume import RESUMES, EarlierSession, after, read_earlier
from norton_bench.session.run import SessionRun
from norton_bench.session.schema import Session
from norton_bench.session.script import Experiment, Script, SoFar, perform
from norton_bench.session.warm_up import warm_up
from norton_drivers.ports import Backend
from norton_drivers.real_time import frozen_garbage
from norton_drivers.registry import load_backend

LoopProcess = deferred("norton_bench.loop.process:LoopProcess")  # for hardware: a simulation does without

# In lock step the loop may wait for the recorder: nothing becomes late by it.
LOCK_STEP_PATIENCE_S = 30.0
Value = TypeVar("Value")


@dataclass(frozen=True)
class RecordedSession:
    """What an experiment has measured, as read from its recording, before any fit."""

    recording: Path
    metadata: Mapping[str, str]
    knowledge: Knowledge
    measured: Measured
    live: Sequence[RecordedEstimates]


@dataclass(frozen=True)
class RunTerms:
    """How to run a session: the folder of its files, its watcher, its operator, and what it resumes.

    ``resume`` is a recording, or the folder of one, whose finished steps are not done again. ``live`` is False where
    parameters are not to be identified while it runs, ``fits`` where they are not at the end either.
    """

    out: Path
    seed: int | None = None
    on_event: Watcher = ignore
    operator: Operator | None = None
    answers: Answers = NO_ANSWERS
    resume: Path | None = None
    live: bool = True
    fits: bool = True


def run_session(
    rig: Rig,
    session: Session,
    *,
    out: Path,
    seed: int | None = None,
    on_event: Watcher = ignore,
    operator: Operator | None = None,
    answers: Answers | None = None,
    resume: Path | None = None,
    live: bool = True,
) -> Result:
    """Run ``session`` on ``rig``; recording, network and report are written to the folder ``out``.

    ``on_event`` is called with every event; the last one is ``Ended``, however the session ends. ``answers`` are given
    to its prompts. ``resume`` is a recording, or the folder of one: the session goes on after its last finished step.
    Without ``live`` nothing is identified before the end: a simulated session then takes half of the time. What
    zero torque foresees then comes from the calibration alone, and no sentence says which parameter moved meanwhile.
    Raises as :func:`record_session` does, and ExperimentError for data that cannot be fitted.
    """
    terms = RunTerms(out, seed, on_event, operator, answers or NO_ANSWERS, resume, live)
    return _carried_out(terms, rig, session, lambda: make_experiment(session, rig))


def run_script(
    rig: Rig,
    script: Callable[[SoFar], Script],
    *,
    out: Path,
    seed: int | None = None,
    on_event: Watcher = ignore,
    operator: Operator | None = None,
    answers: Answers | None = None,
    resume: Path | None = None,
    live: bool = True,
) -> Result:
    """As :func:`run_session`, for a script (:mod:`norton_bench.session.script`). Its name is recorded."""
    terms = RunTerms(out, seed, on_event, operator, answers or NO_ANSWERS, resume, live)
    return _carried_out(terms, rig, _session_of(script), lambda: Experiment(script))


def record_script(
    rig: Rig,
    script: Callable[[SoFar], Script],
    *,
    out: Path,
    seed: int | None = None,
    on_event: Watcher = ignore,
    live: bool = True,
) -> RecordedSession:
    """The experiment alone, recorded into the folder ``out``. Raises as :func:`record_procedures` does."""
    return _recorded(RunTerms(out, seed, on_event, live=live), rig, _session_of(script), Experiment(script))


def run_by_hand(
    rig: Rig,
    script: Callable[[SoFar], Script],
    *,
    out: Path,
    seed: int | None = None,
    on_event: Watcher = ignore,
    operator: Operator | None = None,
) -> Path:
    """Run a script without identifying anything, neither live nor at the end; returns its recording.

    The last event is ``Ended``, however it ends. Raises as :func:`record_procedures` does.
    """
    terms = RunTerms(out, seed, on_event, operator, live=False, fits=False)
    return _reporting_its_end(
        terms,
        lambda: _performed(terms, rig, _session_of(script), Experiment(script)).recording,
        lambda recording: Ended(ExitCode.OK, recording=recording),
    )


def _session_of(script: Callable[[SoFar], Script]) -> Session:
    return Session((), getattr(script, "place", f"script {getattr(script, '__name__', type(script).__name__)}"))


def _carried_out(terms: RunTerms, rig: Rig, session: Session, experiment: Callable[[], Experiment]) -> Result:
    return _reporting_its_end(terms, lambda: _concluded(terms, rig, session, experiment()), ended)


def _reporting_its_end(terms: RunTerms, perform: Callable[[], Value], end_of: Callable[[Value], Ended]) -> Value:
    """Perform, and send the last event however that ends."""
    emit = terms.on_event
    earlier = set(terms.out.glob("*.mcap"))
    try:
        result = perform()
    except BaseException as error:
        emit(StateChanged(SessionState.FAILED))
        emit(ended_by(error, set(terms.out.glob("*.mcap")) - earlier))
        raise
    emit(StateChanged(SessionState.DONE))
    emit(end_of(result))
    return result


def _concluded(terms: RunTerms, rig: Rig, session: Session, experiment: Experiment) -> Result:
    done = _recorded(terms, rig, session, experiment)
    terms.on_event(StateChanged(SessionState.CONCLUDING))
    refined = done.knowledge.refinement
    result = conclude(
        done.measured,
        rig_text=rig.text,
        metadata=done.metadata,
        live=done.live,
        recording=done.recording,
        out=terms.out,
        notes=() if refined is None else refined.sentences,
        on_stage=lambda line: terms.on_event(Note(line)),
    )
    expectations = judge(session.expectations, result, rig.command.unit)
    return replace(result, knowledge=done.knowledge, expectations=expectations)


def record_session(
    rig: Rig,
    session: Session,
    *,
    out: Path,
    seed: int | None = None,
    on_event: Watcher = ignore,
    operator: Operator | None = None,
    live: bool = True,
) -> RecordedSession:
    """The experiment alone, recorded into the folder ``out``. Raises as :func:`record_procedures` does."""
    terms = RunTerms(out, seed, on_event, operator, live=live)
    return _recorded(terms, rig, session, make_experiment(session, rig))


def record_procedures(
    rig: Rig,
    session: Session,
    procedures: Sequence[Procedure | Adaptive],
    *,
    out: Path,
    backend: Backend | None = None,
    known: Knowledge | None = None,
    seed: int | None = None,
    on_event: Watcher = ignore,
    operator: Operator | None = None,
    live: bool = True,
) -> RecordedSession:
    """Carry out ``procedures`` as the steps of a session, on ``backend`` or on the rig's own; it is closed at the end.

    ``known`` is the knowledge from an earlier session on this bench. The recording lists injected faults.
    Raises RigError and UsageError before anything moves; DeviceError, SafetyStopError, OperatorStopError and
    ExperimentError afterwards, with the drives idle and all that was measured in the recording.
    """
    terms = RunTerms(out, seed, on_event, operator, live=live)
    return _recorded(terms, rig, session, of_procedures(procedures, rig), backend, known)


def _recorded(
    terms: RunTerms,
    rig: Rig,
    session: Session,
    experiment: Experiment,
    backend: Backend | None = None,
    known: Knowledge | None = None,
) -> RecordedSession:
    done = _performed(terms, rig, session, experiment, backend, known)
    found = read_recording(done.recording, raw_frames=False)
    return RecordedSession(
        done.recording, found.metadata, done.knowledge, after(done.earlier.records, found.measured), found.live
    )


@dataclass(frozen=True)
class _Performed:
    """An experiment that has ended, with its recording closed."""

    recording: Path
    knowledge: Knowledge
    earlier: EarlierSession


def _performed(
    terms: RunTerms,
    rig: Rig,
    session: Session,
    experiment: Experiment,
    backend: Backend | None = None,
    known: Knowledge | None = None,
) -> _Performed:
    emit, operator = terms.on_event, terms.operator or Nobody()
    earlier = _checked_earlier(terms, rig, session, experiment, operator)
    emit(Planned(experiment.plan))
    own_backend = backend is None
    if backend is None:
        backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=terms.seed, place=rig.place)
    lock_step = backend.lock_step
    with ExitStack() as stack:
        stack.callback(backend.close)
        rehearsal = rehearsed(session, backend)
        emit(StateChanged(SessionState.PREPARING))  # every file has been checked
        loop = stack.enter_context(_warm_loop(terms, rig, backend, operator, in_process=lock_step or not own_backend))
        stack.enter_context(frozen_garbage())
        devices = tuple(loop.identify())
        metadata = {**provenance(rig, session, terms.seed, devices), "loop": loop.place, RESUMES: earlier.place}
        planned_s = sum(step.duration_s for step in experiment.plan)
        recorder = stack.enter_context(_recorder(rig, terms.out, metadata, planned_s, lock_step=lock_step))
        so_far = SoFar(known or Knowledge(rig), devices=devices)
        feed = stack.enter_context(feeding(rig, emit, lock_step=lock_step)) if terms.live else NoFeed()
        orders = OperatorOrders(operator, emit, loop.tell)
        plan = list(experiment.plan)
        run = SessionRun(rig, loop, feed, so_far, emit, recorder, orders, rehearsal, terms.answers, plan, earlier)
        loop.subscribe(run.take)
        if known is not None:
            run.learn(known)
        stack.callback(_record_faults, loop, rehearsal)
        _report_readiness(loop, rig, emit)
        _perform(run, experiment, then="; now the final fit" if terms.fits else "")
    if recorder.dropped_parts:
        lost = recorder.dropped_parts
        emit(Note(f"{lost} parts were not recorded, because the disk was too slow; the fit does not have them"))
    return _Performed(recorder.path, so_far.known, earlier)


def _checked_earlier(
    terms: RunTerms, rig: Rig, session: Session, experiment: Experiment, operator: Operator
) -> EarlierSession:
    """The session to resume. Raises UsageError, before anything is opened, for what cannot be answered or resumed."""
    if experiment.prompts is not None:
        terms.answers.check(experiment.prompts, session.place, somebody=operator.answers)
    earlier = EarlierSession() if terms.resume is None else read_earlier(terms.resume, rig)
    if experiment.prompts is not None:
        earlier.check(experiment.plan)
    return earlier


@contextmanager
def _warm_loop(
    terms: RunTerms, rig: Rig, backend: Backend, operator: Operator, *, in_process: bool
) -> Iterator[BenchLoop]:
    """Open the devices, and compile all code.

    Where the loop has a process of its own the ports are opened first: a missing port is reported before the first run
    compiles.
    """
    if in_process:
        warm_up()
    opened: AbstractContextManager[BenchLoop] = (
        loop_in_process(rig, backend, operator.stop.heard)
        if in_process
        else LoopProcess(rig, operator.stop, seed=terms.seed)
    )
    with opened as loop:
        warm_up()
        yield loop


def _report_readiness(loop: BenchLoop, rig: Rig, emit: Watcher) -> None:
    """Before anything moves: notes of the loop (real-time rights that are missing), and the check of the watchdogs."""
    for note in loop.notes:
        emit(Note(note))
    if rig.supervision.verify_watchdogs:
        for finding in loop.verify_watchdogs():
            emit(Note(str(finding)))


def _recorder(rig: Rig, out: Path, metadata: Mapping[str, str], planned_s: float, *, lock_step: bool) -> Recorder:
    return Recorder(
        out / f"{rig.name}.mcap",
        rig_text=rig.text,
        metadata=metadata,
        patience_s=LOCK_STEP_PATIENCE_S if lock_step else 0.0,
        need=Need.of(rig.tick_s, planned_s),
        candump=rig.candump,
        wall_time=not lock_step,
    )


def _perform(run: SessionRun, experiment: Experiment, then: str) -> None:
    begun_ns, begun_s = run.loop.now_ns, perf_counter()
    run.rehearsal.begin(None)
    run.emit(StateChanged(SessionState.RUNNING))
    earlier = run.earlier
    if earlier.left:
        run.emit(Note(f"resumes {earlier.place}, of which {len(earlier.records)} procedures were finished"))
    perform(experiment.script(run.so_far), run)
    if earlier.left:
        raise UsageError(f"{earlier.place}: has more finished steps than this session; resume with the one recorded")
    bench_s, took_s = (run.loop.now_ns - begun_ns) * 1e-9, perf_counter() - begun_s
    run.emit(Note(f"{bench_s:.0f} s of bench time took {took_s:.1f} s ({bench_s / took_s:.1f}x){then}"))


def _record_faults(loop: BenchLoop, rehearsal: Rehearsed) -> None:
    """The recording lists the faults that were injected."""
    for stamp_ns, text in rehearsal.happened():
        loop.tell("fault", text, stamp_ns)
