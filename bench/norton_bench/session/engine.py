"""A session from beginning to end: check, open, run step by step, put away, conclude."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TypeVar

from norton_bench.errors import ExitCode, UsageError
from norton_bench.loop.bench_loop import BenchLoop
from norton_bench.loop.in_process import loop_in_process
from norton_bench.loop.process import LoopProcess
from norton_bench.procedures.knowledge import Adaptive, Knowledge, Procedure
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.recording.disk import Need
from norton_bench.recording.reader import read_recording
from norton_bench.recording.recorder import Recorder
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.session.conclusion import Conclusion, conclude
from norton_bench.session.expectations import judge
from norton_bench.session.live_feed import LiveFeed, NoFeed, feed_for
from norton_bench.session.operator import NO_ANSWERS, Answers, Desk, Nobody, Operator
from norton_bench.session.past import RESUMES, Past, behind, read_past
from norton_bench.session.program import make_experiment, of_procedures
from norton_bench.session.progress import Found, Judged, Progress, SessionState, Silent, Summary, found_in
from norton_bench.session.provenance import provenance
from norton_bench.session.rehearsal import Rehearsed, rehearsed
from norton_bench.session.run import Run
from norton_bench.session.schema import Session
from norton_bench.session.script import Experiment, Script, SoFar, perform
from norton_bench.session.summary import summary_of, summary_of_failure
from norton_bench.session.warm_up import warm_up
from norton_drivers.ports import Backend
from norton_drivers.real_time import frozen_garbage
from norton_drivers.registry import load_backend

# In lock step nothing is late while the recorder catches up.
LOCK_STEP_PATIENCE_S = 30.0
Result = TypeVar("Result")


@dataclass(frozen=True)
class Recorded:
    """What an experiment leaves behind before anything is concluded from it, as its recording has it."""

    recording: Path
    metadata: Mapping[str, str]
    knowledge: Knowledge
    measured: Measured
    live: Sequence[RecordedEstimates]


@dataclass(frozen=True)
class SessionResult:
    """What a session leaves behind. ``measured`` begins with what the session that it resumed has finished."""

    recording: Path
    conclusion: Conclusion
    knowledge: Knowledge
    measured: Measured
    expectations: tuple[Judged, ...] = ()

    def parameter(self, name: str) -> Found:
        """What the final fit says of it, also where that is nothing. Raises UsageError for an unknown name."""
        fit = self.conclusion.fit
        return found_in(fit.estimates if fit is not None else (), name, self.knowledge.rig.command.unit)


@dataclass(frozen=True)
class Terms:
    """How a session is to run: where its files go, who watches, who orders and answers, and what it goes on from.

    ``resume`` is a recording, or the folder of one, whose finished steps are not done again. ``fits`` says whether what
    is measured is identified, live and at the end.
    """

    out: Path
    seed: int | None = None
    progress: Progress | None = None
    operator: Operator | None = None
    answers: Answers = NO_ANSWERS
    resume: Path | None = None
    fits: bool = True


def run_session(
    rig: Rig,
    session: Session,
    *,
    out: Path,
    seed: int | None = None,
    progress: Progress | None = None,
    operator: Operator | None = None,
    answers: Answers | None = None,
    resume: Path | None = None,
) -> SessionResult:
    """Run ``session`` on ``rig``; recording, network and report go to the folder ``out``.

    ``progress`` is told the result however the session ends; ``answers`` are given beforehand to its prompts, and
    ``resume`` is a recording, or the folder of one, behind whose last finished step it goes on. Raises as
    :func:`record_session` does, and ExperimentError where the data tell nothing.
    """
    terms = Terms(out, seed, progress, operator, answers or NO_ANSWERS, resume)
    return _told(terms, rig, session, lambda: make_experiment(session, rig))


def run_script(
    rig: Rig,
    script: Callable[[SoFar], Script],
    *,
    out: Path,
    seed: int | None = None,
    progress: Progress | None = None,
    operator: Operator | None = None,
    answers: Answers | None = None,
    resume: Path | None = None,
) -> SessionResult:
    """The same for a script of your own (:mod:`norton_bench.session.script`), whose name goes into the recording."""
    terms = Terms(out, seed, progress, operator, answers or NO_ANSWERS, resume)
    return _told(terms, rig, _session_of(script), lambda: Experiment(script))


def record_script(
    rig: Rig, script: Callable[[SoFar], Script], *, out: Path, seed: int | None = None, progress: Progress | None = None
) -> Recorded:
    """The experiment alone, recorded into the folder ``out``. Raises as :func:`record_procedures` does."""
    return _recorded(Terms(out, seed, progress), rig, _session_of(script), Experiment(script))


def run_by_hand(
    rig: Rig,
    script: Callable[[SoFar], Script],
    *,
    out: Path,
    seed: int | None = None,
    progress: Progress | None = None,
    operator: Operator | None = None,
) -> Path:
    """A script of which nothing is identified, neither live nor at the end; returns its recording.

    ``progress`` is told how it ended, however that is. Raises as :func:`record_procedures` does.
    """
    terms = Terms(out, seed, progress, operator, fits=False)
    return _with_its_end_told(
        terms,
        lambda: _performed(terms, rig, _session_of(script), Experiment(script)).recording,
        lambda recording: Summary(ExitCode.OK, recording=recording),
    )


def _session_of(script: Callable[[SoFar], Script]) -> Session:
    return Session((), getattr(script, "place", f"script {getattr(script, '__name__', type(script).__name__)}"))


def _told(terms: Terms, rig: Rig, session: Session, experiment: Callable[[], Experiment]) -> SessionResult:
    return _with_its_end_told(
        terms,
        lambda: _concluded(terms, rig, session, experiment()),
        lambda result: summary_of(result.recording, result.conclusion, result.expectations),
    )


def _with_its_end_told(terms: Terms, perform: Callable[[], Result], summarise: Callable[[Result], Summary]) -> Result:
    """Whoever watches is told the result, whatever it is."""
    progress = terms.progress or Silent()
    earlier = set(terms.out.glob("*.mcap"))
    try:
        result = perform()
    except BaseException as error:
        progress.state(SessionState.FAILED)
        progress.result(summary_of_failure(error, set(terms.out.glob("*.mcap")) - earlier))
        raise
    progress.state(SessionState.DONE)
    progress.result(summarise(result))
    return result


def _concluded(terms: Terms, rig: Rig, session: Session, experiment: Experiment) -> SessionResult:
    done = _recorded(terms, rig, session, experiment)
    (terms.progress or Silent()).state(SessionState.CONCLUDING)
    refined = done.knowledge.refinement
    conclusion = conclude(
        done.measured,
        rig_text=rig.text,
        metadata=done.metadata,
        live=done.live,
        recording=done.recording,
        out=terms.out,
        notes=() if refined is None else refined.sentences,
        tell=(terms.progress or Silent()).note,
    )
    expected = judge(session.expectations, conclusion, rig.command.unit)
    return SessionResult(done.recording, conclusion, done.knowledge, done.measured, expected)


def record_session(
    rig: Rig,
    session: Session,
    *,
    out: Path,
    seed: int | None = None,
    progress: Progress | None = None,
    operator: Operator | None = None,
) -> Recorded:
    """The experiment alone, recorded into the folder ``out``. Raises as :func:`record_procedures` does."""
    return _recorded(Terms(out, seed, progress, operator), rig, session, make_experiment(session, rig))


def record_procedures(
    rig: Rig,
    session: Session,
    procedures: Sequence[Procedure | Adaptive],
    *,
    out: Path,
    backend: Backend | None = None,
    known: Knowledge | None = None,
    seed: int | None = None,
    progress: Progress | None = None,
    operator: Operator | None = None,
) -> Recorded:
    """Carry out ``procedures`` as a session's steps, on ``backend`` or on the rig's own; either is closed at the end.

    ``known`` is what another session on this bench has learned. The recording says which faults there were.
    Raises RigError and UsageError before anything moves; DeviceError, SafetyStopError, OperatorStopError and
    ExperimentError afterwards, with the drives idle and all that was measured in the recording.
    """
    terms = Terms(out, seed, progress, operator)
    return _recorded(terms, rig, session, of_procedures(procedures, rig), backend, known)


def _recorded(
    terms: Terms,
    rig: Rig,
    session: Session,
    experiment: Experiment,
    backend: Backend | None = None,
    known: Knowledge | None = None,
) -> Recorded:
    done = _performed(terms, rig, session, experiment, backend, known)
    found = read_recording(done.recording, raw_frames=False)
    return Recorded(
        done.recording, found.metadata, done.knowledge, behind(done.past.records, found.measured), found.live
    )


@dataclass(frozen=True)
class _Performed:
    """An experiment that is over, its recording closed."""

    recording: Path
    knowledge: Knowledge
    past: Past


def _performed(
    terms: Terms,
    rig: Rig,
    session: Session,
    experiment: Experiment,
    backend: Backend | None = None,
    known: Knowledge | None = None,
) -> _Performed:
    progress, operator = terms.progress or Silent(), terms.operator or Nobody()
    if experiment.prompts is not None:
        terms.answers.check(experiment.prompts, session.place, somebody=operator.answers)
    past = Past() if terms.resume is None else read_past(terms.resume, rig)
    if experiment.prompts is not None:
        past.check(experiment.plan)
    progress.plan(experiment.plan)
    progress.state(SessionState.PREPARING)
    own_backend = backend is None
    if backend is None:
        backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=terms.seed, place=rig.place)
    lock_step = backend.lock_step
    with ExitStack() as stack:
        stack.callback(backend.close)
        rehearsal = rehearsed(session, backend)
        loop = stack.enter_context(_warm_loop(terms, rig, backend, operator, in_process=lock_step or not own_backend))
        stack.enter_context(frozen_garbage())
        devices = tuple(loop.identify())
        metadata = {**provenance(rig, session, terms.seed, devices), "loop": loop.place, RESUMES: past.place}
        planned_s = sum(step.duration_s for step in experiment.plan)
        recorder = stack.enter_context(_recorder(rig, terms.out, metadata, planned_s, lock_step=lock_step))
        so_far = SoFar(known or Knowledge(rig), devices=devices)
        feed = stack.enter_context(_feed(rig, progress, lock_step=lock_step)) if terms.fits else NoFeed()
        desk = Desk(operator, progress, loop.tell)
        plan = list(experiment.plan)
        run = Run(rig, loop, feed, so_far, progress, recorder, desk, rehearsal, terms.answers, plan, past)
        loop.subscribe(run.take)
        if known is not None:
            run.learn(known)
        stack.callback(_put_away, loop, rehearsal)
        _say_how_it_stands(loop, rig, progress)
        _perform(run, experiment, then="; now the final fit" if terms.fits else "")
    if recorder.dropped_parts:
        progress.note(f"{recorder.dropped_parts} parts were not recorded: the disk stood still; the fit lacks them")
    return _Performed(recorder.path, so_far.known, past)


@contextmanager
def _warm_loop(
    terms: Terms, rig: Rig, backend: Backend, operator: Operator, *, in_process: bool
) -> Iterator[BenchLoop]:
    """The devices, open, and everything compiled. A port that is not there is told before the first run compiles,
    where somebody reads the ports meanwhile: the loop's own process."""
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


