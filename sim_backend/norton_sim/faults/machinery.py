"""Faults of drives, mechanics and the host."""

from typing import cast

from norton_sim.faults.schema import (
    BrokenCoupling,
    DriveError,
    HostStall,
    OverTemperature,
    Runaway,
    Stuck,
    Undervoltage,
)
from norton_sim.faults.stage import Stage, Undo
from norton_sim.firmware.site import DriveFault
from norton_sim.plant import Machine

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
