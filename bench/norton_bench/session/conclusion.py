"""From a recording to its result (fit, validation, tables, files), and to the last event of its session."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from norton_bench.errors import ExperimentError, UsageError, exit_code_of, sentence_of
from norton_bench.events import Ended
from norton_bench.identification.cleaning import Cleaned, clean
from norton_bench.identification.conditions import Condition, conditions, evidence_of
from norton_bench.identification.judged_fit import beyond_bounds, fit_judged, with_what_moved
from norton_bench.identification.ladder import bench_ladder
from norton_bench.identification.model_error import of_ladder
from norton_bench.identification.residual_tests import diagnose
from norton_bench.identification.results import FitResult, LiveEstimate
from norton_bench.identification.servo_conditions import servo_conditions
from norton_bench.identification.source_map import PortTorque, blocked_map, source_map
from norton_bench.identification.validation import validate_signals
from norton_bench.identification.without_model import without_model
from norton_bench.models.network import CONDITIONS, DEVIATION, STATUS
from norton_bench.models.parameters import Status
from norton_bench.on_demand import deferred
from norton_bench.recording.contents import RecordedEstimates
from norton_bench.recording.reader import read_recording
from norton_bench.records import Measured
from norton_bench.result import Result
from norton_bench.rig.rig import NO_MODEL
from norton_bench.segments import RENDER, Use
from norton_bench.session.resume import with_earlier

if TYPE_CHECKING:
    from norton_bench.identification.in_situ import InSituResult

Part = TypeVar("Part")
Value = TypeVar("Value")

# Of steps that few sessions have.
source_table = deferred("norton_bench.identification.source_table:source_table")
exertion_table = deferred("norton_bench.identification.exertion_table:exertion_table")
modulator_places = deferred("norton_bench.identification.modulation:modulator_places")
tabulated_conditions = deferred("norton_bench.identification.table_conditions:tabulated_conditions")
trials = deferred("norton_bench.identification.trials:trials")
rendered = deferred("norton_bench.identification.rendered:rendered")
in_situ_result = deferred("norton_bench.identification.in_situ:in_situ_result")
in_sentences = deferred("norton_bench.report.facts_tables:in_sentences")
tabulated = deferred("norton_bench.report.facts_tables:tabulated")
ITERATED = "iterate_zero_torque"
VERDICT = "verdict"  # in the provenance of a network
# Reported while it goes on: it takes seconds, most of them for the parameters.
PARAMETERS = "final fit 1/4: parameters"
FRICTION = "final fit 2/4: friction models"
UNSEEN = "final fit 3/4: unseen motion"
REPORT = "final fit 4/4: report"
REPORT_ALONE = "writing the report"
OnStage = Callable[[str], None]
# The metadata that a fit needs.
NEEDED = ("rig", "command_unit", "tick_s")


def _unreported(_line: str) -> None:
    """Report nothing."""


def conclude(
    measured: Measured,
    *,
    rig_text: str,
    metadata: Mapping[str, str],
    live: Sequence[LiveEstimate | RecordedEstimates],
    recording: Path,
    out: Path,
    notes: Sequence[str] = (),
    on_stage: OnStage = _unreported,
) -> Result:
    """Fit, validate and report what ``measured`` holds, into the folder ``out``; ``notes`` go into the report.

    ``on_stage`` is called with a line when each part of it begins.
    """
    uses = {segment.use for segment in measured.segments}
    result = Result(
        metadata["rig"],
        rig_text,
        {**metadata, "recording": recording.name},
        recording,
        measured,
        live=tuple(live),
        notes=notes,
        in_situ=_of_step("in_situ", partial(in_situ_result, tick_s=float(metadata["tick_s"])), measured),
        rendered=rendered(measured, float(metadata["tick_s"])) if _had(RENDER, measured) else (),
    )
    if Use.IDENTIFY not in uses and result.in_situ is None and not result.rendered:
        return result
    if result.in_situ is not None:
        result = replace(result, motion_file=_source_saved(result.in_situ, out / f"{recording.stem}.source.csv"))
    if Use.IDENTIFY in uses:
        result = _identified(result, measured, out / f"{recording.stem}.network.json", on_stage)
    on_stage(REPORT_ALONE if result.fit is None else REPORT)
    from norton_bench.report.render import write_report  # noqa: PLC0415  (half a second that a session would begin later)

    return replace(result, report_file=write_report(out / f"{recording.stem}.report.html", result))


def _identified(result: Result, measured: Measured, network_file: Path, on_stage: OnStage) -> Result:
    """Add the tables, which need no model, and for a motor the fit of its parameters."""
    tick_s, data = float(result.metadata["tick_s"]), clean(measured)
    cleaned = data.measured
    result = replace(
        result,
        blocked_map=_where_measured(blocked_map, cleaned),
        source=_of_step("tabulate_source", source_table, cleaned),
        exertion=_of_step("tabulate_impedance", partial(exertion_table, tick_s=tick_s), cleaned),
        modulator=_where_measured(modulator_places, cleaned) if len(cleaned.modulator_motion) else None,
        trials=trials(measured, tick_s, ITERATED) if _had(ITERATED, measured) else (),
    )
    if result.metadata.get("model") == NO_MODEL:
        verdicts = tabulated_conditions(result.source, result.exertion)
        return replace(result, source_map=_where_measured(source_map, cleaned), conditions=verdicts)
    return _fitted(result, data, network_file, on_stage)


def _fitted(so_far: Result, data: Cleaned, network_file: Path, on_stage: OnStage) -> Result:
    """Add the motor's parameters, and the tests of the fit."""
    tick_s, segments = float(so_far.metadata["tick_s"]), data.measured.segments
    learnt = so_far.live[-1].estimates if so_far.live else ()
    on_stage(PARAMETERS)
    fit = fit_judged(data, command_unit=so_far.command_unit, tick_s=tick_s)
    stretches, unseen, error = fit.stretches, fit.unseen, fit.error
    on_stage(FRICTION)
    result, rungs = with_what_moved(fit.result, fit.fitted, learnt), bench_ladder(stretches, fit.fitted)
    if error is not None and (error.departures or error.unexplained):
        result = replace(result, verdict=(*result.verdict, *of_ladder(rungs)))
    on_stage(UNSEEN)
    zero = None if fit.at is None else fit.at.zero
    checked = _where_measured(partial(validate_signals, result, unseen, zero=zero), segments) if unseen else None
    modelless = without_model(result, stretches, unseen, segments)
    table = None if modelless is None else modelless.table
    port = PortTorque.of(result, table, stretches[0].origin_ns)
    # The source of a servo that holds a position is an angle: it has no free velocity to map.
    holds = result.network.holds_position
    static = None if holds else _where_measured(partial(source_map, port=port), data.measured)
    evidence = evidence_of(result, stretches, data.measured, validation=checked, modelless=modelless, source=static)
    verdicts = servo_conditions(result.network, evidence) if holds else conditions(evidence)
    return replace(
        so_far,
        fit=result,
        source_map=static,
        validation=checked,
        model_error=error,
        without_model=modelless,
        residuals=diagnose(result, stretches),
        conditions=verdicts,
        ladder=rungs,
        network_file=_saved(result, verdicts, network_file, so_far.metadata),
    )