def _say_how_it_stands(loop: BenchLoop, rig: Rig, progress: Progress) -> None:
    """Before anything moves: what the system denied the loop, and that the drives' watchdogs act."""
    for note in loop.notes:
        progress.note(note)
    if rig.supervision.verify_watchdogs:
        for finding in loop.verify_watchdogs():
            progress.note(str(finding))


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


def _perform(run: Run, experiment: Experiment, then: str) -> None:
    begun_ns, begun_s = run.loop.now_ns, perf_counter()
    run.rehearsal.begin(None)
    run.progress.state(SessionState.RUNNING)
    if run.past.left:
        run.progress.note(f"goes on from {run.past.place}, of which {len(run.past.records)} procedures were finished")
    perform(experiment.script(run.so_far), run)
    if run.past.left:
        raise UsageError(f"{run.past.place}: has more finished steps than this session; resume with the one recorded")
    bench_s, took_s = (run.loop.now_ns - begun_ns) * 1e-9, perf_counter() - begun_s
    run.progress.note(f"{bench_s:.0f} s of bench time took {took_s:.1f} s ({bench_s / took_s:.1f}x){then}")


def _put_away(loop: BenchLoop, rehearsal: Rehearsed) -> None:
    """A recording says what was made to fail in it."""
    for stamp_ns, text in rehearsal.happened():
        loop.tell("fault", text, stamp_ns)


@contextmanager
def _feed(rig: Rig, progress: Progress, *, lock_step: bool) -> Iterator[LiveFeed]:
    feed = feed_for(rig, lock_step=lock_step)
    try:
        yield feed
    finally:
        feed.close()
        if feed.dropped:
            progress.note(f"{feed.dropped} parts were not digested live; the final fit has them all")
