"""Arguments that several commands share."""

from datetime import datetime
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from bench.errors import UsageError

RigFile = Annotated[Path, Parameter(name="RIG", help="A rig file.")]
RecordingFile = Annotated[Path, Parameter(name="RECORDING", help="A recording (.mcap).")]
Json = Annotated[bool, Parameter(help="Print one JSON document on stdout and nothing else there.")]
Quiet = Annotated[bool, Parameter(help="Say nothing on the way.")]
Seed = Annotated[int | None, Parameter(help="Seed of the simulation, instead of the rig file's.")]
Backend = Annotated[str | None, Parameter(help='"hardware" or "simulated", instead of the rig file\'s.')]
Out = Annotated[Path | None, Parameter(help="Folder for the results.")]


RUNS = Path("runs")


def run_folder(out: Path | None, rig_name: str, runs: Path = RUNS) -> Path:
    """The folder of this run, made: ``out``, or <runs>/<stamp>-<rig>. Raises UsageError where it cannot be made."""
    folder = out if out is not None else runs / f"{datetime.now():%Y%m%d-%H%M%S}-{rig_name}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"{folder}: the folder cannot be made ({error.strerror}); choose another with --out"
        ) from error
    return folder
