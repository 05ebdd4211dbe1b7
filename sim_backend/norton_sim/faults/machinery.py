"""Faults of sensors that keep sending, of drives, mechanics and the host."""

from typing import cast

from norton_sim.faults.schema import (
    BiasJump,
    BrokenCoupling,
    DriveError,
    EncoderJump,
    FalseReading,
    Freeze,
    HostStall,
    OverTemperature,
    Runaway,
    Saturation,
    SignFlip,
    Stuck,
    Undervoltage,
)
from norton_sim.faults.stage import Stage, Undo
from norton_sim.firmware.context import DriveFault
from norton_sim.plant import Distortion, Machine

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
