"""A procedure and a loop brought together."""

from collections.abc import Callable
from dataclasses import replace

from norton_bench.loop.bench_loop import Runner
from norton_bench.procedures.knowledge import Knowledge, Procedure
from norton_bench.records import Measured, join
from norton_bench.segments import Segment

# Given a segment, and the velocity [rad/s] of the shaft and the actuator's command before it, the segment with what can
# be foreseen of it.
Foresight = Callable[[Segment, float, float], Segment]


def as_it_is(segment: Segment, _velocity_rad_s: float, _command: float) -> Segment:
    """Nothing is foreseen."""
    return segment


def carry_out(procedure: Procedure, known: Knowledge, loop: Runner, foresee: Foresight = as_it_is) -> Knowledge:
    """Run one procedure with the drives enabled, then, with the drives idle, draw what follows from it.

    Raises SafetyStopError, OperatorStopError, DeviceError, ExperimentError; the drives are idle then, too.
    """
    measured: list[Measured] = []
    plan = procedure.plan(known)
    segment = next(plan, None)
    if segment is not None:
        segment = foresee(segment, 0.0, 0.0)  # before the drives are enabled: it may take its time
    with loop.running():
        while segment is not None:
            measured.append(loop.run(segment))
            last = measured[-1].ticks[-1]
            try:
                segment = plan.send(measured[-1])
            except StopIteration:
                break
            segment = foresee(segment, float(last["velocity_rad_s"]), float(last["command"]))
    record = join(measured)
    return replace(procedure.conclude(known, record), records=(*known.records, record))
