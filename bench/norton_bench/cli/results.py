"""The result of an identification, as JSON and for a terminal."""

from collections.abc import Iterable, Sequence
from math import floor, isfinite, isnan, log10
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table

from norton_bench.cli.output import plain_table
from norton_bench.identification.branches import TAILS, DeadZone, Hysteresis
from norton_bench.identification.conditions import Condition
from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.ladder import Rung
from norton_bench.identification.model_error import ModelError
from norton_bench.identification.residual_tests import ResidualTests
from norton_bench.identification.results import BlockedMap, SourceMap, Validation
from norton_bench.identification.without_model import Prediction, StopOperator, WithoutModel
from norton_bench.models.parameter_result import ExpectationResult
from norton_bench.models.parameters import UNITS, Estimate, PredictionError
from norton_bench.on_demand import deferred
from norton_bench.records import FOR_PROGRAMS, Measured
from norton_bench.report.figures_network import bench_time_s
from norton_bench.report.words import parameter_named
from norton_bench.result import Result
from norton_bench.session.conclusion import in_sentences

# Of steps that few sessions have.
tables_data = deferred("norton_bench.cli.tables:tables_data")
tables_view = deferred("norton_bench.cli.tables:tables_view")
trials_figures = deferred("norton_bench.cli.tables:trials_figures")
rendered_figures = deferred("norton_bench.cli.tables:rendered_figures")
in_situ_figures = deferred("norton_bench.cli.tables:in_situ_figures")
NO_TABLES: dict[str, Any] = {"source": None, "exertion": None, "two_ports": [], "modulation": None, "modulator": None}


def identification(result: Result) -> dict[str, Any]:
    """What ``--json`` prints."""
    fit = result.fit
    return {
        "parameters": {estimate.name: parameter(estimate) for estimate in (fit.estimates if fit else ())},
        "validation": None if result.validation is None else validation_figures(result.validation),
        "model_error": model_error_figures(result.model_error),
        "without_model": model_free(result.source_map, result.without_model),
        "residuals": residual_figures(result.residuals),
        "conditions": [condition_figures(condition) for condition in result.conditions],
        "tables": {
            **(tables_data(result) if result.tabulated else NO_TABLES),
            "blocked": None if result.blocked_map is None else _blocked(result.blocked_map),
        },
        "ladder": [rung_figures(rung) for rung in result.ladder],
        "trials": trials_figures(result.trials) if result.trials else None,
        "rendered": [rendered_figures(each) for each in result.rendered],
        "in_situ": None if result.in_situ is None else in_situ_figures(result.in_situ, result.motion_file),
        "verdict": list(fit.verdict) if fit else [],
        "converged": bool(fit and fit.converged),
        "recording": result.recording,
        "network": result.network_file,
        "report": result.report_file,
    }


def events(measured: Measured) -> list[dict[str, Any]]:
    """The recorded events, for ``--json``; times count from the first tick, as in the report."""
    shown = [event for event in measured.events if event.kind not in FOR_PROGRAMS]
    times_s = bench_time_s(measured, [event.stamp_ns for event in shown])
    return [
        {"time_s": float(time_s), "kind": event.kind, "text": event.text}
        for time_s, event in zip(times_s, shown, strict=True)
    ]


def condition_figures(condition: Condition) -> dict[str, Any]:
    """One of the three conditions; ``holds`` is null where the data do not decide it."""
    return {
        "condition": condition.condition,
        "holds": condition.holds,
        "why": condition.why,
        "figure": condition.figure,
        "value": condition.value,
        "interval": list(condition.interval),
        "unit": condition.unit,
    }


def rung_figures(rung: Rung) -> dict[str, Any]:
    """One friction model of the ladder."""
    return {
        "model": rung.name,
        "train_relative": rung.train_relative,
        "held_out_relative": rung.held_out_relative,
        "held_out_std": rung.held_out_std / rung.target_rms,
        "selected": rung.selected,
    }


def parameter(estimate: Estimate) -> dict[str, Any]:
    return {
        "value": float(estimate.value),
        "std": float(estimate.std),
        "unit": estimate.unit,
        "status": estimate.status.value,
    }


def validation_figures(validation: Validation) -> dict[str, float]:
    return {
        "torque_rms_nm": float(validation.torque_rms_nm),
        "torque_relative": float(validation.torque_relative),
        "velocity_rms_rad_s": float(validation.velocity_rms_rad_s),
        "velocity_relative": float(validation.velocity_relative),
        "velocity_noise_rad_s": float(validation.velocity_noise_rad_s),
    }


