"""Faults come true: each begins when it is due, and ends when its time is over."""

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any

from norton_drivers.errors import WiringError
from norton_sim.faults import carriage, connections, machinery, readings, schema
from norton_sim.faults.schema import Fault, HostStall
from norton_sim.faults.stage import Injected, Stage, Undo

# How often a fault that waits for the drives looks whether they are armed.
LOOK_NS = 1_000_000

EFFECTS: Mapping[type[Fault], Callable[[Any, Stage], Undo]] = {
    schema.BusOff: connections.bus_off,
    schema.Unplugged: connections.unplugged,
    schema.Dropout: connections.dropout,
    schema.Freeze: readings.freeze,
    schema.SignFlip: readings.sign_flip,
    schema.Saturation: readings.saturation,
    schema.BiasJump: readings.bias_jump,
    schema.FalseReading: readings.false_reading,
    schema.EncoderJump: readings.encoder_jump,
    schema.DriveError: machinery.breakdown,
    schema.Undervoltage: machinery.breakdown,
    schema.OverTemperature: machinery.breakdown,
    schema.Runaway: machinery.runaway,
    schema.Stuck: machinery.stuck,
    schema.BrokenCoupling: machinery.broken_coupling,
    schema.HostStall: machinery.host_stall,
}
# Those that hit frames count them.
COUNTED_EFFECTS: Mapping[type[Fault], Callable[[Any, Stage, Injected], Undo]] = {
    schema.Drop: carriage.drop,
    schema.Delay: carriage.delay,
    schema.Duplicate: carriage.duplicate,
    schema.Reorder: carriage.reorder,
    schema.Corrupt: carriage.corrupt,
    schema.BabblingNode: connections.babbling_node,
}


def inject(fault: Fault, stage: Stage) -> Injected:
    """Let ``fault`` befall the stage, its time counted from now. Raises WiringError where it cannot."""
    misplaced = fault.complaint(stage.wiring)
    if misplaced is not None:
        raise WiringError(f"{fault.kind}, {misplaced[0]}: {misplaced[1]}")
    if isinstance(fault, HostStall) and stage.stall is None:
        raise WiringError("host-stall: the host is another process here; stop that one, with SIGSTOP for instance")
    injected = Injected(fault)
    if fault.after == "armed":
        _when_armed(stage, lambda: _schedule(injected, stage))
    else:
        _schedule(injected, stage)
    return injected


def _when_armed(stage: Stage, then: Callable[[], None]) -> None:
    world = stage.world

    def look(stamp_ns: int) -> None:
        if stage.armed():
            then()
        else:
            world.at(stamp_ns + LOOK_NS, look)

    world.at(world.now_ns, look)


def _schedule(injected: Injected, stage: Stage) -> None:
    world, fault = stage.world, injected.fault

    def begin(stamp_ns: int) -> None:
        injected.begun_ns = stamp_ns
        undo = _begin(injected, stage)
        if isfinite(fault.duration_s):
            world.at(stamp_ns + round(fault.duration_s * 1e9), lambda end_ns: end(end_ns, undo))

    def end(stamp_ns: int, undo: Undo) -> None:
        injected.ended_ns = stamp_ns
        undo()

    world.at(world.now_ns + round(fault.at_s * 1e9), begin)


def _begin(injected: Injected, stage: Stage) -> Undo:
    fault = injected.fault
    counted = COUNTED_EFFECTS.get(type(fault))
    return EFFECTS[type(fault)](fault, stage) if counted is None else counted(fault, stage, injected)
