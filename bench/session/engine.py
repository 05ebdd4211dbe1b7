"""A session from beginning to end: check, open, run step by step, put away, conclude."""

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from bench.control.admittance import AdmittanceController
from bench.control.preview import with_preview
from bench.loop.alignment import Alignment
from bench.loop.devices import Devices, open_devices
from bench.loop.gate import guard_for
from bench.loop.loop import Loop, never_stop
from bench.loop.outbox import Outbox
from bench.procedures.carry_out import carry_out
from bench.procedures.catalogue import make_procedures
from bench.procedures.knowledge import Adaptive, Knowledge, Procedure
from bench.recording.contents import RecordedEstimates
from bench.recording.reader import read_recording
from bench.recording.recorder import Recorder
from bench.recording.room import Need
from bench.records import Measured
from bench.rig.rig import Rig
from bench.segments import Segment
from bench.session.conclusion import Conclusion, conclude
from bench.session.kept import with_last_on_disk
from bench.session.live_feed import InlineFeed, LiveFeed, ProcessFeed
from bench.session.progress import Progress, Silent
from bench.session.provenance import provenance
from bench.session.rehearsal import Rehearsed, rehearsed
from bench.session.schema import Session
from bench.session.supervision import told_to_guard, verify_watchdogs
from bench.session.warm_up import warm_up
from drivers.backend import Backend
from drivers.punctual import punctual
from drivers.registry import load_backend

# In lock step nothing is late while the recorder catches up.
LOCK_STEP_PATIENCE_S = 30.0
# Kinds of events that whoever watches should see at once; an experiment goes on all the same.
TROUBLES = ("bus", "device")


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
    """What a session leaves behind."""

    recording: Path
    conclusion: Conclusion
    knowledge: Knowledge
    measured: Measured


@dataclass
class _Run:
    """One session under way."""

    rig: Rig
    loop: Loop
    feed: LiveFeed
    knowledge: Knowledge
    progress: Progress
    recorder: Recorder
    live_ns: int = 0  # of the last live estimate that was recorded

    def take(self, part: Measured) -> None:
        """One part from the loop: recorder first, then the live identifier, then whoever watches."""
        self.recorder.put(part)
        self.feed(part)
        if self.feed.latest.stamp_ns > self.live_ns:
            self.live_ns = self.feed.latest.stamp_ns
            self.recorder.put_estimate(self.feed.latest)
        self.progress.part(part, self.feed.latest)
        for event in part.events:
            if event.kind in TROUBLES:
                self.progress.note(event.text)

    def step(self, step: Procedure | Adaptive) -> None:
        """Carry out one procedure, or all those that an adaptive step decides on, one after the other."""
        if not isinstance(step, Adaptive):
            self._carry_out(step)
            return
        while (decision := step.following(self.knowledge)).procedure is not None:
            self.progress.note(decision.said)
            self.knowledge = decision.known
            self._carry_out(decision.procedure)
        self.progress.note(decision.said)
        self.knowledge = decision.known

    def _carry_out(self, procedure: Procedure) -> None:
        self.recorder.check()
        known = carry_out(procedure, self.knowledge, self.loop, self._foresee)
        self.learn(with_last_on_disk(known, self.recorder.path.parent))

    def _foresee(self, segment: Segment, velocity_rad_s: float, command: float) -> Segment:
        """The free motion to expect under zero torque, once the live estimate is valid."""
        known, network = self.knowledge, self.feed.latest.network
        if network is None or known.calibration is None or known.actuator is None:
            return segment
        delay_s, tick_s = known.actuator.command_delay_s, known.tick_s
        return with_preview(
            segment, network, known.calibration, delay_s, tick_s, velocity_rad_s=velocity_rad_s, command=command
        )

    def learn(self, known: Knowledge) -> None:
        """Let loop, guard and controller know it too."""
        self.knowledge, loop = known, self.loop
        loop.guard.know(told_to_guard(known))
        if known.tare is not None:
            loop.alignment.torque_bias_nm = known.tare.torque_bias_nm
        if known.calibration is not None:
            loop.alignment.torque_bias_nm = known.calibration.torque_bias_nm
            if loop.controller is None or loop.controller.calibration != known.calibration:
                loop.controller = AdmittanceController(known.calibration, known.tick_s, self.rig.limits.load_torque_nm)


def run_session(
    rig: Rig,
    session: Session,
    *,
    out: Path,
    seed: int | None = None,
    progress: Progress | None = None,
    stop_request: Callable[[], str | None] = never_stop,
) -> SessionResult:
    """Run ``session`` on ``rig``; recording, network and report go to the folder ``out``.

    Raises as :func:`record_session` does, and ExperimentError where the data tell nothing.
    """
    done = record_session(rig, session, out=out, seed=seed, progress=progress, stop_request=stop_request)
    refined = done.knowledge.refinement
    conclusion = conclude(
        done.measured,
        rig_text=rig.text,
        metadata=done.metadata,
        live=done.live,
        recording=done.recording,
        out=out,
        notes=() if refined is None else refined.sentences,
    )
    return SessionResult(done.recording, conclusion, done.knowledge, done.measured)


