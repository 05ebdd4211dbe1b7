"""The sheet on one network, with its recording or without, and two sheets side by side."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, isfinite

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.datasheet.evidence import Evidence, evidence
from norton_bench.errors import BenchError, UsageError
from norton_bench.identification.statistics import tail_of_each
from norton_bench.models.derived import Figure, Interval, OperatingPoint, derived, interval_of, seen_to
from norton_bench.models.drawn_motor import MEAN_TERMS, has_covariance
from norton_bench.models.network import PARAMETER_OF_FIELD, NortonNetwork, told_deviations, told_statuses
from norton_bench.models.parameters import BY_NAME, Status
from norton_bench.models.terms import Factor, NetworkTerm, factors_of
from norton_bench.networks.family import Network
from norton_bench.report.words import number, pretty_unit
from norton_bench.result import Result
from norton_bench.rig.load import parse_rig

LEVEL = 1.96  # deviations, of 95 %
MEASURED, ALLOWED = "as measured", "rig's limits"
# Two spans this near to each other are one.
SAME = 0.01


@dataclass(frozen=True)
class SheetValue:
    """One parameter; ``std`` is NaN where nothing is told of it, ``status`` None where a network does not tell it."""

    name: str
    value: float
    std: float
    unit: str
    status: Status | None = None

    @property
    def settled(self) -> bool:
        return self.status in (None, Status.VALID, Status.LEARNING)

    @property
    def interval(self) -> Interval:
        return self.value - LEVEL * self.std, self.value + LEVEL * self.std

    @property
    def shown(self) -> float:
        """NaN for what the data say nothing of."""
        return float("nan") if self.status is Status.UNEXCITED else self.value


@dataclass(frozen=True)
class Sheet:
    """``name`` is the rig's, ``file`` where all of it comes from. ``told`` says what the data leave open.

    ``limits`` are command and velocity that the rig allows, None where no rig is known. ``recorded``: there is a
    recording, so that what is missing in ``evidence`` was not measured.
    """

    name: str
    file: str
    network: NortonNetwork
    parameters: tuple[SheetValue, ...]
    limits: OperatingPoint | None = None
    told: tuple[str, ...] = ()
    evidence: Evidence = field(default_factory=Evidence)
    recorded: bool = False
    origin: str = ""  # when and on what it was measured
    seed: int = 1  # of the draws: two sheets that are compared have different ones

    @property
    def points(self) -> tuple[OperatingPoint, ...]:
        """How far the network was seen to hold, and how far the rig may go where that is another."""
        seen = OperatingPoint(MEASURED, seen_to(self.network, "command"), seen_to(self.network, "velocity"))
        known = (seen,) if isfinite(seen.command) and isfinite(seen.velocity_rad_s) else ()
        if self.limits is None or (known and abs(self.limits.command - seen.command) < SAME * seen.command):
            return known
        return (*known, self.limits)

    def figures(self, points: Sequence[OperatingPoint] | None = None) -> tuple[Figure, ...]:
        """Every derived figure, at the sheet's own operating points or at others."""
        statuses = {each.name: each.status for each in self.parameters if each.status is not None}
        chosen = self.points if points is None else tuple(points)
        return derived(self.network, chosen, statuses=statuses or None, seed=self.seed)


@dataclass(frozen=True)
class Difference:
    """The second figure less the first; the interval is that of independent draws.

    ``tail`` is the chance on either side of the interval that must not hold zero where they differ.
    """

    first: Figure
    second: Figure
    tail: float

    @property
    def value(self) -> float:
        return self.second.value - self.first.value

    @property
    def interval(self) -> Interval:
        return interval_of(self._draws)

    @property
    def significant(self) -> bool:
        """Whether it is more than chance makes of so many comparisons."""
        low, high = interval_of(self._draws, self.tail)
        return self.first.settled and self.second.settled and not low <= 0.0 <= high

    @property
    def _draws(self) -> FloatArray:
        with np.errstate(invalid="ignore"):
            return np.nan_to_num(self.second.draws - self.first.draws, nan=0.0)


def sheet_of_network(network: Network, file: str) -> Sheet:
    """What follows from the parameters alone. Raises UsageError for another kind of network, or without covariance."""
    if not isinstance(network, NortonNetwork):
        raise UsageError(f"{file}: is no identified motor, from whose parameters a sheet follows; see `network show`")
    if network.servo is not None:
        raise UsageError(f"{file}: is a servo; a data sheet is for a motor commanded by torque, see `network show`")
    if not has_covariance(network):
        raise UsageError(f"{file}: has no covariance, so that no interval follows; fit its recording again")
    std = told_deviations(network)
    told = {name: Status(word) for name, word in told_statuses(network.provenance).items()}
    parameters = tuple(
        SheetValue(
            name, value, float(std.get(name, np.nan)), BY_NAME[name].unit_for(network.command_unit), told.get(name)
        )
        for attribute, name in PARAMETER_OF_FIELD.items()
        if (value := getattr(network, attribute)) is not None
    )
    parameters += tuple(
        SheetValue(each.name, value, float(std[each.name]), each.unit_for(network.command_unit))
        for term in factors_of(network.terms)
        for each, value in zip(term.term.parameters, term.values, strict=True)
        if each.name in std
    )
    scale = (network.provenance["scale"],) if "scale" in network.provenance else ()
    name, origin = network.provenance.get("rig", file), _origin(network.provenance)
    told_of_it = (*scale, *_without_interval(parameters), *_terms(network))
    return Sheet(name, file, network, parameters, told=told_of_it, origin=origin)


