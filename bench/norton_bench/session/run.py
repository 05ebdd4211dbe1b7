"""One running session: what its script yields is carried out, measured, recorded and reported."""

from collections import deque
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, cast

import numpy as np

from norton_bench.control.calibration import LoadCalibration
from norton_bench.control.preview import foreseeing, with_preview
from norton_bench.errors import OperatorStopError
from norton_bench.events import Note, PartMeasured, Planned, PlannedStep, StepBegun, Watcher
from norton_bench.guard.check import (
    EMPTY_MODEL,
    GuardModel,
    Machine,
    amperes_per_command,
    still_swing_nm,
    torque_readings,
)
from norton_bench.identification.results import FitResult
from norton_bench.loop.bench_loop import BenchLoop, Learned
from norton_bench.models.sliding import damping_nm, greatest_friction_nm
from norton_bench.procedures.calibrate import known_well_enough
from norton_bench.procedures.catalogue import CATALOGUE, needed_by
from norton_bench.procedures.knowledge import (
    Adaptive,
    Knowledge,
    Procedure,
    Reducing,
    Reporting,
    carry_out,
    follow,
    only_rendered,
)
from norton_bench.procedures.tare import TareProcedure
from norton_bench.recording.recorder import Recorder
from norton_bench.records import Measured, Table
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use
from norton_bench.session.items import ASK
from norton_bench.session.live_feed import LiveFeed
from norton_bench.session.operator import Answers, OperatorOrders, unanswered_by_script
from norton_bench.session.program import Rehearsed
from norton_bench.session.resume import ANSWERED, FINISHED, EarlierSession, before
from norton_bench.session.script import Action, Ask, ByHand, Remark, SoFar, Turn


def learned(known: Knowledge) -> Learned:
    """What the loop needs to know."""
    tare, calibration = known.tare, known.calibration
    bias_nm = None if tare is None else tare.torque_bias_nm
    if calibration is not None:
        bias_nm = calibration.torque_bias_nm
    return Learned(guard_model_of(known), bias_nm, calibration)


def guard_model_of(known: Knowledge) -> GuardModel:
    """The guard's model of the bench; empty before the tare."""
    tare, calibration = known.tare, known.calibration
    tared, shaken = _record(known, Use.TARE), _record(known, Use.CALIBRATE)
    if tare is None or tared is None:
        return EMPTY_MODEL
    return GuardModel(
        torque=torque_readings(_stretch(tared, "rest"), shaken),
        moving_command=tare.moving_command,
        # The current and torque of a servo do not follow from its command alone.
        amperes_per_command=None if known.rig.servo else amperes_per_command(tared.ticks, "command", tared.current),
        load_amperes_per_nm=amperes_per_command(tared.ticks, "load_torque_nm", tared.load_current),
        sensor_stiffness_nm_rad=None if calibration is None else calibration.sensor_stiffness_nm_rad,
        still_swing_nm=None if shaken is None else max(still_swing_nm(tared), still_swing_nm(shaken)),
        actuator=None if known.rig.servo else _actuator(known.actuator, known.rig.limits.velocity_rad_s),
        load=None if calibration is None else _load(calibration),
    )


def _record(known: Knowledge, use: Use) -> Measured | None:
    """The record of the last procedure with a segment of this ``use``; None where there is none."""
    records = (record for record in reversed(known.records) if any(segment.use is use for segment in record.segments))
    return next(records, None)


def _stretch(record: Measured, name: str) -> Measured:
    segment = next(segment for segment in record.segments if segment.name == name)
    return record.between(segment.start_ns, segment.end_ns)


def _load(calibration: LoadCalibration) -> Machine:
    return Machine(
        calibration.torque_gain,
        calibration.inertia_kgm2,
        calibration.viscous_damping_nms_rad,
        calibration.coulomb_torque_nm,
        calibration.weight_nm,
        _lag_s(calibration.command_delay_s, calibration.motion_delay_s or 0.0, calibration.amplifier_bandwidth_rad_s),
    )


def _actuator(fit: FitResult | None, fastest_rad_s: float) -> Machine | None:
    """None where the fit does not know the actuator's torque balance well enough.

    The network's terms go in by the most that they may add: friction at the place and in the direction where it is
    greatest, cogging's whole amplitude, and drag at the greatest velocity that is allowed. A joint goes in as if it
    were stiff. What saturation and ripple take from the gain, and friction that grows with the torque at the port, is a
    share of the torques that act, of which the guard allows one anyway.
    """
    if fit is None or not known_well_enough(fit):
        return None
    network = fit.network
    return Machine(
        network.torque_gain,
        network.rigid.inertia_kgm2,
        float(damping_nm(network, fastest_rad_s)) / fastest_rad_s,
        greatest_friction_nm(network),
        lag_s=_lag_s(fit.command_delay_s, fit.motion_delay_s, network.amplifier_bandwidth_rad_s),
    )


def _lag_s(command_delay_s: float, motion_delay_s: float, bandwidth_rad_s: float) -> float:
    """From a command to the readings. Delays count from the torque reading; torque and motion are taken half way."""
    return max(command_delay_s + 0.5 * motion_delay_s + 1.0 / bandwidth_rad_s, 0.0)


