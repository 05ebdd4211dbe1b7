"""A recording as tables for other tools: Parquet, CSV, MATLAB; its CAN frames as a candump log."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.errors import ExperimentError, UsageError
from norton_bench.on_demand import extra
from norton_bench.recording.contents import Recording
from norton_bench.recording.frames import log_lines, log_name
from norton_bench.recording.reader import read_recording
from norton_bench.recording.wire import Frames
from norton_bench.records import TABLES

Columns = Mapping[str, npt.NDArray[Any]]


def export(path: Path, format: str, out_dir: Path) -> list[Path]:  # noqa: A002
    """Write the recording's tables to ``out_dir``; the paths written, one a table, or one in all for "mat".

    Units stand in the column names. ``format`` is "parquet", "csv" or "mat", in which texts are matrices of characters,
    padded with blanks; or "candump", for the CAN frames alone. Raises UsageError for another format or an unreadable
    recording, ExperimentError where the files cannot be written.
    """
    if format not in WRITERS:
        raise UsageError(f"cannot export to {format!r}; choose one of {', '.join(WRITERS)}")
    recording = read_recording(path)
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        return WRITERS[format](recording, out_dir, path.stem)
    except OSError as error:
        raise ExperimentError(f"cannot write to {out_dir}: {error.strerror or error}; choose another folder") from error


def tables_of(recording: Recording) -> dict[str, Columns]:
    """Every table by its name, as columns of equal length; frames' data in hexadecimal."""
    measured = recording.measured
    tables = {table.name: _columns(getattr(measured, table.name)) for table in TABLES}
    tables["segments"] = {
        name: np.array([getattr(segment, name) for segment in measured.segments])
        for name in ("index", "procedure", "name", "mode", "start_ns", "end_ns", "preview")
    } | {"use": np.array([segment.use.value for segment in measured.segments])}
    tables["events"] = {
        name: np.array([getattr(event, name) for event in measured.events]) for name in ("stamp_ns", "kind", "text")
    }
    tables["frames"] = {
        name: np.array([getattr(frame, name) for frame in measured.frames])
        for name in ("stamp_ns", "channel", "sent", "arbitration_id", "extended", "remote", "fd", "switched")
    } | {"data_hex": np.array([frame.data.hex() for frame in measured.frames])}
    tables["estimates"] = _estimates(recording)
    return tables


def _columns(table: npt.NDArray[np.void]) -> Columns:
    return {name: np.ascontiguousarray(table[name]) for name in table.dtype.names or ()}


def _estimates(recording: Recording) -> Columns:
    """One row for each estimate of each moment."""
    rows = [(live, estimate) for live in recording.live for estimate in live.estimates]
    return {
        "stamp_ns": np.array([live.stamp_ns for live, _ in rows], np.int64),
        "samples": np.array([live.samples for live, _ in rows], np.int64),
        "parameter": np.array([estimate.name for _, estimate in rows]),
        "value": np.array([estimate.value for _, estimate in rows], np.float64),
        "std": np.array([estimate.std for _, estimate in rows], np.float64),
        "unit": np.array([estimate.unit for _, estimate in rows]),
        "status": np.array([estimate.status.value for _, estimate in rows]),
    }


def _write_parquet(recording: Recording, out_dir: Path, stem: str) -> list[Path]:
    pa, pq = extra("pyarrow", "Parquet"), extra("pyarrow.parquet", "Parquet")

    paths = []
    for name, columns in tables_of(recording).items():
        paths.append(out_dir / f"{stem}.{name}.parquet")
        pq.write_table(pa.table({column: pa.array(values) for column, values in columns.items()}), paths[-1])
    return paths


def _write_csv(recording: Recording, out_dir: Path, stem: str) -> list[Path]:
    pa, csv = extra("pyarrow", "CSV"), extra("pyarrow.csv", "CSV")

    paths = []
    for name, columns in tables_of(recording).items():
        paths.append(out_dir / f"{stem}.{name}.csv")
        csv.write_csv(pa.table({column: pa.array(values) for column, values in columns.items()}), str(paths[-1]))
    return paths


def _write_mat(recording: Recording, out_dir: Path, stem: str) -> list[Path]:
    from scipy.io import savemat  # noqa: PLC0415

    path = out_dir / f"{stem}.mat"
    # Texts become matrices of characters, a row each: as cells, a minute's frames would take half a minute to write.
    tables = {name: dict(columns) for name, columns in tables_of(recording).items()}
    savemat(path, tables, oned_as="column", do_compression=True, long_field_names=True)
    return [path]


def _write_candump(recording: Recording, out_dir: Path, stem: str) -> list[Path]:
    path = log_name(out_dir / f"{stem}.mcap")
    with path.open("xb") as file:  # the session's own may stand there
        file.write(log_lines(Frames.of(recording.measured.frames)))
    return [path]


WRITERS: dict[str, Callable[[Recording, Path, str], list[Path]]] = {
    "parquet": _write_parquet,
    "csv": _write_csv,
    "mat": _write_mat,
    "candump": _write_candump,
}