def _without_interval(parameters: Sequence[SheetValue]) -> tuple[str, ...]:
    """A sentence on the values of which the file has no covariance, as of those that measured current adds."""
    bare = [each for each in parameters if not isfinite(each.std)]
    if not bare:
        return ()
    symbols = " and ".join(BY_NAME[each.name].symbol for each in bare)
    reason = "this file does not hold their covariance; the sheet of the recording has their intervals"
    return (f"No interval is given for {symbols}: {reason}.",)


def sheet_of_result(result: Result) -> Sheet:
    """The same with what the recording tells beside it: statuses, and points measured at the port. It must have a fit
    that has converged, and its measurements."""
    fit, about, measured = result.fit, result.metadata, result.measured
    assert fit is not None
    assert measured is not None
    file = str(result.recording)
    parameters = tuple(SheetValue(each.name, each.value, each.std, each.unit, each.status) for each in fit.estimates)
    points = evidence(fit, measured, result.residuals, float(about["tick_s"]))
    limits = _limits(result.rig_text, file)
    told = (*fit.verdict, *_terms(fit.network))
    return Sheet(
        about["rig"], file, fit.network, parameters, limits, told, points, recorded=True, origin=_origin(about)
    )


def _terms(network: NortonNetwork) -> tuple[str, ...]:
    """One sentence for each term: its values, and how the figures have it."""
    return tuple(
        f"{term.term.meaning[0].upper()}{term.term.meaning[1:]}{_values_of(term, network.command_unit)}; "
        + ("the figures hold this." if term.name in MEAN_TERMS else f"the figures are {_figures_of(term)}.")
        for term in network.terms
    )


def _values_of(term: NetworkTerm, command_unit: str) -> str:
    """Of a wave its amplitude: its two parameters depend on where the encoder's zero is."""
    if not term.term.periodic:
        return f" ({term.text(command_unit, unit=pretty_unit)})"
    amplitude = hypot(*term.values)
    is_torque = term.term.parameters[0].unit == "N*m"
    size = f"cogging of {number(1e3 * amplitude, 3)} mN·m" if is_torque else f"by {number(100 * amplitude, 3)} %"
    return f": {size}, {term.periods_per_turn:.4g} periods a turn"


def _figures_of(term: NetworkTerm) -> str:
    if term.term.factor is Factor.JOINT:
        return "those of the motor, without what is beyond the joint"
    if term.term.in_time:
        return "those in the middle of the session"
    return "the mean over a turn" if term.term.periodic else "the mean over both directions"


def _origin(about: Mapping[str, str]) -> str:
    """When it was measured (UTC), whether on a simulated bench, and with which devices."""
    started = about.get("started", "").replace("T", " ").partition("+")[0]
    return ", ".join(part for part in (started, about.get("backend", ""), about.get("devices", "")) if part)


def _limits(rig_text: str, place: str) -> OperatingPoint | None:
    """Of the rig that was recorded; None for a rig file that this program does not read."""
    try:
        rig = parse_rig(rig_text, place=place)
    except BenchError:
        return None
    return OperatingPoint(ALLOWED, rig.command.limit, rig.limits.velocity_rad_s)


def compared(first: Sheet, second: Sheet) -> tuple[Difference, ...]:
    """Figures that both have, at operating points that both reach: the lesser of the two, under its own name."""
    alike = first.network.command_unit == second.network.command_unit
    points = _common(first.points, second.points) if alike else ()
    others = {figure.key: figure for figure in replace(second, seed=first.seed + 1).figures(points)}
    pairs = [
        (figure, others[figure.key])
        for figure in first.figures(points)
        if figure.key in others and figure.unit == others[figure.key].unit
    ]
    return tuple(Difference(*pair, tail_of_each(len(pairs))) for pair in pairs)


def _common(first: Sequence[OperatingPoint], second: Sequence[OperatingPoint]) -> tuple[OperatingPoint, ...]:
    other = {point.name: point for point in second}
    return tuple(
        OperatingPoint(
            point.name,
            min(point.command, other[point.name].command),
            min(point.velocity_rad_s, other[point.name].velocity_rad_s),
        )
        for point in first
        if point.name in other
    )
