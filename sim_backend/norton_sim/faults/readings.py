"""Faults of what sensors say, while they go on saying it."""

from typing import cast

from norton_sim.faults.schema import BiasJump, EncoderJump, FalseReading, Freeze, Saturation, SignFlip
from norton_sim.faults.stage import Stage, Undo
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
