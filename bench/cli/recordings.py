"""``fit``, ``report``, ``recover`` and ``export``: what can be had from a recording."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from bench.cli.arguments import Json, Out, Quiet, RecordingFile
from bench.cli.output import Output
from bench.errors import ExitCode, UsageError

Format = Annotated[Literal["parquet", "csv", "mat"], Parameter(name="--format", help="Kind of tables.")]


def fit(recording: RecordingFile, /, *, out: Out = None, json: Json = False, quiet: Quiet = False) -> int:
    """Fit, validate and report a recording again, from what it holds alone."""
    from bench.cli.model_free import model_free, residual_figures  # noqa: PLC0415
    from bench.cli.results import identification, summary  # noqa: PLC0415
    from bench.session.conclusion import conclude_recording  # noqa: PLC0415

    output = Output(json, quiet)
    output.say(f"fitting {recording}")
    _, found = conclude_recording(recording, _made(out))
    about = (found.fit, found.validation, recording, found.network, found.report)
    about_model_free = model_free(found.source_map, found.without_model), residual_figures(found.residuals)
    output.result(identification(*about, *about_model_free), summary(*about))
    return ExitCode.OK if found.fit is not None and found.fit.converged else ExitCode.EXPERIMENT_FAILED


def report(recording: RecordingFile, /, *, out: Out = None, json: Json = False, quiet: Quiet = False) -> None:
    """Write the report of a recording, beside it or into the folder given."""
    from bench.session.conclusion import conclude_recording  # noqa: PLC0415

    output = Output(json, quiet)
    output.say(f"fitting {recording}")
    _, found = conclude_recording(recording, _made(out))
    output.result({"report": found.report}, str(found.report))


def recover(recording: RecordingFile, /, *, json: Json = False) -> None:
    """Write everything sound in a damaged recording to <name>.recovered.mcap; the original is not touched."""
    from bench.recording.recover import recover as rescue  # noqa: PLC0415

    done = rescue(recording)
    data = {
        "recording": done.path,
        "messages": done.messages,
        "bytes_lost": done.bytes_lost,
        "chunks_lost": done.chunks_lost,
        "was_complete": done.was_complete,
    }
    lost = "nothing was lost" if done.was_complete else f"{done.bytes_lost} bytes and {done.chunks_lost} chunks lost"
    Output(json).result(data, f"{done.path}: {done.messages} messages, {lost}")


def export(
    recording: RecordingFile, /, *, kind: Format = "parquet", out: Out = None, json: Json = False, quiet: Quiet = False
) -> None:
    """Write every stream of a recording as a table; units stand in the column names."""
    from bench.recording.export import export as write_tables  # noqa: PLC0415

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
