"""What a report is made of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from norton_bench.identification.conditions import Condition
from norton_bench.identification.exertion_table import ExertionTable
from norton_bench.identification.in_situ import InSituResult
from norton_bench.identification.ladder import Rung
from norton_bench.identification.model_error import ModelError
from norton_bench.identification.modulation import ModulatorPlaces
from norton_bench.identification.residual_tests import ResidualTests
from norton_bench.identification.results import BlockedMap, FitResult, LiveEstimate, SourceMap, Validation
from norton_bench.identification.source_table import SourceTable
from norton_bench.identification.trials import TrialFigures
from norton_bench.identification.without_model import WithoutModel
from norton_bench.models.network import NortonNetwork
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.records import Measured
from norton_bench.report.words import Units


@dataclass(frozen=True)
class ReportData:
    """Everything a report may show; a part that is missing leaves its section out.

    ``metadata`` tells where the data come from (names as in the recording: "command_unit", "seed", "rig_file", ...).
    """

    rig_name: str
    rig_text: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict)
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
    conditions: Sequence[Condition] = ()
    ladder: Sequence[Rung] = ()
    trials: Sequence[TrialFigures] = ()
    in_situ: InSituResult | None = None
    live: Sequence[LiveEstimate | RecordedEstimates] = ()
    measured: Measured | None = None
    notes: Sequence[str] = ()

    @property
    def command_unit(self) -> str:
        return self.metadata.get("command_unit", "")

    @property
    def units(self) -> Units:
        return Units(self.command_unit, self.metadata.get("modulation_unit", ""))

    @property
    def network(self) -> NortonNetwork | None:
        return self.fit.network if self.fit is not None else None
