"""The results of ``fit`` for logs of other programs, and for several sessions together. Imported when it runs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table

from norton_bench.cli.output import plain_table
from norton_bench.cli.results import file_table, parameter, parameter_table
from norton_bench.identification.statistics import Combined
from norton_bench.logs.fit import Request
from norton_bench.logs.results import ErrorFigures, Errors, LogFit, Step
from norton_bench.session.several import OneOf, Several


def log_identification(fit: LogFit, request: Request, report: Path | None) -> dict[str, Any]:
    """``fit LOG --columns MAP`` as ``--json`` prints it.

    There is no network file, because the lag of the amplifier is not fitted.
    """
    return {
        "parameters": {estimate.name: parameter(estimate) for estimate in fit.estimates},
        "totals": {estimate.name: parameter(estimate) for estimate in fit.totals},
        "model": fit.model,
        "errors": {"train": _errors(fit.train), "test": _errors(fit.test)},
        "ladder": [_step(step) for step in fit.ladder],
        "validation": None,
        "between_parts": _between(fit),
        "alarms": list(fit.alarms),
        "verdict": list(fit.verdict),
        "converged": fit.converged,
        "logs": list(request.paths),
        "columns": request.column_map.place,
        "joint": request.column_map.log.joint,
        "recording": None,
        "network": None,
        "report": report,
    }


def _between(fit: LogFit) -> dict[str, Any] | None:
    if fit.between is None or not fit.between.each:
        return None
    return {
        one.name: {"values": one.values.tolist(), "stds": one.stds.tolist(), "p": one.p, "odd": one.odd}
        for one in fit.between.each
    }


def _errors(errors: Errors) -> dict[str, Any] | None:
    if errors.exertion is None and errors.motion is None:
        return None
    return {"exertion": _figures(errors.exertion), "motion": _figures(errors.motion)}


def _figures(figures: ErrorFigures | None) -> dict[str, Any] | None:
    if figures is None:
        return None
    return {
        "rms": figures.rms,
        "relative": figures.relative,
        "mean_absolute": figures.mean_absolute,
        "unit": figures.unit,
    }


def _step(step: Step) -> dict[str, Any]:
    return {
        "model": step.model,
        "train_relative": step.train_relative,
        "held_out_relative": step.held_out_relative,
        "held_out_std": step.held_out_std,
        "selected": step.selected,
        "parameters": {estimate.name: parameter(estimate) for estimate in step.estimates},
    }


def log_summary(fit: LogFit, report: Path | None) -> RenderableType:
    """The same for a terminal."""
    parts: list[RenderableType] = [f"friction: {fit.model}", parameter_table(fit.estimates)]
    if fit.totals:
        parts += ["in total, in steady sliding:", parameter_table(fit.totals)]
    parts += [f"· {remark}" for remark in fit.verdict]
    parts += [line for side in ("train", "test") for line in _error_lines(side, getattr(fit, side))]
    parts.append(ladder_table(fit.ladder))
    parts.append(file_table((("report", report),)))
    return Group(*parts)


def _error_lines(side: str, errors: Errors) -> list[str]:
    return [
        f"{side}: {what} to {figures.rms:.3g} {figures.unit} rms ({figures.relative:.2%} of it)"
        for what, figures in (("exertion", errors.exertion), ("motion", errors.motion))
        if figures is not None
    ]


def ladder_table(ladder: Sequence[Step]) -> Table:
    """A row for each friction model: error on fitted data and on held-out parts, and which was selected by the
    latter."""
    table = plain_table()
    table.add_column("model", no_wrap=True)
    for heading in ("train", "held out", "std"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for step in ladder:
        figures = (step.train_relative, step.held_out_relative, step.held_out_std)
        table.add_row(step.model, *(f"{figure:.2%}" for figure in figures), "selected" if step.selected else "")
    return table


def report_log(path: Path, request: Request, fit: LogFit) -> Path:
    """The report as an HTML file. Raises ExperimentError where it cannot be written."""
    from norton_bench.report.log_page import write_log_report  # noqa: PLC0415  (draws: slow to import)

    column_map = request.column_map
    options = [f'--{name} "{text}"' for name, text in (("train", request.train), ("test", request.test)) if text]
    options += [f"--model {request.model}"] if request.model else []
    options += [f'--joint "{column_map.log.joint}"'] if column_map.log.joint else []
    command = " ".join(["norton-bench fit", *map(str, request.paths), "--columns", column_map.place, *options])
    metadata = {"logs": ", ".join(map(str, request.paths)), "columns": column_map.place, "source": column_map.source}
    return write_log_report(path, column_map.title or request.paths[0].stem, fit, metadata, command)


def several_identification(several: Several) -> dict[str, Any]:
    """``fit RECORDING RECORDING...``: the combined result of several sessions, as ``--json`` prints it."""
    return {
        "parameters": {estimate.name: parameter(estimate) for estimate in several.together.estimates},
        "sessions": [_session(one) for one in several.sessions],
        "between_sessions": {name: _spread(spread) for name, spread in several.together.spreads.items()},
        "validation": None,
        "without_model": None,
        "residuals": None,
        "verdict": list(several.together.verdict),
        "converged": several.together.combined,
        "recording": None,
        "network": several.network,
        "report": several.report,
    }


def _session(one: OneOf) -> dict[str, Any]:
    return {
        "recording": one.recording,
        "parameters": {estimate.name: parameter(estimate) for estimate in one.fit.estimates},
        "converged": one.fit.converged,
        "network": one.result.network_file,
        "report": one.result.report_file,
    }


def _spread(spread: Combined) -> dict[str, Any]:
    return {
        "within_std": spread.within_std,
        "shared_std": spread.shared_std,
        "between_std": spread.between_std,
        "between_std_upper": spread.between_std_upper,
        "q": spread.q,
        "p": spread.p,
        "sessions": len(spread.weights),
    }


def several_summary(several: Several) -> RenderableType:
    """The same for a terminal."""
    parts: list[RenderableType] = [parameter_table(several.together.estimates)]
    if several.together.combined:
        parts += ["", _spread_table(several)]
    parts += [f"· {remark}" for remark in several.together.verdict]
    parts.append(file_table((("network", several.network), ("report", several.report))))
    return Group(*parts)


def _spread_table(several: Several) -> Table:
    """A row for each parameter: standard deviation within a session, between sessions, its upper bound, p-value."""
    table = plain_table()
    table.add_column("spread of", no_wrap=True)
    for heading in ("within", "between", "at most"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("p", justify="right", no_wrap=True)
    for estimate in several.together.estimates:
        spread = several.together.spreads.get(estimate.name)
        if spread is not None:
            stds = (spread.within_std, spread.between_std, spread.between_std_upper)
            table.add_row(estimate.name, *(f"{std:.2g}" for std in stds), estimate.unit, f"{spread.p:.2g}")
    return table