def model_error_figures(error: ModelError | None) -> dict[str, Any] | None:
    """The error of predictions beyond noise, and its causes; null where it was not computed."""
    if error is None:
        return None
    prediction = error.prediction
    return {
        "torque_nm": prediction.torque_nm,
        "velocity_rad_s": None if isnan(prediction.velocity_rad_s) else prediction.velocity_rad_s,
        "level": prediction.level,
        "ranges": {name: list(span) for name, span in prediction.ranges.items()},
        "rms_nm": error.rms_nm,
        "noise_nm": error.noise_nm,
        "left_nm": error.left_nm,
        "zero_nm": error.zero.fitted_nm,
        "zero_less_tare_nm": None if isnan(error.zero.moved_nm) else error.zero.moved_nm,
        "departures": [
            {
                "cause": departure.kind.name,
                "rms_nm": departure.rms_nm,
                "share": departure.share,
                "left_nm": departure.left_nm,
                "p_value": departure.p_value,
                "periods_per_turn": departure.periods_per_turn or None,
            }
            for departure in error.departures
        ],
        "unexplained": error.unexplained,
        "times_simulated": None if isnan(error.times_simulated) else error.times_simulated,
    }


def expectation_figures(result: ExpectationResult) -> dict[str, Any]:
    return {"name": result.name, "met": result.met, "said": result.sentence}


def expected(expectations: Iterable[ExpectationResult]) -> list[RenderableType]:
    """A line for each expectation: whether it was met."""
    return [f"{'✓' if result.met else '✗'} {result.sentence}" for result in expectations]


def summary(result: Result) -> RenderableType:
    """The same for a terminal: table, validation, verdict, and the paths of the files."""
    parts: list[RenderableType] = []
    if result.fit is not None:
        parts.append(parameter_table(result.fit.estimates))
        parts += [f"· {remark}" for remark in result.fit.verdict]
    parts += map(str, result.conditions)
    if result.validation is not None:
        parts.append(validation_sentence(result.validation))
    if result.model_error is not None:
        parts.append(prediction_sentence(result.model_error.prediction, result.units.command))
    parts += in_sentences(result) if result.has_sentences else ()
    parts += tables_view(result) if result.tabulated else ()
    files = (
        ("recording", result.recording),
        ("source", result.motion_file),
        ("network", result.network_file),
        ("report", result.report_file),
    )
    parts.append(file_table(files))
    return Group(*parts)


