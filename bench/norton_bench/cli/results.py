"""The result of an identification, as JSON and for a terminal."""

from collections.abc import Iterable, Mapping, Sequence
from math import floor, isfinite, isnan, log10
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table

from norton_bench.cli.output import plain_table
from norton_bench.cli.tables import model_free, residual_figures, tables_data, tables_view
from norton_bench.identification.conditions import Condition
from norton_bench.identification.in_situ import InSituResult
from norton_bench.identification.ladder import Rung
from norton_bench.identification.model_error import ModelError
from norton_bench.identification.results import FitResult, Validation
from norton_bench.identification.trials import TrialFigures, last_driven, settled
from norton_bench.models.parameter_result import ExpectationResult
from norton_bench.models.parameters import BY_NAME, UNITS, Estimate, PredictionError
from norton_bench.procedures.refinement import Refinement, in_percent, widest_of, words
from norton_bench.records import FOR_PROGRAMS, Measured
from norton_bench.report.figures_network import bench_time_s
from norton_bench.result import Result
from norton_bench.session.summary import of_trials


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
        "tables": tables_data(result),
        "ladder": [rung_figures(rung) for rung in result.ladder],
        "trials": trials_figures(result.trials),
        "in_situ": in_situ_figures(result.in_situ, result.motion_file),
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


def trials_figures(trials: Sequence[TrialFigures]) -> dict[str, Any] | None:
    """A repeated movement, trial by trial."""
    if not trials:
        return None
    return {
        "converged": settled(trials),
        "below_first_db": last_driven(trials).below_db(trials[0]),
        "torque_nm": [trial.torque_nm for trial in trials],
        "with_noise_nm": [trial.with_noise_nm for trial in trials],
        "noise_nm": [trial.noise_nm for trial in trials],
    }


def in_situ_figures(result: InSituResult | None, source: Path | None) -> dict[str, Any] | None:
    """The actuator in situ: its trials, and where its motion source lies."""
    if result is None or not result.trials:
        return None
    scatter = None if result.source is None else result.source.scatter_rad_s
    return {
        **(trials_figures(result.trials) or {}),
        "driven": [trial.driven for trial in result.trials],
        "assembly": list(result.assembly),
        "reasons": list(result.reasons),
        "source": source,
        "source_scatter_rad_s": scatter,
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
    }


def until_figures(refined: Refinement, fit: FitResult, bench_time_s: float) -> dict[str, Any]:
    """The results of ``--until`` as ``--json`` prints them; whether the target was reached is judged by the final
    fit."""
    widest = widest_of(fit.estimates)
    return {
        "asked": refined.target,
        "reached": refined.reached and widest is not None and widest[1] <= refined.target,
        "rounds": refined.rounds,
        "bench_time_s": bench_time_s,
        "widest": None if widest is None else {"parameter": widest[0], "half_width": widest[1]},
        "reasons": list(refined.sentences),
    }


def until_sentences(until: Mapping[str, Any]) -> str:
    """The same in words."""
    rounds = f"{until['rounds']} round{'' if until['rounds'] == 1 else 's'}"
    verb = "Reached" if until["reached"] else "Did not reach"
    head = f"{verb} {in_percent(until['asked'])} after {rounds}, {until['bench_time_s']:.0f} s of bench time"
    widest = until["widest"]
    if widest is not None:
        head += f"; the widest interval is that of {words(widest['parameter'])}, {in_percent(widest['half_width'])}"
    return " ".join([f"{head}.", *until["reasons"]])


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
    parts += of_trials(result)
    parts += tables_view(result)
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
        symbol = BY_NAME[estimate.name].symbol if estimate.name in BY_NAME else ""
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
