"""``fit``, ``report``, ``recover`` and ``export``: commands for recordings."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from norton_bench.cli.arguments import Json, Out, Quiet, RecordingFile
from norton_bench.cli.output import Output, complain
from norton_bench.errors import ExitCode, UsageError

RECORDING_SUFFIX = ".mcap"

Source = Annotated[Path, Parameter(name="LOG", help="Recordings (.mcap) of one rig, or logs of other programs.")]
Columns = Annotated[
    Path | None, Parameter(help="Column map (TOML) of logs of other programs; without it, one is proposed.")
]
Train = Annotated[str | None, Parameter(help='Data to fit: "0:12.5 s", or files by name or pattern.')]
Test = Annotated[str | None, Parameter(help="Data only to predict, in the same way.")]
ModelName = Annotated[
    str | None, Parameter(name="--model", help='Friction model by name, or "best": the best on held-out parts.')
]
Joint = Annotated[str | None, Parameter(help="Joint of a log of several; it stands for {joint} in the map.")]
Format = Annotated[
    Literal["parquet", "csv", "mat", "candump"],
    Parameter(name="--format", help="Kind of tables, or the CAN frames alone."),
]


Predict = Annotated[
    Path | None, Parameter(help="Table (CSV) to write: measured and predicted, in every row of the equation.")
]


@dataclass(frozen=True)
class Files:
    """The files of a log's fit besides the logs: the map, for which joint it is read, and what is written."""

    columns: Path | None
    joint: str | None
    predict: Path | None
    out: Path | None


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
    joint: Joint = None,
    predict: Predict = None,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> int:
    """Fit a recording again, from its contents alone; or several recordings of one rig together; or logs of other
    programs; a map of their columns is proposed where none is given.
    """
    if columns is not None or _of_others(first):
        files = Files(columns, joint, predict, out)
        return _fit_logs((first, *others), Split(train, test), model, files, Output(json, quiet))
    _check_recordings((first, *others), (train, test, model, joint, predict))
    if others:
        return _fit_several((first, *others), out, Output(json, quiet))
    from norton_bench.cli.results import identification, summary  # noqa: PLC0415
    from norton_bench.session.conclusion import conclude_recording  # noqa: PLC0415

    output = Output(json, quiet)
    result = conclude_recording(first, _made(out), on_read=output.say)
    output.result(identification(result), summary(result))
    if result.shortcoming:
        complain(result.shortcoming)
    return result.exit_code


def _of_others(path: Path) -> bool:
    """Whether it is a log of another program."""
    from norton_bench.logs.bags import is_of_others  # noqa: PLC0415

    return path.suffix.lower() != RECORDING_SUFFIX or is_of_others(path)


def _check_recordings(paths: tuple[Path, ...], for_logs: tuple[object, ...]) -> None:
    """Raises UsageError for files that are no recordings, or options that these do not have."""
    for path in paths:
        if path.exists() and _of_others(path):
            raise UsageError(
                f"{path} is not an MCAP recording of this program; fit recordings and logs of other programs apart"
            )
    if any(option is not None for option in for_logs):
        raise UsageError(
            f"{paths[0]} is taken for a recording of this program, or is damaged: --train, --test, --model, --joint "
            "and --predict are for logs of other programs; leave them out, or make the file anew"
        )


def _fit_several(paths: tuple[Path, ...], out: Path | None, output: Output) -> int:
    from norton_bench.cli.several import several_identification, several_summary  # noqa: PLC0415
    from norton_bench.session.several import conclude_several  # noqa: PLC0415

    several = conclude_several(paths, _made(out), output.say)
    output.result(several_identification(several), several_summary(several))
    return ExitCode.OK if several.together.combined else ExitCode.EXPERIMENT_FAILED


def _fit_logs(paths: tuple[Path, ...], split: Split, model: str | None, files: Files, output: Output) -> int:
    from norton_bench.cli.several import log_identification, log_summary, report_log  # noqa: PLC0415
    from norton_bench.logs.column_map import load_map  # noqa: PLC0415
    from norton_bench.logs.fit import Request, fit_logs  # noqa: PLC0415
    from norton_bench.logs.joints import with_joint  # noqa: PLC0415
    from norton_bench.logs.predictions import write_predictions  # noqa: PLC0415

    folder = _made(files.out)
    columns = files.columns or _proposed(paths[0], files.joint, folder, output)
    column_map = with_joint(load_map(columns), files.joint)
    request = Request(paths, column_map, split.train, split.test, model)
    fitted = fit_logs(request, on_read=lambda: output.say(f"fitting {', '.join(map(str, paths))}"))
    if files.predict is not None:
        write_predictions(files.predict, fitted.predictions)
        output.say(f"predictions: {files.predict}")
    name = ".".join([paths[0].stem, *([files.joint] if files.joint else []), "report.html"])
    report = None if folder is None else report_log(folder / re.sub(r"[^\w.-]", "_", name), request, fitted)
    output.result(log_identification(fitted, request, report), log_summary(fitted, report))
    held = fitted.converged and not fitted.doubtful and not fitted.alarms
    return ExitCode.OK if held else ExitCode.EXPERIMENT_FAILED


def _proposed(log: Path, joint: str | None, folder: Path | None, output: Output) -> Path:
    """A map made from the first log, written beside it or into the folder of --out."""
    from norton_bench.logs.propose import write_proposal  # noqa: PLC0415

    path, sentences = write_proposal(log, folder, joint)
    output.say(f"a map of its columns is proposed in {path}; read it, and name it with --columns from now on")
    for sentence in sentences:
        output.say(f"  {sentence}")
    return path


def report(recording: RecordingFile, /, *, out: Out = None, json: Json = False, quiet: Quiet = False) -> None:
    """Write the report of a recording, beside it or into the folder of --out."""
    from norton_bench.session.conclusion import conclude_recording  # noqa: PLC0415

    output = Output(json, quiet)
    result = conclude_recording(recording, _made(out), on_read=output.say)
    output.result({"report": result.report_file}, str(result.report_file))


def recover(recording: RecordingFile, /, *, json: Json = False) -> None:
    """Copy everything readable from a damaged recording to <name>.recovered.mcap; the original stays as it is."""
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
    """Write every stream of a recording as a table; the column names contain the units."""
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
