"""Which plausibility checks a rig gets: those whose signals it has."""

from collections.abc import Collection
from dataclasses import dataclass
from math import inf, isfinite

from bench.guard.balance import TorqueBalance
from bench.guard.check import Check
from bench.guard.coupling import Coupling
from bench.guard.current import CurrentAgreement
from bench.guard.encoder import EncoderAgreement
from bench.guard.frozen import FrozenTorque
from bench.guard.jump import TorqueJump
from bench.guard.saturation import Saturation
from bench.guard.standstill import Standstill
from bench.rig.rig import Command, Limits
from bench.units import conversion, same_dimension


@dataclass(frozen=True)
class Fitted:
    """What is on the bench. ``shaft_free``: without a load, the shaft can turn. Resolutions are 0 where unknown."""

    load: bool
    torque_sensor: bool
    shaft_free: bool = False
    range_nm: float = inf
    resolution_rad: float = 0.0
    load_resolution_rad: float = 0.0


def checks_for(
    limits: Limits, command: Command, tick_s: float, fitted: Fitted, leave_out: Collection[str] = ()
) -> tuple[Check, ...]:
    """In the order in which they are asked: what tells the cause before what tells the effect."""
    checks: list[Check] = [EncoderAgreement("actuator encoder", fitted.resolution_rad)]
    if fitted.load:
        checks.append(EncoderAgreement("load encoder", fitted.load_resolution_rad))
        resolution_rad = fitted.resolution_rad + fitted.load_resolution_rad
        checks.append(Coupling(limits.twist_rad, limits.torque_nm, resolution_rad, tick_s))
    if fitted.shaft_free and not fitted.load:
        checks.append(Standstill(command.unit))
    checks += _of_current(limits, command, fitted)
    if fitted.torque_sensor:
        checks += [FrozenTorque(), TorqueJump(limits.torque_nm, tick_s)]
    if isfinite(fitted.range_nm):
        checks.append(Saturation(fitted.range_nm))
    if fitted.load and fitted.torque_sensor:
        checks.append(TorqueBalance(limits.torque_nm))
    return tuple(check for check in checks if check.name not in leave_out)


def _of_current(limits: Limits, command: Command, fitted: Fitted) -> list[Check]:
    """None for a command that is no current and no torque: how much current it makes depends on the speed."""
    checks: list[Check] = []
    if same_dimension(command.unit, "A"):
        checks.append(CurrentAgreement("actuator", command.limit, command.unit, conversion(command.unit, "A")[0]))
    elif same_dimension(command.unit, "N*m"):
        checks.append(CurrentAgreement("actuator", command.limit, command.unit))
    if fitted.load:
        checks.append(CurrentAgreement("load", min(limits.load_torque_nm, limits.torque_nm), "N*m"))
    return checks
