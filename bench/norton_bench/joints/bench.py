"""The benches of an arm's joints, opened together, and what is carried out on them."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from uuid import uuid4

import numpy as np

from norton_bench.joints.arm import Arm
from norton_bench.loop.in_process import InProcessLoop, loop_in_process
from norton_bench.loop.together import run_together, running_together
from norton_bench.procedures.knowledge import Knowledge, Procedure, carry_out
from norton_bench.recording.disk import Need
from norton_bench.recording.recorder import Recorder
from norton_bench.records import Measured
from norton_bench.rig.load import simulator
from norton_bench.segments import Segment, Use
from norton_bench.session.engine import LOCK_STEP_PATIENCE_S
from norton_bench.session.provenance import provenance
from norton_bench.session.resume import FINISHED
from norton_bench.session.run import learned
from norton_bench.session.schema import Session
from norton_bench.session.warm_up import warm_up
from norton_drivers.ports import Backend
from norton_drivers.real_time import frozen_garbage
from norton_drivers.registry import load_backend

# In the recordings of both joints: what was done with the arm, and which run it was.
ARM, RUN = "arm", "run"
# An arm swings at some hertz, and comes to rest within some periods.
REST_S = 2.0
# What is carried out on all joints at once: a segment for each of them.
JointPlan = Generator[tuple[Segment, ...], tuple[Measured, ...], None]


@dataclass
class OneJoint:
    """Runs segments on one joint, while the drives of the others are enabled and give no torque."""

    loops: Sequence[InProcessLoop]
    joint: int

    def running(self) -> AbstractContextManager[None]:
        return running_together(self.loops)

    def run(self, segment: Segment) -> Measured:
        rest = Segment(segment.procedure, f"beside {segment.name}", Use.PREPARE, np.zeros(segment.ticks))
        segments = [segment if joint == self.joint else rest for joint in range(len(self.loops))]
        return run_together(self.loops, segments)[self.joint]


@dataclass
class JointBenches:
    """The loops of all joints, each with its recorder, and what is known of each so far."""

    loops: tuple[InProcessLoop, ...]
    recorders: tuple[Recorder, ...]
    known: list[Knowledge]

    def verify_watchdogs(self) -> Iterator[str]:
        """The result of each test; nothing moves. Raises as :meth:`norton_bench.loop.loop.Loop.verify_watchdogs`."""
        for loop, known in zip(self.loops, self.known, strict=True):
            if known.rig.supervision.verify_watchdogs:
                yield from (f"{known.rig.name}: {finding}" for finding in loop.verify_watchdogs())

    def carry_out(self, joint: int, procedure: Procedure) -> None:
        """A procedure on one joint, once all rest, and what its loop learns from it.

        Raises as ``carry_out``; the drives are idle then.
        """
        self._rest()
        loop = self.loops[joint]
        known = carry_out(procedure, self.known[joint], OneJoint(self.loops, joint))
        self.known[joint] = replace(known, records=known.records[-1:])
        loop.learn(learned(known))
        loop.tell(FINISHED, procedure.name)

    def perform(self, name: str, plan: JointPlan) -> None:
        """All segments of a plan, on all joints at once. Raises as ``carry_out``; the drives are idle then."""
        self._check_recorders()
        segments = next(plan, None)
        with running_together(self.loops):
            while segments is not None:
                measured = run_together(self.loops, segments)
                try:
                    segments = plan.send(measured)
                except StopIteration:
                    break
        for loop in self.loops:
            loop.tell(FINISHED, name)

    def _rest(self) -> None:
        """Until what was moved before swings no more."""
        self._check_recorders()
        ticks = round(REST_S / self.known[0].tick_s)
        rest = Segment("rest", "rest", Use.PREPARE, np.zeros(ticks))
        with running_together(self.loops):
            run_together(self.loops, [rest for _ in self.loops])

    def _check_recorders(self) -> None:
        for recorder in self.recorders:
            recorder.check()


@contextmanager
def open_benches(
    arm: Arm, out: Path, *, seed: int | None, planned_s: float, stop_request: Callable[[], str | None]
) -> Iterator[JointBenches]:
    """Everything open, nothing moved; the recordings are in the folder ``out``, one a joint, by the name of its rig.

    Raises WiringError, RigError, UsageError, DeviceError and ExperimentError.
    """
    warm_up()
    with ExitStack() as stack:
        backends = _backends(arm, seed)
        for backend in backends:
            stack.callback(backend.close)
        loops = tuple(
            stack.enter_context(loop_in_process(rig, backend, stop_request))
            for rig, backend in zip(arm.rigs, backends, strict=True)
        )
        stack.enter_context(frozen_garbage())
        recorders, run = [], uuid4().hex
        for rig, loop, backend in zip(arm.rigs, loops, backends, strict=True):
            metadata = provenance(rig, Session((), arm.place), seed, tuple(loop.identify()))
            recorder = Recorder(
                out / f"{rig.name}.mcap",
                rig_text=rig.text,
                metadata={**metadata, "loop": loop.place, ARM: arm.options, RUN: run},
                patience_s=LOCK_STEP_PATIENCE_S if backend.lock_step else 0.0,
                need=Need.of(rig.tick_s, planned_s),
                candump=rig.candump,
                wall_time=not backend.lock_step,
            )
            recorders.append(stack.enter_context(recorder))
            loop.subscribe(recorder.put)
        yield JointBenches(loops, tuple(recorders), [Knowledge(rig) for rig in arm.rigs])


def _backends(arm: Arm, seed: int | None) -> tuple[Backend, ...]:
    if arm.is_simulated:
        opened: tuple[Backend, ...] = simulator("two_joints")(arm.benches, arm.simulated, seed=seed, place=arm.place)
        return opened
    return tuple(load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place) for rig in arm.rigs)
