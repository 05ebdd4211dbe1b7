"""What follows from a recording: the fit, its validation, the maps, the network file and the report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.identification.cleaning import Cleaned, clean
from norton_bench.identification.conditions import Condition, conditions, evidence_of
from norton_bench.identification.exertion_table import ExertionTable, exertion_table
from norton_bench.identification.in_situ import InSituResult, in_situ_result
from norton_bench.identification.judged_fit import beyond_bounds, fit_judged, with_what_moved
from norton_bench.identification.ladder import Rung, bench_ladder
from norton_bench.identification.model_error import ModelError, of_ladder
from norton_bench.identification.modulation import ModulatorPlaces, modulator_places
from norton_bench.identification.residual_tests import ResidualTests, diagnose
from norton_bench.identification.results import BlockedMap, FitResult, LiveEstimate, SourceMap, Validation
from norton_bench.identification.source_map import PortTorque, blocked_map, source_map
from norton_bench.identification.source_table import SourceTable, source_table
from norton_bench.identification.table_conditions import tabulated_conditions
from norton_bench.identification.trials import TrialFigures, trials
from norton_bench.identification.validation import validate_signals
from norton_bench.identification.without_model import WithoutModel, without_model
from norton_bench.models.network import STATUS
from norton_bench.models.parameters import Estimate, Status
from norton_bench.procedures.iterate import IterateProcedure
from norton_bench.recording.contents import RecordedEstimates, Recording
from norton_bench.recording.reader import read_recording
from norton_bench.records import Measured
from norton_bench.report.data import ReportData
from norton_bench.report.words import NO_UNITS, Units
from norton_bench.rig.rig import NO_MODEL
from norton_bench.segments import Use
from norton_bench.session.past import with_past

Part = TypeVar("Part")
Result = TypeVar("Result")

ITERATED = IterateProcedure.name
# What is told while it goes on: it takes seconds, most of them the first of these.
PARAMETERS = "final fit 1/4: parameters"
FRICTION = "final fit 2/4: friction models"
UNSEEN = "final fit 3/4: unseen motion"
REPORT = "final fit 4/4: report"
REPORT_ALONE = "writing the report"
Tell = Callable[[str], None]
# What a recording must say of its making to be fitted.
NEEDED = ("rig", "command_unit", "tick_s")


@dataclass(frozen=True)
class Conclusion:
    """None where the session measured nothing that could tell. ``units`` are those of the tables."""

    fit: FitResult | None = None
    validation: Validation | None = None
    model_error: ModelError | None = None
    source_map: SourceMap | None = None
    blocked_map: BlockedMap | None = None
    without_model: WithoutModel | None = None
    residuals: ResidualTests | None = None
    conditions: tuple[Condition, ...] = ()
    ladder: tuple[Rung, ...] = ()
    trials: tuple[TrialFigures, ...] = ()
    in_situ: InSituResult | None = None
    motion_file: Path | None = None  # the motion source found in situ, as CSV
    network: Path | None = None
    report: Path | None = None
    source: SourceTable | None = None
    exertion: ExertionTable | None = None
    modulator: ModulatorPlaces | None = None
    units: Units = NO_UNITS

    @property
    def empty(self) -> bool:
        """Whether nothing was identified: neither parameters nor tables, nor a source in situ."""
        told = (self.fit, self.source_map, self.blocked_map, self.source, self.exertion, self.in_situ)
        return all(part is None for part in told)


def _untold(_line: str) -> None:
    """Nobody waits to be told."""


def conclude(
    measured: Measured,
    *,
    rig_text: str,
    metadata: Mapping[str, str],
    live: Sequence[LiveEstimate | RecordedEstimates],
    recording: Path,
    out: Path,
    notes: Sequence[str] = (),
    tell: Tell = _untold,
) -> Conclusion:
    """Fit, validate and report what ``measured`` holds, into the folder ``out``; ``notes`` go into the report.

    ``tell`` is called with a line when each part of it begins.
    """
    uses = {segment.use for segment in measured.segments}
    in_situ = _where_measured(partial(in_situ_result, tick_s=float(metadata["tick_s"])), measured)
    if Use.IDENTIFY not in uses and in_situ is None:
        return Conclusion()
    about = {**metadata, "recording": recording.name}
    units = Units(metadata["command_unit"], metadata.get("modulation_unit", ""))
    found = Conclusion(in_situ=in_situ, units=units)
    if in_situ is not None:
        found = replace(found, motion_file=_source_saved(in_situ, out / f"{recording.stem}.source.csv"))
    if Use.IDENTIFY in uses:
        learnt = live[-1].estimates if live else ()
        found = _identified(found, measured, about, out / f"{recording.stem}.network.json", learnt, tell)
    tell(REPORT_ALONE if found.fit is None else REPORT)
    page = ReportData(
        rig_name=metadata["rig"],
        rig_text=rig_text,
        metadata=about,
        fit=found.fit,
        validation=found.validation,
        model_error=found.model_error,
        source_map=found.source_map,
        blocked_map=found.blocked_map,
        source=found.source,
        exertion=found.exertion,
        modulator=found.modulator,
        without_model=found.without_model,
        residuals=found.residuals,
        conditions=found.conditions,
        ladder=found.ladder,
        trials=found.trials,
        in_situ=found.in_situ,
        live=tuple(live),
        measured=measured,
        notes=notes,
    )
    from norton_bench.report.render import write_report  # noqa: PLC0415  (half a second that a session would begin later)

    return replace(found, report=write_report(out / f"{recording.stem}.report.html", page))


def _identified(
    found: Conclusion,
    measured: Measured,
    metadata: Mapping[str, str],
    network: Path,
    learnt: Sequence[Estimate],
    tell: Tell,
) -> Conclusion:
    """What needs no model, and the motor where the actuator is one."""
    tick_s, cleaned = float(metadata["tick_s"]), clean(measured)
    told = cleaned.measured
    found = replace(
        found,
        blocked_map=_where_measured(blocked_map, told),
        source=_where_measured(source_table, told),
        exertion=_where_measured(partial(exertion_table, tick_s=tick_s), told),
        modulator=_where_measured(modulator_places, told),
        trials=trials(measured, tick_s, ITERATED),
    )
    if metadata.get("model") == NO_MODEL:
        judged = tabulated_conditions(found.source, found.exertion)
        return replace(found, source_map=_where_measured(source_map, told), conditions=judged)
    return _fitted(found, cleaned, metadata, network, learnt, tell)


def _fitted(
    found: Conclusion,
    cleaned: Cleaned,
    metadata: Mapping[str, str],
    network: Path,
    learnt: Sequence[Estimate],
    tell: Tell,
) -> Conclusion:
    """The motor's parameters, and what checks them; ``learnt`` are the live values at the end."""
    tick_s, segments = float(metadata["tick_s"]), cleaned.measured.segments
    tell(PARAMETERS)
    fit = fit_judged(cleaned, command_unit=metadata["command_unit"], tick_s=tick_s)
    stretches, unseen, error = fit.stretches, fit.unseen, fit.error
    tell(FRICTION)
    result, rungs = with_what_moved(fit.result, fit.fitted, learnt), bench_ladder(stretches, fit.fitted)
    if error is not None and (error.departures or error.unexplained):
        result = replace(result, verdict=(*result.verdict, *of_ladder(rungs)))
    tell(UNSEEN)
    zero = None if fit.at is None else fit.at.zero
    checked = _where_measured(partial(validate_signals, result, unseen, zero=zero), segments) if unseen else None
    modelless = without_model(result, stretches, unseen, segments)
    table = None if modelless is None else modelless.table
    port = PortTorque.of(result, table, stretches[0].origin_ns)
    static = _where_measured(partial(source_map, port=port), cleaned.measured)
    evidence = evidence_of(result, stretches, cleaned.measured, validation=checked, modelless=modelless, source=static)
    return replace(
        found,
        fit=result,
        source_map=static,
        validation=checked,
        model_error=error,
        without_model=modelless,
        residuals=diagnose(result, stretches),
        conditions=conditions(evidence),
        ladder=rungs,
        network=_saved(result, network, metadata),
    )