def parameter_table(estimates: Iterable[Estimate]) -> Table:
    """A row for each parameter: symbol, name, value ± half of its 95 % interval, unit, status."""
    table = plain_table()
    for heading, justify in (("", "left"), ("parameter", "left"), ("value", "right"), ("± (95 %)", "right")):
        table.add_column(heading, justify="right" if justify == "right" else "left", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("status", no_wrap=True)
    for estimate in estimates:
        value, half = with_digits(estimate.value, estimate.half_interval)
        symbol = known.symbol if (known := parameter_named(estimate.name)) else ""
        table.add_row(symbol, estimate.name, value, half, estimate.unit, estimate.status.value)
    return table


def with_digits(value: float, std: float) -> tuple[str, str]:
    """A value and its uncertainty as text, to two significant digits of the uncertainty."""
    if not isfinite(value):
        return "–", "–"
    if not isfinite(std) or std <= 0:
        return f"{value:.4g}", "–"
    rounded = abs(round(value, 1 - floor(log10(std))))  # else 9.99996 would be shown as 10.0000 with a smaller power
    scale = floor(log10(max(rounded, std)))
    exponent = 0 if -4 < scale < 5 else scale
    decimals = max(0, exponent - floor(log10(std)) + 1)
    suffix = f"e{exponent}" if exponent else ""
    return f"{value / 10.0**exponent:.{decimals}f}{suffix}", f"{std / 10.0**exponent:.{decimals}f}{suffix}"


def validation_sentence(validation: Validation) -> str:
    """The errors of prediction; a rig without a torque sensor, or with a held shaft, has only one of the two."""
    noise = validation.velocity_noise_rad_s
    readings = f"; the noise of the readings is {noise:.2g} rad/s" if noise > 0.0 else ""
    predicted = [
        f"{what} to {rms:.3g} {unit} rms ({relative:.1%}{more})"
        for what, rms, unit, relative, more in (
            ("torque", validation.torque_rms_nm, "N*m", validation.torque_relative, " of it"),
            (
                "free velocity",
                validation.velocity_rms_rad_s,
                "rad/s",
                validation.velocity_relative,
                f" of it{readings}",
            ),
        )
        if isfinite(rms)
    ]
    return f"Predicted on data kept apart from the fit: {', '.join(predicted) or 'nothing'}."


def prediction_sentence(prediction: PredictionError, command_unit: str) -> str:
    """How accurate the network's predictions are, and within what range that was tested."""
    bounds = [
        f"{what} within {bound:.2g} {unit} rms"
        for what, bound, unit in (
            ("torque", prediction.torque_nm, "N*m"),
            ("free velocity", prediction.velocity_rad_s, "rad/s"),
        )
        if isfinite(bound)
    ]
    seen = ", ".join(
        f"{name} {low:.3g} to {high:.3g} {UNITS.get(name, command_unit)}"
        for name, (low, high) in prediction.ranges.items()
    )
    return (
        f"Predictions of motion not seen are right {prediction.level:.0%} of the time to: {', '.join(bounds)}; {seen}."
    )


def file_table(files: Sequence[tuple[str, Path | None]]) -> Table:
    """The paths of the files."""
    table = Table.grid(padding=(0, 2))
    for name, path in files:
        if path is not None:
            table.add_row(name, str(path))
    return table


def _blocked(blocked: BlockedMap) -> list[dict[str, Any]]:
    histories = blocked.histories or ("slow",) * len(blocked.command)
    columns = (blocked.command, blocked.torque_nm, blocked.torque_std_nm, blocked.from_above, histories)
    return [
        {
            "command": float(command),
            "torque_nm": float(torque),
            "torque_std_nm": float(std),
            "from_above": None if history == "rest" else bool(above),
            "history": history,
        }
        for command, torque, std, above, history in zip(*columns, strict=True)
    ]


def model_free(source: SourceMap | None, without_model: WithoutModel | None) -> dict[str, Any] | None:
    """The results without a model, and the tests of the residual, as ``--json`` prints them.

    None where nothing was measured for them.
    """
    if source is None and without_model is None:
        return None
    known = without_model if without_model is not None else WithoutModel(None, None)
    return {
        "source": None if source is None else _source_data(source),
        "table": None if known.table is None else _table_data(known.table),
        "operator": None if known.operator is None else _operator(known.operator),
        "predicted": {
            "operator": _prediction(known.operator_prediction),
            "stops_alone": _prediction(known.stops_alone),
            "table": _prediction(known.table_prediction),
        },
    }


def residual_figures(tests: ResidualTests | None) -> dict[str, Any] | None:
    """The tests of the residual; None where too little was fitted."""
    if tests is None:
        return None
    return {
        "rms_nm": tests.rms_nm,
        "white_p": None if tests.memory is None else tests.memory.p_value,
        "greatest_autocorrelation": None if tests.memory is None else tests.memory.greatest,
        "inputs": {
            each.name: {"p": each.p_value, "share": each.share, "rms_nm": each.rms_nm, "peak_hz": each.peak_hz}
            for each in tests.dependences
        },
        "position": [
            {"periods_per_turn": each.periods_per_turn, "amplitude_nm": each.amplitude_nm, "p": each.p_value}
            for each in tests.harmonics
        ],
    }


def _source_data(source: SourceMap) -> dict[str, Any]:
    known = bool(len(source.resampled_rad_s))
    unknown = np.full((2, source.command.size), np.nan)
    low, high = np.quantile(source.resampled_rad_s, TAILS, axis=0) if known else unknown
    return {
        "command": source.command.tolist(),
        "rising": source.rising.tolist(),
        "velocity_rad_s": source.velocity_rad_s.tolist(),
        "low_rad_s": low.tolist(),
        "high_rad_s": high.tolist(),
        "settling_s": source.settling_s,
        "port_torque_nm": source.port_torque_nm.tolist(),
        "port_torque_std_nm": source.port_torque_std_nm.tolist(),
        "dead_zone": {"rising": _zone(source.dead_zone(True)), "falling": _zone(source.dead_zone(False))},
        "hysteresis": _hysteresis(source.hysteresis()),
    }


def _zone(zone: DeadZone | None) -> dict[str, Any] | None:
    if zone is None:
        return None
    return {
        "low": zone.low,
        "high": zone.high,
        "width": zone.width,
        "low_interval": list(zone.low_interval),
        "high_interval": list(zone.high_interval),
        "width_interval": list(zone.width_interval),
    }


def _hysteresis(hysteresis: Hysteresis | None) -> dict[str, Any] | None:
    if hysteresis is None:
        return None
    return {
        "command": hysteresis.command,
        "difference_rad_s": hysteresis.difference_rad_s,
        "chance_rad_s": hysteresis.band_rad_s,
        "significant": hysteresis.significant,
    }


def _table_data(table: ImpedanceTable) -> dict[str, Any]:
    return {
        "command": table.command.tolist(),
        "velocity_rad_s": table.velocity_rad_s.tolist(),
        "torque_nm": table.torque_nm.tolist(),
        "half_width_nm": table.half_width_nm.tolist(),
        "empty_cells": table.empty,
        "left_out_rms_nm": table.left_out_rms_nm(),
    }


def _operator(operator: StopOperator) -> dict[str, Any]:
    return {
        "torque_gain": operator.torque_gain,
        "inertia_kgm2": operator.inertia_kgm2,
        "viscous_damping_nms_rad": operator.viscous_damping_nms_rad,
        "coulomb_torque_nm": operator.coulomb_torque_nm,
        "abrupt_share": operator.abrupt_share,
        "yield_rad": operator.yield_rad.tolist(),
        "abrupt_nm": operator.strength_nm[0].tolist(),
        "gradual_nm": operator.strength_nm[1].tolist(),
    }


def _prediction(prediction: Prediction | None) -> dict[str, float] | None:
    if prediction is None:
        return None
    return {
        "torque_rms_nm": prediction.torque_rms_nm,
        "torque_relative": prediction.torque_relative,
        "share": prediction.share,
    }