def _had(step: str, measured: Measured) -> bool:
    return any(segment.procedure == step for segment in measured.segments)


def _of_step(step: str, value_of: Callable[[Measured], Value], measured: Measured) -> Value | None:
    """None where the session had no such step, or its data are unusable."""
    return _where_measured(value_of, measured) if _had(step, measured) else None


def _where_measured(value_of: Callable[[Part], Value], measured: Part) -> Value | None:
    """None where the session had no such part, or its data are unusable."""
    try:
        return value_of(measured)
    except ExperimentError:
        return None


def _saved(result: FitResult, verdicts: Sequence[Condition], path: Path, provenance: Mapping[str, str]) -> Path | None:
    """Write the network file, unless the data contradict themselves or no machine can have such values.

    Whoever uses a network need not read what is said of it, so that a bad one must not exist.
    """
    if all(estimate.status is Status.DOUBTFUL for estimate in result.estimates) or beyond_bounds(result.network):
        return None
    result.network.with_provenance({**provenance, **_said(result, verdicts)}).save(path)
    return path


def _said(result: FitResult, verdicts: Sequence[Condition]) -> Mapping[str, str]:
    """What the catalogue of runs tells of it, beside its values."""
    inside = set(result.network.covariance_names)
    lists = {
        STATUS: {each.name: each.status.value for each in result.estimates if each.status is not Status.VALID},
        DEVIATION: {
            each.name: f"{each.std:.6g}" for each in result.estimates if each.name not in inside and isfinite(each.std)
        },
        CONDITIONS: {each.condition: each.verdict for each in verdicts},
    }
    written = {key: "; ".join(f"{name}={text}" for name, text in pairs.items()) for key, pairs in lists.items()}
    said = {**written, VERDICT: " ".join(result.verdict)}
    return {key: text for key, text in said.items() if text}


