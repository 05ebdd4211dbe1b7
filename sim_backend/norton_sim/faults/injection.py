"""Faults of machines and sensors; and the injection of every fault, from when it is due until its time is over."""

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from math import isfinite
from typing import Any, cast

from pydantic import ValidationError

from norton_drivers.errors import WiringError
from norton_drivers.wiring import Wiring
from norton_sim.faults import schema, wires
from norton_sim.faults.schema import (
    KINDS,
    BiasJump,
    BrokenCoupling,
    DriveError,
    EncoderJump,
    FalseReading,
    Fault,
    Freeze,
    HostStall,
    OverTemperature,
    Runaway,
    Saturation,
    SignFlip,
    Stuck,
    Undervoltage,
)
from norton_sim.faults.stage import Injected, Stage, Undo
from norton_sim.firmware.context import DriveFault
from norton_sim.plant import Distortion, Machine
from norton_sim.tables import complaints, keys_of, nearest

TORQUE_SENSOR = "torque_sensor"


def freeze(fault: Freeze, stage: Stage) -> Undo:
    if fault.on != TORQUE_SENSOR:
        return _misread(stage, fault.on, gain=0)
    stands_at_nm = stage.world.plant.sensor_torque_nm()
    return _distorted(stage, lambda _torque_nm: stands_at_nm)


def sign_flip(fault: SignFlip, stage: Stage) -> Undo:
    if fault.on != TORQUE_SENSOR:
        return _misread(stage, fault.on, gain=-1)
    return _distorted(stage, lambda torque_nm: -torque_nm)


def saturation(fault: Saturation, stage: Stage) -> Undo:
    return _distorted(stage, lambda torque_nm: min(max(torque_nm, -fault.limit_nm), fault.limit_nm))


def bias_jump(fault: BiasJump, stage: Stage) -> Undo:
    return _distorted(stage, lambda torque_nm: torque_nm + fault.by_nm)


def false_reading(fault: FalseReading, stage: Stage) -> Undo:
    return _distorted(stage, lambda _torque_nm: fault.torque_nm)


def encoder_jump(fault: EncoderJump, stage: Stage) -> Undo:
    return _misread(stage, fault.on, gain=1, jump_rad=fault.by_rad)


def _distorted(stage: Stage, distortion: Distortion) -> Undo:
    return stage.world.plant.distort_sensor(distortion)


def _misread(stage: Stage, on: str, gain: int, jump_rad: float = 0.0) -> Undo:
    plant, machine = stage.world.plant, cast(Machine, on)
    plant.misread(machine, gain, jump_rad)
    return lambda: plant.read_true(machine)


BREAKDOWNS = {
    DriveError: DriveFault.FAULT,
    Undervoltage: DriveFault.UNDERVOLTAGE,
    OverTemperature: DriveFault.OVER_TEMPERATURE,
}


def breakdown(fault: DriveError | Undervoltage | OverTemperature, stage: Stage) -> Undo:
    stage.drive(fault.on).break_down(BREAKDOWNS[type(fault)])
    return _stays


def runaway(fault: Runaway, stage: Stage) -> Undo:
    plant, machine = stage.world.plant, cast(Machine, fault.on)
    plant.run_away(machine, fault.torque_nm)
    return lambda: plant.obey(machine)


def stuck(fault: Stuck, stage: Stage) -> Undo:
    plant, machine = stage.world.plant, cast(Machine, fault.on)
    plant.jam(machine)
    return lambda: plant.free(machine)


def broken_coupling(_fault: BrokenCoupling, stage: Stage) -> Undo:
    stage.world.plant.uncouple()
    return _stays


def host_stall(fault: HostStall, stage: Stage) -> Undo:
    assert stage.stall is not None  # or it would not have been let in
    stage.stall(round(fault.lasts_s * 1e9))
    return _stays


def _stays() -> None:
    """What cannot be taken back."""


