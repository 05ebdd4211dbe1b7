"""What ``fit`` says of a log that was made elsewhere, and of several sessions together. Imported when it runs."""

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


def log_identification(fit: LogFit, paths: Sequence[Path], column_map: Path, report: Path | None) -> dict[str, Any]:
    """``fit LOG --columns MAP``: a log that was made elsewhere.

    What ``--json`` prints. A network file there is none: no lag of the amplifier was sought.
    """
    return {
        "parameters": {estimate.name: parameter(estimate) for estimate in fit.estimates},
        "model": fit.model,
        "errors": {"train": _errors(fit.train), "test": _errors(fit.test)},
        "ladder": [_step(step) for step in fit.ladder],
        "validation": None,
        "verdict": list(fit.verdict),
        "converged": fit.converged,
        "logs": list(paths),
        "columns": column_map,
        "recording": None,
        "network": None,
        "report": report,
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
    """One row a model of friction: error in training, on held-out parts, and which was selected on those."""
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
    command = " ".join(["norton-bench fit", *map(str, request.paths), "--columns", column_map.place, *options])
    metadata = {"logs": ", ".join(map(str, request.paths)), "columns": column_map.place, "source": column_map.source}
    return write_log_report(path, column_map.title or request.paths[0].stem, fit, metadata, command)


def several_identification(found: Several) -> dict[str, Any]:
    """``fit RECORDING RECORDING...``: what several sessions say together, for programs and for people.

    What ``--json`` prints.
    """
    return {
        "parameters": {estimate.name: parameter(estimate) for estimate in found.together.estimates},
        "sessions": [_session(one) for one in found.sessions],
        "between_sessions": {name: _spread(spread) for name, spread in found.together.spreads.items()},
        "validation": None,
        "without_model": None,
        "residuals": None,
        "verdict": list(found.together.verdict),
        "converged": found.together.combined,
        "recording": None,
        "network": found.network,
        "report": found.report,
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


def several_summary(found: Several) -> RenderableType:
    """The same for a terminal."""
    parts: list[RenderableType] = [parameter_table(found.together.estimates)]
    if found.together.combined:
        parts += ["", _spread_table(found)]
    parts += [f"· {remark}" for remark in found.together.verdict]
    parts.append(file_table((("network", found.network), ("report", found.report))))
    return Group(*parts)


def _spread_table(found: Several) -> Table:
    """One row a parameter: deviation of a session's own value, between sessions, the most it may be, chance."""
    table = plain_table()
    table.add_column("spread of", no_wrap=True)
    for heading in ("within", "between", "at most"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("p", justify="right", no_wrap=True)
    for estimate in found.together.estimates:
        spread = found.together.spreads.get(estimate.name)
        if spread is not None:
            stds = (spread.within_std, spread.between_std, spread.between_std_upper)
            table.add_row(estimate.name, *(f"{std:.2g}" for std in stds), estimate.unit, f"{spread.p:.2g}")
    return table
