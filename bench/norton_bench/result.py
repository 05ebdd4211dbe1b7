"""The result of an experiment: reports, tables, JSON, the test plug-in and the last event are views of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from norton_bench.errors import ExitCode
from norton_bench.models.parameter_result import ExpectationResult, ParameterResult, parameter_result
from norton_bench.units import Units

if TYPE_CHECKING:  # what produces them is slow to import
    from norton_bench.identification.conditions import Condition
    from norton_bench.identification.exertion_table import ExertionTable
    from norton_bench.identification.in_situ import InSituResult
    from norton_bench.identification.ladder import Rung
    from norton_bench.identification.model_error import ModelError
    from norton_bench.identification.modulation import ModulatorPlaces
    from norton_bench.identification.rendered import Rendered
    from norton_bench.identification.residual_tests import ResidualTests
    from norton_bench.identification.results import BlockedMap, FitResult, LiveEstimate, SourceMap, Validation
    from norton_bench.identification.source_table import SourceTable
    from norton_bench.identification.trials import TrialFigures
    from norton_bench.identification.without_model import WithoutModel
    from norton_bench.models.network import NortonNetwork
    from norton_bench.procedures.knowledge import Knowledge
    from norton_bench.recording.contents import RecordedEstimates
    from norton_bench.records import Measured


@dataclass(frozen=True)
class Result:
    """Everything that follows from one recording.

    A part is None, or empty, where the session has no data for it. ``metadata`` says where the data come
    from, by the names of the recording ("command_unit", "seed", "rig_file", ...); ``measured`` begins with what the
    session that it resumed has finished. ``knowledge`` is what the session's procedures knew at its end, None for a
    recording that is fitted again.
    """

    rig_name: str
    rig_text: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict)
    recording: Path | None = None
    measured: "Measured | None" = None
    live: "Sequence[LiveEstimate | RecordedEstimates]" = ()
    knowledge: "Knowledge | None" = None
    notes: Sequence[str] = ()
    fit: "FitResult | None" = None
    validation: "Validation | None" = None
    model_error: "ModelError | None" = None
    source_map: "SourceMap | None" = None
    blocked_map: "BlockedMap | None" = None
    source: "SourceTable | None" = None
    exertion: "ExertionTable | None" = None
    modulator: "ModulatorPlaces | None" = None
    without_model: "WithoutModel | None" = None
    residuals: "ResidualTests | None" = None
    conditions: "Sequence[Condition]" = ()
    ladder: "Sequence[Rung]" = ()
    trials: "Sequence[TrialFigures]" = ()
    rendered: "Sequence[Rendered]" = ()
    in_situ: "InSituResult | None" = None
    expectations: Sequence[ExpectationResult] = ()
    network_file: Path | None = None
    report_file: Path | None = None
    motion_file: Path | None = None  # the motion source measured in situ, as CSV

    @property
    def command_unit(self) -> str:
        return self.metadata.get("command_unit", "")

    @property
    def units(self) -> Units:
        return Units(self.command_unit, self.metadata.get("modulation_unit", ""))

    @property
    def network(self) -> "NortonNetwork | None":
        return self.fit.network if self.fit is not None else None

    @property
    def tabulated(self) -> bool:
        """Whether it has tables of source or impedance, or the positions of a modulator."""
        return any(part is not None for part in (self.source, self.exertion, self.modulator))

    @property
    def has_sentences(self) -> bool:
        """Whether it has what is told in sentences: the trials of a repeated movement, or laws that were rendered."""
        return bool(self.trials) or bool(self.rendered) or self.in_situ is not None

    @property
    def empty(self) -> bool:
        """Whether nothing was identified: no parameters, no tables, no source in situ."""
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
