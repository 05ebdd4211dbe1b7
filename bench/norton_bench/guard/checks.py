"""Which plausibility checks a rig gets: those whose signals it has."""

from collections.abc import Collection
from dataclasses import dataclass
from math import inf, isfinite

from norton_bench.guard.check import Check
from norton_bench.guard.drive_checks import CurrentAgreement, StuckModulator
from norton_bench.guard.motion_checks import Coupling, EncoderAgreement, HeldShaft, Standstill
from norton_bench.guard.torque_checks import FrozenTorque, Saturation, TorqueBalance, TorqueJump
from norton_bench.rig.rig import Command, Limits
from norton_bench.units import conversion, same_dimension


@dataclass(frozen=True)
class Fitted:
    """What is on the bench. Resolutions are 0 where unknown.

    ``runs``: without a load, a command beyond friction makes the shaft turn on and on.
    """

    load: bool
    torque_sensor: bool
    runs: bool = False
    range_nm: float = inf
    resolution_rad: float = 0.0
    load_resolution_rad: float = 0.0
    modulation: Command | None = None  # of a second drive
    modulator_resolution_rad: float = 0.0


def checks_for(
    limits: Limits, command: Command, tick_s: float, fitted: Fitted, leave_out: Collection[str] = ()
) -> tuple[Check, ...]:
    """In the order in which they are asked: what tells the cause before what tells the effect."""
    checks: list[Check] = [EncoderAgreement("actuator encoder", fitted.resolution_rad)]
    if fitted.load:
        checks.append(EncoderAgreement("load encoder", fitted.load_resolution_rad))
        resolution_rad = fitted.resolution_rad + fitted.load_resolution_rad
        checks.append(Coupling(limits.twist_rad, limits.torque_nm, resolution_rad, tick_s))
    modulation = fitted.modulation
    if modulation is not None:
        checks.append(StuckModulator(modulation.limit, modulation.unit, fitted.modulator_resolution_rad))
    if fitted.runs and not fitted.load:
        checks.append(Standstill(command.unit))
    checks += _of_current(limits, command, fitted)
    if fitted.torque_sensor:
        checks += [FrozenTorque(), TorqueJump(limits.torque_nm, tick_s)]
    if isfinite(fitted.range_nm):
        checks.append(Saturation(fitted.range_nm))
    if fitted.load and fitted.torque_sensor:
        checks.append(TorqueBalance(limits.torque_nm))
        if fitted.resolution_rad > 0.0:
            checks.append(HeldShaft(limits.torque_nm, fitted.resolution_rad))
    return tuple(check for check in checks if check.name not in leave_out)


def _of_current(limits: Limits, command: Command, fitted: Fitted) -> list[Check]:
    """None for a drive that takes no current and no torque: how much current it makes depends on the speed."""
    checks: list[Check] = []
    taken_as = command.unit if command.sent_as is None else command.sent_as
    if same_dimension(taken_as, "A"):
        checks.append(CurrentAgreement("actuator", command.limit, command.unit, conversion(taken_as, "A")[0]))
    elif same_dimension(taken_as, "N*m"):
        checks.append(CurrentAgreement("actuator", command.limit, command.unit))
    if fitted.load:
        checks.append(CurrentAgreement("load", min(limits.load_torque_nm, limits.torque_nm), "N*m"))
    return checks
