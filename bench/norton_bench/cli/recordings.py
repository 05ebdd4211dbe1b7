"""``fit``, ``report``, ``recover`` and ``export``: what can be had from a recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from rich.console import Group, RenderableType
from rich.table import Table

from norton_bench.cli.arguments import Json, Out, Quiet, RecordingFile
from norton_bench.cli.output import Output, plain_table
from norton_bench.cli.results import file_table, parameter, parameter_table
from norton_bench.errors import ExitCode, UsageError
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
        "network": one.conclusion.network,
        "report": one.conclusion.report,
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


RECORDING_SUFFIX = ".mcap"

Source = Annotated[
    Path, Parameter(name="LOG", help="Recordings (.mcap) of one rig, or logs from elsewhere with --columns.")
]
Columns = Annotated[Path | None, Parameter(help="Column map (TOML) of logs that were made elsewhere.")]
Train = Annotated[str | None, Parameter(help='What is fitted: "0:12.5 s", or files by name or pattern.')]
Test = Annotated[str | None, Parameter(help="What is only predicted, likewise.")]
ModelName = Annotated[
    str | None, Parameter(name="--model", help='Friction model by name, or "best" on held-out parts.')
]
Format = Annotated[
    Literal["parquet", "csv", "mat", "candump"],
    Parameter(name="--format", help="Kind of tables, or the CAN frames alone."),
]


@dataclass(frozen=True)
class Split:
    """``--train`` and ``--test`` as written."""

    train: str | None
    test: str | None


def fit(
    first: Source,
    /,
    *others: Source,
    columns: Columns = None,
    train: Train = None,
    test: Test = None,
    model: ModelName = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Fit a recording again, from what it holds alone; several sessions of one rig; or foreign logs, by a map of their
    columns."""
    if columns is not None:
        return _fit_logs((first, *others), columns, Split(train, test), model, out, Output(json, quiet))
    _check_recordings((first, *others), (train, test, model))
    if others:
        return _fit_several((first, *others), out, Output(json, quiet))
    from norton_bench.cli.results import identification, summary  # noqa: PLC0415
    from norton_bench.session.conclusion import conclude_recording  # noqa: PLC0415

    output = Output(json, quiet)
    output.say(f"fitting {first}")
    _, found = conclude_recording(first, _made(out))
    output.result(identification(found, first), summary(found, first))
    if found.fit is not None and found.fit.shortcoming:
        output.say(found.fit.shortcoming)
        return ExitCode.EXPERIMENT_FAILED
    return ExitCode.OK


def _check_recordings(paths: tuple[Path, ...], for_logs: tuple[str | None, ...]) -> None:
    """Raises UsageError where something else than recordings was given."""
    for path in paths:
        if path.suffix.lower() != RECORDING_SUFFIX and path.is_file():
            raise UsageError(
                f"{path} is not an MCAP recording; name a .mcap file or, for a log from elsewhere, say what its "
                "columns hold: --columns MAP, a TOML file as in docs/logs.md and examples/logs"
            )
    if any(option is not None for option in for_logs):
        raise UsageError("--train, --test and --model are for logs from elsewhere, with --columns MAP; leave them out")


def _fit_several(paths: tuple[Path, ...], out: Path | None, output: Output) -> int:
    from norton_bench.session.several import conclude_several  # noqa: PLC0415

    found = conclude_several(paths, _made(out), output.say)
    output.result(several_identification(found), several_summary(found))
    return ExitCode.OK if found.together.combined else ExitCode.EXPERIMENT_FAILED


def _fit_logs(
    paths: tuple[Path, ...], columns: Path, split: Split, model: str | None, out: Path | None, output: Output
) -> int:
    from norton_bench.logs.column_map import load_map  # noqa: PLC0415
    from norton_bench.logs.fit import Request, fit_logs  # noqa: PLC0415

    column_map = load_map(columns)
    folder = _made(out)
    output.say(f"fitting {', '.join(map(str, paths))}")
    request = Request(paths, column_map, split.train, split.test, model)
    found = fit_logs(request)
    report = None if folder is None else report_log(folder / f"{paths[0].stem}.report.html", request, found)
    output.result(log_identification(found, paths, columns, report), log_summary(found, report))
    return ExitCode.OK if found.converged and not found.doubtful else ExitCode.EXPERIMENT_FAILED


def report(recording: RecordingFile, /, *, out: Out = None, json: Json = False, quiet: Quiet = False) -> None:
    """Write the report of a recording, beside it or into the folder given."""
    from norton_bench.session.conclusion import conclude_recording  # noqa: PLC0415

    output = Output(json, quiet)
    output.say(f"fitting {recording}")
    _, found = conclude_recording(recording, _made(out))
    output.result({"report": found.report}, str(found.report))


def recover(recording: RecordingFile, /, *, json: Json = False) -> None:
    """Write everything sound in a damaged recording to <name>.recovered.mcap; the original is not touched."""
    from norton_bench.recording.recover import recover as rescue  # noqa: PLC0415

    done = rescue(recording)
    data = {
        "recording": done.path,
        "messages": done.messages,
        "bytes_lost": done.bytes_lost,
        "chunks_lost": done.chunks_lost,
        "was_complete": done.was_complete,
        "candump": done.log,
    }
    lost = "nothing was lost" if done.was_complete else f"{done.bytes_lost} bytes and {done.chunks_lost} chunks lost"
    Output(json).result(data, f"{done.path}: {done.messages} messages, {lost}")


def export(
    recording: RecordingFile, /, *, kind: Format = "parquet", out: Out = None, json: Json = False, quiet: Quiet = False
) -> None:
    """Write every stream of a recording as a table; units stand in the column names."""
    from norton_bench.recording.export import export as write_tables  # noqa: PLC0415

    output = Output(json, quiet)
    paths = write_tables(recording, kind, _made(out) or recording.parent)
    output.result({"files": paths}, "\n".join(map(str, paths)))


def _made(out: Path | None) -> Path | None:
    """The folder, made where it is not there yet. Raises UsageError."""
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"{out}: the folder cannot be made ({error.strerror}); choose another") from error
    return out