def read_faults(tables: object, wiring: Wiring, *, place: str, section: str) -> tuple[Fault, ...]:
    """Faults as they are written in files: read, with a sentence for each mistake.

    The faults written as ``[[section]]`` tables in the file ``place``, in their order.

    Raises WiringError, one sentence for each mistake with its place and the remedy.
    """
    if not isinstance(tables, Sequence) or isinstance(tables, str):
        raise WiringError(f"{place}: [{section}] should be a list of tables: write [[{section}]], in double brackets")
    faults: list[Fault] = []
    sentences: list[str] = []
    for number, table in enumerate(tables, 1):
        result = _read(table, wiring, place, f"{section} {number}")
        if isinstance(result, Fault):
            faults.append(result)
        else:
            sentences += result
    if sentences:
        raise WiringError("\n".join(sentences))
    return tuple(faults)


def _read(table: object, wiring: Wiring, place: str, name: str) -> Fault | list[str]:
    """The fault, or what is wrong with it."""
    if not isinstance(table, Mapping):
        return [f"{place}: [{name}] should be a table with kind = ..., not {table!r}"]
    model = KINDS.get(str(table.get("kind")))
    if model is None:
        return [f"{place}: [{name}] kind {_kind_mend(table.get('kind'))}"]
    return _filled(model, {key: value for key, value in table.items() if key != "kind"}, wiring, place, name)


def _filled(model: type[Fault], written: Mapping[str, Any], wiring: Wiring, place: str, name: str) -> Fault | list[str]:
    name = f"{name}, {model.kind}"
    known = keys_of(model)
    strange = [f"{place}: [{name}] {key} is not known; {nearest(key, known)}" for key in written if key not in known]
    try:
        # With a context, so that numbers without a unit are refused: they come from a file.
        fault = model.model_validate({key: written[key] for key in written if key in known}, context={"place": place})
    except ValidationError as error:
        return [*strange, *complaints(error, model, written, place=place, name=name)]
    misplaced = fault.complaint(wiring)
    if misplaced is not None:
        strange.append(f"{place}: [{name}] {misplaced[0]}: {misplaced[1]}")
    return strange or fault


def _kind_mend(kind: object) -> str:
    if kind is None:
        return f'is missing; add kind = "drop" (or {", ".join(list(KINDS)[1:])})'
    close = get_close_matches(str(kind).lower(), KINDS, n=1)
    mend = f'did you mean "{close[0]}"?' if close else f"known: {', '.join(KINDS)}"
    return f'= "{kind}" is no fault; {mend}'


# How often a fault that waits for the drives looks whether they are armed.
LOOK_NS = 1_000_000

EFFECTS: Mapping[type[Fault], Callable[[Any, Stage], Undo]] = {
    schema.BusOff: wires.bus_off,
    schema.Unplugged: wires.unplugged,
    schema.Dropout: wires.dropout,
    schema.Freeze: freeze,
    schema.SignFlip: sign_flip,
    schema.Saturation: saturation,
    schema.BiasJump: bias_jump,
    schema.FalseReading: false_reading,
    schema.EncoderJump: encoder_jump,
    schema.DriveError: breakdown,
    schema.Undervoltage: breakdown,
    schema.OverTemperature: breakdown,
    schema.Runaway: runaway,
    schema.Stuck: stuck,
    schema.BrokenCoupling: broken_coupling,
    schema.HostStall: host_stall,
}
# Those that hit frames count them.
COUNTED_EFFECTS: Mapping[type[Fault], Callable[[Any, Stage, Injected], Undo]] = {
    schema.Drop: wires.drop,
    schema.Delay: wires.delay,
    schema.Duplicate: wires.duplicate,
    schema.Reorder: wires.reorder,
    schema.Corrupt: wires.corrupt,
    schema.BabblingNode: wires.babbling_node,
}


def inject(fault: Fault, stage: Stage) -> Injected:
    """Schedule ``fault``, its time counted from now. Raises WiringError where it cannot."""
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
