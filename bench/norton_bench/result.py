"""The result of an experiment, whole, and what it says of one parameter or of what was expected of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from pathlib import Path

from norton_bench.errors import ExitCode, UsageError
from norton_bench.identification.ambiguity.conditions import Judgement
from norton_bench.identification.in_situ import InSituResult
from norton_bench.identification.ladder import Rung
from norton_bench.identification.model_error import ModelError
from norton_bench.identification.model_free.without_model import WithoutModel
from norton_bench.identification.residuals.diagnosis import ResidualTests
from norton_bench.identification.results import BlockedMap, FitResult, LiveEstimate, SourceMap, Validation
from norton_bench.identification.tables.exertion_table import ExertionTable
from norton_bench.identification.tables.modulation import ModulatorPlaces
from norton_bench.identification.tables.source_table import SourceTable
from norton_bench.identification.trials import TrialFigures
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import BY_NAME, HALF_INTERVAL, Estimate, Status
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.records import Measured
from norton_bench.rig.files import nearest
from norton_bench.units import Units, parse_quantity


@dataclass(frozen=True)
class ExpectationResult:
    """Something expected of a result: whether it came true, and the sentence that says so."""

    name: str
    met: bool
    sentence: str


NUMBERS = (Status.VALID, Status.UNEXCITED)


@dataclass(frozen=True)
class ParameterResult:
    """One parameter as far as it is known; ``value`` is NaN and ``interval`` infinite where nothing is.

    ``interval`` is half of the 95 % interval over the value; ``std`` is in ``unit``, as ``value`` is.
    """

    name: str
    unit: str
    value: float = nan
    std: float = inf
    status: Status = Status.UNEXCITED

    @property
    def interval(self) -> float:
        if self.status not in NUMBERS or not isfinite(self.std) or not self.value:
            return inf
        return HALF_INTERVAL * self.std / abs(self.value)

    def __str__(self) -> str:
        if not isfinite(self.value):
            return f"{self.name} is not known ({self.status.value})"
        return f"{self.name} = {self.value:.5g} ± {HALF_INTERVAL * self.std:.2g} {self.unit} ({self.status.value})"

    def is_within(self, tolerance: str, reference: str) -> ExpectationResult:
        """Whether the value is valid, and at most ``tolerance`` ("2 %", "1 mN*m") from ``reference``.

        Raises ValueError, in a sentence, for what is no quantity of the kind.
        """
        expected = parse_quantity(reference, self.unit)
        allowed = allowed_deviation(tolerance, expected, self.unit)
        away = abs(self.value - expected)
        met = self.status is Status.VALID and away <= allowed
        off = f", but {100 * away / abs(expected):.3g} % off" if expected and away > allowed else ""
        return ExpectationResult(
            self.name, met, f"{self}: {'is' if met else 'is not'} within {tolerance} of {reference}{off}"
        )

    def is_known_within(self, interval: str) -> ExpectationResult:
        """Whether it is valid and half of its 95 % interval is at most ``interval`` ("1 %") of the value.

        Raises ValueError, in a sentence, for what is no share.
        """
        met = self.status is Status.VALID and self.interval <= parse_quantity(interval, "")
        width = f"±{100 * self.interval:.2g} %" if isfinite(self.interval) else "without bounds"
        return ExpectationResult(
            self.name, met, f"{self}: its 95 % interval, {width}, {'is' if met else 'is not'} within ±{interval}"
        )


def allowed_deviation(tolerance: str, expected: float, unit: str) -> float:
    """``tolerance`` in ``unit``: a quantity of it, or a share of ``expected``. Raises ValueError, in a sentence."""
    try:
        return parse_quantity(tolerance, "") * abs(expected)
    except ValueError:
        return parse_quantity(tolerance, unit)


def parameter_result(estimates: tuple[Estimate, ...], name: str, command_unit: str) -> ParameterResult:
    """What ``estimates`` say of ``name``. Raises UsageError where there is no such parameter."""
    check_name(name)
    for estimate in estimates:
        if estimate.name == name:
            return ParameterResult(name, estimate.unit, float(estimate.value), float(estimate.std), estimate.status)
    return ParameterResult(name, BY_NAME[name].unit_for(command_unit))


def check_name(name: str) -> None:
    """Raises UsageError where there is no such parameter."""
    if name not in BY_NAME:
        raise UsageError(f'"{name}" is no parameter; {nearest(name, BY_NAME)}')


@dataclass(frozen=True)
class Result:
    """Everything that follows from one recording: what reports, tables, JSON and the screen are views of.

    A part is None, or empty, where the session measured nothing that could tell. ``metadata`` says where the data come
    from, by the names of the recording ("command_unit", "seed", "rig_file", ...); ``measured`` begins with what the
    session that it resumed has finished. ``knowledge`` is what the session's procedures knew at its end, None for a
    recording that is fitted again.
    """

    rig_name: str
    rig_text: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict)
    recording: Path | None = None
    measured: Measured | None = None
    live: Sequence[LiveEstimate | RecordedEstimates] = ()
    knowledge: Knowledge | None = None
    notes: Sequence[str] = ()
    fit: FitResult | None = None
    validation: Validation | None = None
    model_error: ModelError | None = None
    source_map: SourceMap | None = None
    blocked_map: BlockedMap | None = None
    source: SourceTable | None = None
    exertion: ExertionTable | None = None
    modulator: ModulatorPlaces | None = None
    without_model: WithoutModel | None = None
    residuals: ResidualTests | None = None
    conditions: Sequence[Judgement] = ()
    ladder: Sequence[Rung] = ()
    trials: Sequence[TrialFigures] = ()
    in_situ: InSituResult | None = None
    expectations: Sequence[ExpectationResult] = ()
    network_file: Path | None = None
    report_file: Path | None = None
    motion_file: Path | None = None  # the motion source identified in situ, as CSV

    @property
    def command_unit(self) -> str:
        return self.metadata.get("command_unit", "")

    @property
    def units(self) -> Units:
        return Units(self.command_unit, self.metadata.get("modulation_unit", ""))

    @property
    def network(self) -> NortonNetwork | None:
        return self.fit.network if self.fit is not None else None

    @property
    def empty(self) -> bool:
        """Whether nothing was identified: neither parameters nor tables, nor a source in situ."""
        parts = (self.fit, self.source_map, self.blocked_map, self.source, self.exertion, self.in_situ)
        return all(part is None for part in parts)

    @property
    def shortcoming(self) -> str:
        """Why it is a failure: an expectation that was not met, or a fit that is no result. Empty where it is none."""
        missed = sum(not each.met for each in self.expectations)
        if missed:
            return f"{missed} of {len(self.expectations)} expectations were not met"
        return self.fit.shortcoming if self.fit is not None else ""

    @property
    def exit_code(self) -> ExitCode:
        return ExitCode.EXPERIMENT_FAILED if self.shortcoming else ExitCode.OK

    def parameter(self, name: str) -> ParameterResult:
        """What the fit says of it, also where that is nothing. Raises UsageError for an unknown name."""
        return parameter_result(self.fit.estimates if self.fit is not None else (), name, self.command_unit)
