"""``datasheet``: the data sheet of an actuator, from a recording or a network file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from norton_bench.cli.arguments import Json, Quiet
from norton_bench.cli.output import Output
from norton_bench.errors import ExitCode, ExperimentError, UsageError

if TYPE_CHECKING:
    from norton_bench.datasheet.sheet import Sheet

RECORDING_SUFFIX = ".mcap"
ENDINGS = (".html", ".pdf")

Subject = Annotated[Path, Parameter(name="FILE", help="A recording (.mcap), or the network file of a fit (.json).")]
Against = Annotated[Path | None, Parameter(help="Another recording or network, to compare with.")]
Out = Annotated[Path | None, Parameter(help="The file to write, .html or .pdf; default: HTML beside FILE.")]


def datasheet(
    file: Subject, /, *, against: Against = None, out: Out = None, json: Json = False, quiet: Quiet = False
) -> int:
    """Write the data sheet of an actuator: its parameters, and what follows from them. Every figure has its 95 %
    interval and the range in which it is valid. A recording is fitted again first.
    """
    path = out or file.with_name(f"{file.name.removesuffix(file.suffix).removesuffix('.network')}.datasheet.html")
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"{path}: a data sheet is written as HTML or PDF; let its name end in .html or .pdf")
    from norton_bench.datasheet.data import comparison_data, sheet_data  # noqa: PLC0415  (slow to import)
    from norton_bench.datasheet.sheet import compared  # noqa: PLC0415

    output = Output(json, quiet)
    sheets = [_sheet(each, output) for each in (file, against) if each is not None]
    _write(path, sheets)
    differences = comparison_data(compared(*sheets)) if len(sheets) == 2 else None
    data = {"datasheet": path, "sheets": [sheet_data(sheet) for sheet in sheets], "differences": differences}
    output.result(data, str(path))
    return ExitCode.OK


def _write(path: Path, sheets: "list[Sheet]") -> None:
    if path.suffix.lower() == ".pdf":
        from norton_bench.datasheet.printed import write_pdf  # noqa: PLC0415

        write_pdf(path, sheets)
    else:
        from norton_bench.datasheet.data import write_html  # noqa: PLC0415

        write_html(path, sheets)


def _sheet(file: Path, output: Output) -> "Sheet":
    if file.suffix.lower() == RECORDING_SUFFIX:
        return _of_recording(file, output)
    from norton_bench.datasheet.sheet import sheet_of_network  # noqa: PLC0415
    from norton_bench.networks.files import load  # noqa: PLC0415

    return sheet_of_network(load(file), str(file))


def _of_recording(file: Path, output: Output) -> "Sheet":
    """Fit the recording as ``fit`` does, without writing its files."""
    from tempfile import TemporaryDirectory  # noqa: PLC0415

    from norton_bench.datasheet.sheet import sheet_of_result  # noqa: PLC0415
    from norton_bench.session.conclusion import conclude_recording  # noqa: PLC0415

    with TemporaryDirectory() as folder:
        result = conclude_recording(file, Path(folder), on_read=output.say)
    if result.fit is None:
        raise UsageError(
            f"{file}: no model was fitted to this actuator, so there is no data sheet; the report has its tables"
        )
    if not result.fit.converged:
        raise ExperimentError(f"{file}: {result.fit.shortcoming}")
    return sheet_of_result(result)
