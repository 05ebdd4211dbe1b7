"""A few figures that follow from the network at once; ``norton-bench datasheet`` has them all."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan, nan, sqrt

from norton_bench.identification.results import FitResult
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Status
from norton_bench.report.section import Facts
from norton_bench.report.words import interval, number, pretty_unit, to_its_digits

HEAD = ("figure", "value", "95 % interval", "unit", "meaning")
# A ratio is known where both its parts are, be it up to a common factor.
KNOWN = (Status.VALID, Status.RATIO_ONLY)


@dataclass(frozen=True)
class _Ratio:
    """One figure: ``over`` / ``under``, two parameters of the table, in SI."""

    name: str
    over: str
    under: str
    unit: str
    use: str


_RATIOS = (
    _Ratio("breakaway command, either way", "coulomb_torque", "torque_gain", "{command}", "below it the shaft rests"),
    _Ratio(
        "free speed per command",
        "torque_gain",
        "viscous_damping",
        "rad/s/({command})",
        "slope of the motion source beyond breakaway",
    ),
    _Ratio("mechanical time constant", "inertia", "viscous_damping", "s", "how fast a sliding, free shaft settles"),
    _Ratio(
        "deflection before sliding",
        "coulomb_torque",
        "presliding_stiffness",
        "rad",
        "smaller motions are elastic rather than frictional",
    ),
)


def derived_facts(fit: FitResult, command_unit: str) -> Facts | None:
    """A row for each figure whose parameters are known; None where there is none."""
    known = {each.name: each.value for each in fit.estimates if each.status in KNOWN}
    rows = tuple(
        _row(ratio, known, fit.network, command_unit)
        for ratio in _RATIOS
        if ratio.over in known and known.get(ratio.under)
    )
    return Facts(HEAD, rows) if rows else None


def _row(ratio: _Ratio, known: Mapping[str, float], network: NortonNetwork, command_unit: str) -> tuple[str, ...]:
    value = abs(known[ratio.over] / known[ratio.under])
    std = value * _relative_std(ratio, known, network)
    unit = pretty_unit(ratio.unit.format(command=command_unit or "N*m"))
    shown = number(value, 4) if isnan(std) else to_its_digits(value, std)
    return ratio.name, shown, interval(value, std), unit, ratio.use


def _relative_std(ratio: _Ratio, known: Mapping[str, float], network: NortonNetwork) -> float:
    """Of the quotient, to first order, from the network's covariance; NaN where that is not known."""
    names = network.covariance_names
    if ratio.over not in names or ratio.under not in names:
        return nan
    over, under = names.index(ratio.over), names.index(ratio.under)
    a, b, covariance = known[ratio.over], known[ratio.under], network.covariance
    spread = covariance[over][over] / a**2 + covariance[under][under] / b**2 - 2 * covariance[over][under] / (a * b)
    return sqrt(max(spread, 0.0))