def with_last_on_disk(known: Knowledge, folder: Path) -> Knowledge:
    """The same knowledge, its last record mapped from a file without a name in ``folder``.

    Later fits need every record; so they do not fill the memory. The file vanishes with this process.
    """
    if not known.records:
        return known
    *before, last = known.records
    return replace(known, records=(*before, _mapped(last, folder)))


def _mapped(record: Measured, folder: Path) -> Measured:
    """The same tables in a mapped file; in memory where the disk is full."""
    tables = {name: getattr(record, name) for name in _TABLES}
    if not any(map(len, tables.values())):
        return record
    try:
        with TemporaryFile(dir=folder) as file:
            for table in tables.values():
                file.write(table.tobytes())
            file.flush()
            content = np.memmap(file, np.uint8, mode="r")
    except OSError:
        return record
    return replace(record, **cast(dict[str, Any], _cut(content, tables)))


def _cut(content: "np.memmap[tuple[int], np.dtype[np.uint8]]", tables: dict[str, Table]) -> dict[str, Table]:
    """The tables in the mapped bytes, one after the other."""
    mapped, start = {}, 0
    for name, table in tables.items():
        mapped[name] = np.asarray(content[start : start + table.nbytes]).view(table.dtype)
        start += table.nbytes
    return mapped


_TABLES = tuple(each.name for each in fields(Measured) if isinstance(getattr(Measured(), each.name), np.ndarray))


# Kinds of recorded events that are also shown at once; the experiment goes on.
TROUBLES = ("bus", "device")
# The kind of what is recorded of a plan that had to be made smaller.
PLAN = "plan"


