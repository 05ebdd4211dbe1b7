"""A procedure and a loop brought together."""

from bench.loop.loop import Loop
from bench.procedures.knowledge import Knowledge, Procedure
from bench.records import Measured, join


def carry_out(procedure: Procedure, known: Knowledge, loop: Loop) -> Knowledge:
    """Run one procedure with the drives enabled, then, with the drives idle, draw what follows from it.

    Raises SafetyStopError, OperatorStopError, DeviceError, ExperimentError; the drives are idle then, too.
    """
    measured: list[Measured] = []
    with loop.running():
        plan = procedure.plan(known)
        segment = next(plan, None)
        while segment is not None:
            measured.append(loop.run(segment))
            try:
                segment = plan.send(measured[-1])
            except StopIteration:
                segment = None
    return procedure.conclude(known, join(measured))