def record_session(
    rig: Rig,
    session: Session,
    *,
    out: Path,
    seed: int | None = None,
    progress: Progress | None = None,
    stop_request: Callable[[], str | None] = never_stop,
) -> Recorded:
    """The experiment alone, recorded into the folder ``out``. Raises as :func:`record_procedures` does."""
    procedures = make_procedures([(step.do, step.options) for step in session.steps], rig, place=session.place)
    return record_procedures(rig, session, procedures, out=out, seed=seed, progress=progress, stop_request=stop_request)


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
    stop_request: Callable[[], str | None] = never_stop,
) -> Recorded:
    """Carry out ``procedures`` as a session's steps, on ``backend`` or on the rig's own; either is closed at the end.

    ``known`` is what another session on this bench has learned. The recording says which faults there were.
    Raises RigError and UsageError before anything moves; DeviceError, SafetyStopError, OperatorStopError and
    ExperimentError afterwards, with the drives idle and all that was measured in the recording.
    """
    progress = progress or Silent()
    plan = tuple((procedure.name, procedure.duration_s(rig)) for procedure in procedures)
    progress.plan(plan)
    warm_up()
    if backend is None:
        backend = load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place)
    with ExitStack() as stack:
        stack.callback(backend.close)
        rehearsal = rehearsed(session, backend)
        stack.enter_context(_settled_memory())
        devices = open_devices(rig, backend)
        stack.callback(devices.link.close)
        metadata = provenance(rig, session, seed, devices.identify())
        recorder = stack.enter_context(
            Recorder(
                out / f"{rig.name}.mcap",
                rig_text=rig.text,
                metadata=metadata,
                patience_s=LOCK_STEP_PATIENCE_S if backend.lock_step else 0.0,
                need=Need.of(rig.tick_s, sum(duration_s for _, duration_s in plan)),
                candump=rig.candump,
                wall_time=not backend.lock_step,
            )
        )
        run = stack.enter_context(_running(rig, devices, backend, recorder, progress, stop_request))
        if known is not None:
            run.learn(known)
        stack.callback(_put_away, run.loop, rehearsal)
        if rig.supervision.verify_watchdogs:
            with run.loop.on_time():  # it is about time
                verify_watchdogs(devices, run.loop.outbox, progress.note)
        _step_by_step(run, procedures, rehearsal)
    if recorder.dropped_parts:
        progress.note(f"{recorder.dropped_parts} parts were not recorded: the disk stood still; the fit lacks them")
    found = read_recording(recorder.path, raw_frames=False)
    return Recorded(recorder.path, found.metadata, run.knowledge, found.measured, found.live)


def _step_by_step(run: _Run, procedures: Sequence[Procedure | Adaptive], rehearsal: Rehearsed) -> None:
    clock, begun_s = run.loop.devices.clock, perf_counter()
    begun_ns = clock.now_ns()
    rehearsal.begin(None)
    for index, procedure in enumerate(procedures):
        run.progress.step(index, procedure.name)
        rehearsal.begin(procedure.name)
        run.step(procedure)
    bench_s, took_s = (clock.now_ns() - begun_ns) * 1e-9, perf_counter() - begun_s
    run.progress.note(f"{bench_s:.0f} s of bench time took {took_s:.1f} s ({bench_s / took_s:.1f}x); now the final fit")


def _put_away(loop: Loop, rehearsal: Rehearsed) -> None:
    """A recording says what was made to fail in it."""
    for stamp_ns, text in rehearsal.happened():
        loop.outbox.put_event(stamp_ns, "fault", text)
    loop.outbox.hand_on()


@contextmanager
def _settled_memory() -> Iterator[None]:
    """Inside, the garbage collector lets be what is there already: all that was imported takes it 0.1 s each time."""
    gc.collect()  # or a session's leavings would stay for as long as this one's
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def _running(
    rig: Rig,
    devices: Devices,
    backend: Backend,
    recorder: Recorder,
    progress: Progress,
    stop_request: Callable[[], str | None],
) -> Iterator[_Run]:
    outbox = Outbox()
    devices.link.set_tap(outbox.put_frame)
    loop = Loop(devices, guard_for(rig, devices), outbox, Alignment(), rig.tick_ns, stop_request)
    if not backend.lock_step:
        loop.on_time = punctual
    feed = (InlineFeed if backend.lock_step else ProcessFeed)(rig.command.unit, rig.tick_s)
    run = _Run(rig, loop, feed, Knowledge(rig), progress, recorder)
    outbox.consumers = (run.take,)
    try:
        yield run
    finally:
        feed.close()
        if feed.dropped:
            progress.note(f"{feed.dropped} parts were not digested live; the final fit has them all")