@dataclass
class SessionRun:
    """Performs a script (:class:`norton_bench.session.script.Performer`).

    ``earlier`` is the session that this one resumes; its finished procedures are not done again.
    """

    rig: Rig
    loop: BenchLoop
    feed: LiveFeed
    so_far: SoFar
    emit: Watcher
    recorder: Recorder
    orders: OperatorOrders
    rehearsal: Rehearsed
    answers: Answers
    plan: list[PlannedStep]
    earlier: EarlierSession
    _done: set[str] = field(default_factory=set)
    _next: int = 0
    _live_ns: int = 0  # of the last live estimate that was recorded

    def take(self, part: Measured) -> None:
        """One part from the loop: to the recorder first, then to the live identifier, then to the watcher."""
        self.recorder.put(part)
        self.feed(part)
        if self.feed.latest.stamp_ns > self._live_ns:
            self._live_ns = self.feed.latest.stamp_ns
            self.recorder.put_estimate(self.feed.latest)
        self.emit(PartMeasured(part.without_frames(), self.feed.latest))
        for event in part.events:
            if event.kind in TROUBLES:
                self.emit(Note(event.text))
        self.orders.listen()

    def learn(self, known: Knowledge) -> None:
        """Use ``known`` from now on, and give the loop what it needs of it."""
        self.so_far.known = known
        self.loop.learn(learned(known))

    def turn(self, yielded: Action | Turn | Remark) -> None:
        """Raises as the procedure does, and OperatorStopError."""
        if isinstance(yielded, Remark):
            self.emit(Note(yielded.text))
            return
        index, action = (yielded.index, yielded.action) if isinstance(yielded, Turn) else (self._next, yielded)
        self._announce(index, action)
        if not self.earlier.left:
            self._checkpoint()
            if self._skipped(index, action):
                return
            self.rehearsal.begin(name_of(action))
        self._do(action)
        self._done.add(name_of(action))

    def last_turn(self, yielded: Action | Turn | Remark, error: Exception) -> None:
        """After ``error``, which was final, nothing moves. Prompts are asked; after an operator's stop, only shown."""
        action = yielded.action if isinstance(yielded, Turn) else yielded
        if isinstance(action, Remark):
            self.emit(Note(action.text))
        elif not isinstance(action, Ask):
            self.emit(Note(f"left out '{action.name}': after this end nothing may move"))
        elif isinstance(error, OperatorStopError):
            self.emit(Note(action.text))
        else:
            self._ask(action)

    def _announce(self, index: int, action: Action) -> None:
        if index >= len(self.plan):
            duration_s = 0.0 if isinstance(action, Ask) else action.duration_s(self.rig)
            self.plan.append(PlannedStep(name_of(action), duration_s))
            self.emit(Planned(tuple(self.plan)))
        self.emit(StepBegun(index, name_of(action)))
        self._next = index + 1

    def _do(self, action: Action) -> None:
        if isinstance(action, Ask):
            self._ask(action)
        elif isinstance(action, ByHand):
            self.recorder.check()
            known = self.so_far.known
            deque(follow(action.plan(known), self.loop, only_rendered(known)), maxlen=0)
        elif isinstance(action, Adaptive):
            self._adapt(action)
        else:
            self._carry_out(action)

    def _ask(self, action: Ask) -> None:
        answer = self.earlier.answer(action.name)
        if answer is None:
            ready = self.answers.to(action.prompt)
            if ready is None and not self.orders.operator.answers:
                raise unanswered_by_script(action.prompt)
            answer = self.orders.ask(action.prompt) if ready is None else ready
            self.emit(Note(f"{action.text} {answer}"))
        self.loop.tell(ANSWERED, f"{action.name}: {answer}")
        self.so_far.answers[action.name] = answer

    def _adapt(self, step: Adaptive) -> None:
        """Carry out the procedures that the step chooses, one after the other."""
        while (decision := step.following(self.so_far.known)).procedure is not None:
            self.emit(Note(decision.sentence))
            self.so_far.known = decision.known
            self._carry_out(decision.procedure)
            self._checkpoint()
            if self.orders.wants_skip:
                self._report_skipped(step.name)
                return
        self.emit(Note(decision.sentence))
        self.so_far.known = decision.known

    def _carry_out(self, procedure: Procedure) -> None:
        known, record = self.so_far.known, self.earlier.finished(procedure.name)
        if record is not None:
            self.learn(replace(procedure.conclude(known, record), records=(*known.records, record)))
        else:
            self._carry_out_now(procedure)
        if isinstance(procedure, Reporting):
            self.loop.tell(*procedure.recorded_event(self.so_far.known))
        if record is None:
            self.loop.tell(FINISHED, procedure.name)

    def _carry_out_now(self, procedure: Procedure) -> None:
        self.recorder.check()
        if isinstance(procedure, Reducing):
            for sentence in procedure.reductions(self.so_far.known):
                self.emit(Note(sentence))
                self.loop.tell(PLAN, sentence)
        known = carry_out(procedure, self.so_far.known, self.loop, self._foresee)
        self.learn(with_last_on_disk(self._on_one_clock(known), self.recorder.path.parent))

    def _on_one_clock(self, known: Knowledge) -> Knowledge:
        """With the earlier session's records moved to before this one's first record, once there is one."""
        old = len(self.earlier.records)
        if not old or len(known.records) != old + 1:
            return known
        return replace(known, records=(*before(self.earlier.records, known.records[-1]), known.records[-1]))

    def _foresee(self, segment: Segment, position_rad: float | None, velocity_rad_s: float, command: float) -> Segment:
        """With the free motion to expect under zero torque, where a network predicts it well enough."""
        known = self.so_far.known
        if known.calibration is None or known.actuator is None or known.rig.holds_position:
            return segment
        knows_friction = known.calibration.actuator_friction is not None
        network = foreseeing(known.actuator.network, self.feed.latest.network, knows_friction=knows_friction)
        if network is None:
            return segment
        if position_rad is None:  # the shaft rests where the last procedure left it
            position_rad = float(known.records[-1].ticks[-1]["position_rad"]) if known.records else 0.0
        start = {"position_rad": position_rad, "velocity_rad_s": velocity_rad_s, "command": command}
        return with_preview(segment, network, known.calibration, known.actuator.command_delay_s, known.tick_s, **start)

    def _checkpoint(self) -> None:
        """Between procedures: carry out what was ordered meanwhile. Raises OperatorStopError, and as a tare does."""
        orders = self.orders
        orders.listen()
        orders.obey_stop()
        while orders.paused or orders.wants_tare:
            if orders.wants_tare:
                orders.wants_tare = False
                self._tare()
            orders.wait()

    def _tare(self) -> None:
        """As the operator ordered: it is no step, so that a session that resumes this one does not expect it."""
        self._carry_out_now(TareProcedure())
        tare, calibration = self.so_far.known.tare, self.so_far.known.calibration
        assert tare is not None
        self.emit(Note(f"tare: {tare.torque_bias_nm:+.3g} N*m at rest, noise {tare.torque_noise_nm:.2g} N*m"))
        if calibration is not None:  # measured with the shaft moving: without the torque of static friction
            self.emit(Note(f"the bias from 'calibrate', {calibration.torque_bias_nm:+.3g} N*m, stays in use"))

    def _skipped(self, index: int, action: Action) -> bool:
        """Whether the operator ordered to leave out the step, and no other step needs it."""
        if not self.orders.wants_skip:
            return False
        why = self._why_needed(index, action)
        if why is None:
            self._report_skipped(name_of(action))
            return True
        self.orders.wants_skip = False
        self.emit(Note(f"'{name_of(action)}' cannot be left out: {why}"))
        return False

    def _why_needed(self, index: int, action: Action) -> str | None:
        if isinstance(action, Ask):
            return "it asks for an answer"
        if action.name in self._done:
            return None
        names = [step.name for step in self.plan[index + 1 :] if step.name in CATALOGUE]
        later = next((name for name in names if action.name in needed_by(name, self.rig)), None)
        return None if later is None else f"'{later}' builds on it"

    def _report_skipped(self, name: str) -> None:
        self.orders.wants_skip = False
        self.loop.tell("operator", f"left out: {name}")
        self.emit(Note(f"'{name}' is left out, as ordered"))


def name_of(action: Action) -> str:
    """Its name in the plan."""
    return ASK if isinstance(action, Ask) else action.name