def _where_measured(result_of: Callable[[Part], Result], measured: Part) -> Result | None:
    """None where the session had no such part, or nothing of it can be cleaned."""
    try:
        return result_of(measured)
    except ExperimentError:
        return None


def _saved(result: FitResult, path: Path, provenance: Mapping[str, str]) -> Path | None:
    """The network file; none where the data contradict themselves, or no machine has such values: a file is used
    without its verdict."""
    if all(estimate.status is Status.DOUBTFUL for estimate in result.estimates) or beyond_bounds(result.network):
        return None
    not_valid = [each for each in result.estimates if each.status is not Status.VALID]
    status = "; ".join(f"{each.name}={each.status.value}" for each in not_valid)
    result.network.with_provenance({**provenance, **({STATUS: status} if status else {})}).save(path)
    return path


def _source_saved(found: InSituResult, path: Path) -> Path | None:
    """The motion source, tick by tick; none where the experiment did not come so far."""
    source = found.source
    if source is None:
        return None
    time_s = np.arange(len(source.command)) * source.tick_s
    table = np.column_stack([time_s, source.command, source.position_rad, source.velocity_rad_s])
    np.savetxt(path, table, "%.9g", ",", header="time_s,command,position_rad,velocity_rad_s", comments="")
    return path


def check_metadata(path: Path, metadata: Mapping[str, str]) -> None:
    """Raises UsageError where they lack what a fit needs."""
    for key in NEEDED:
        if key not in metadata:
            raise UsageError(f"{path}: its metadata lack '{key}'; it was not recorded by norton-bench")


def conclude_recording(path: Path, out: Path | None = None, tell: Tell = _untold) -> tuple[Recording, Conclusion]:
    """The same, from a recording alone. Raises UsageError for a file that cannot be read or holds nothing to fit."""
    recording = read_recording(path, raw_frames=False)
    check_metadata(path, recording.metadata)
    conclusion = conclude(
        with_past(path, recording),
        rig_text=recording.rig_text,
        metadata=recording.metadata,
        live=recording.live,
        recording=path,
        out=out if out is not None else path.parent,
        tell=tell,
    )
    if conclusion.empty:
        raise UsageError(f"{path}: holds no segment made for identification; record one with 'free' or 'imposed'")
    return recording, conclusion