def _source_saved(in_situ: "InSituResult", path: Path) -> Path | None:
    """Write the motion source, tick by tick; None where the experiment ended before it was measured."""
    source = in_situ.source
    if source is None:
        return None
    time_s = np.arange(len(source.command)) * source.tick_s
    table = np.column_stack([time_s, source.command, source.position_rad, source.velocity_rad_s])
    np.savetxt(path, table, "%.9g", ",", header="time_s,command,position_rad,velocity_rad_s", comments="")
    return path


def check_metadata(path: Path, metadata: Mapping[str, str]) -> None:
    """Raises UsageError where a key that a fit needs is missing."""
    for key in NEEDED:
        if key not in metadata:
            raise UsageError(f"{path}: its metadata have no '{key}'; it was not recorded by norton-bench")


def conclude_recording(
    path: Path, out: Path | None = None, on_stage: OnStage = _unreported, on_read: OnStage = _unreported
) -> Result:
    """The same, from a recording alone; ``on_read`` is called with a line once it is known that there is something to
    fit. Raises UsageError for a file that cannot be read or holds nothing to fit."""
    recording = read_recording(path, raw_frames=False)
    check_metadata(path, recording.metadata)
    measured = with_earlier(path, recording)
    if not _made_for_identification(measured):
        raise _nothing_to_fit(path)
    on_read(f"fitting {path}")
    result = conclude(
        measured,
        rig_text=recording.rig_text,
        metadata=recording.metadata,
        live=recording.live,
        recording=path,
        out=out if out is not None else path.parent,
        on_stage=on_stage,
    )
    if result.empty:
        raise _nothing_to_fit(path)
    return result


def _made_for_identification(measured: Measured) -> bool:
    return any(segment.use is Use.IDENTIFY for segment in measured.segments) or any(
        _had(step, measured) for step in ("in_situ", RENDER)
    )


def _nothing_to_fit(path: Path) -> UsageError:
    return UsageError(f"{path}: holds no segment made for identification; record one with 'free' or 'imposed'")


def ended(result: Result) -> Ended:
    """The last event of a session that is complete."""
    fit, checked = result.fit, result.validation
    return Ended(
        result.exit_code,
        recording=result.recording,
        report=result.report_file,
        network=result.network_file,
        estimates=fit.estimates if fit else (),
        verdict=fit.verdict if fit else (),
        torque_relative=None if checked is None else _finite(checked.torque_relative),
        velocity_relative=None if checked is None else _finite(checked.velocity_relative),
        expectations=tuple(result.expectations),
        trials=tuple(in_sentences(result)) if result.has_sentences else (),
        tables=tabulated(result) if result.tabulated else (),
        conditions=tuple(map(str, result.conditions)),
    )


def ended_by(error: BaseException, recordings: Collection[Path]) -> Ended:
    """The last event of a session that ``error`` ended; ``recordings`` are those that it has written."""
    return Ended(exit_code_of(error), sentence_of(error), recording=max(recordings, default=None))


def _finite(number: float) -> float | None:
    return float(number) if isfinite(number) else None
