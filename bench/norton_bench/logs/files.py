"""Foreign log files of every kind to named arrays and numbers. Nested names are joined by "/": "group/dataset"."""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError, nearest
from norton_bench.logs.bags import is_bag, read_bag
from norton_bench.logs.column_map import LogSection
from norton_bench.logs.long_table import by_name
from norton_bench.logs.messages import Columns
from norton_bench.logs.text_table import read_text_table
from norton_bench.on_demand import extra
from norton_bench.units import check_unit

BAG = "bag"
SUFFIXES = {
    ".csv": "csv",
    ".txt": "csv",
    ".tsv": "tsv",
    ".tab": "tsv",
    ".mat": "mat",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".hdf": "hdf5",
    ".parquet": "parquet",
    ".pq": "parquet",
    ".jsonl": "jsonl",
    ".ndjson": "jsonl",
    ".json": "json",
    ".mcap": BAG,
    ".db3": BAG,
    ".bag": BAG,
}
# What a reader has to say of the file, beside its columns.
REMARKS = "\0remarks"
TIME_OF_DAY = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:\.\d*)?)")
DAY_S = 86400.0
# A unit behind a name: "tau [Nm]", "q (deg)".
UNIT = re.compile(r"\s*[\[(]([^\])]*)[\])]\s*")


@dataclass(frozen=True)
class Content:
    """What a log file holds: ``arrays`` of numbers, one-dimensional and not all of one length, and single numbers.

    ``unreadable`` says of a name why it is no array of numbers, ``remarks`` what was set aside. Where every column has
    times of its own, in seconds of one clock, they are in ``times_s`` by the column's name.
    """

    place: str
    arrays: Mapping[str, FloatArray]
    numbers: Mapping[str, float]
    unreadable: Mapping[str, str]
    remarks: tuple[str, ...] = ()
    times_s: Mapping[str, FloatArray] = field(default_factory=dict)

    def unit(self, name: str) -> str:
        """The unit as it is written behind the name; empty for none. What a bag has there is a joint."""
        return "" if self.times_s else split_unit(self.spelt(name))[1]

    def spelt(self, name: str) -> str:
        """The name as it stands in the file: a unit in brackets behind it need not be repeated."""
        if name in self.arrays or name in self.unreadable:
            return name
        bare = [each for each in (*self.arrays, *self.unreadable) if split_unit(each)[0] == name]
        return bare[0] if len(bare) == 1 else name

    def array(self, name: str, where: str) -> FloatArray:
        """Raises UsageError with the nearest names; ``where`` is the place in the map that asks."""
        name = self.spelt(name)
        if name in self.unreadable:
            raise UsageError(f'{self.place}: "{name}" ({where}) {self.unreadable[name]}')
        if name not in self.arrays:
            raise UsageError(f'{self.place}: holds no "{name}" ({where}); {nearest(name, self.arrays)}')
        return self.arrays[name]

    def number(self, name: str, where: str) -> float:
        """A single number, or the one value that a column keeps throughout. Raises UsageError."""
        if name in self.numbers:
            return self.numbers[name]
        if name in self.arrays and np.all(self.arrays[name] == self.arrays[name][0]):
            return float(self.arrays[name][0])
        if name in self.arrays:
            raise UsageError(f'{self.place}: "{name}" ({where}) changes; a known value must be a single number')
        raise UsageError(f'{self.place}: holds no number "{name}" ({where}); {nearest(name, self.numbers)}')


def split_unit(name: str) -> tuple[str, str]:
    """A name and the unit in brackets behind it, which may be empty."""
    found = UNIT.search(name)
    if found is None or found.end() < len(name) or found.start() == 0:
        return name, ""
    return name[: found.start()], found[1].strip()


# As people write them, and as units are written here.
SPELT = {
    "sec": "s",
    "seconds": "s",
    "msec": "ms",
    "usec": "us",
    "Nm": "N*m",
    "N.m": "N*m",
    "N·m": "N*m",
    "N-m": "N*m",
    "mNm": "mN*m",
    "Ncm": "N*cm",
    "°": "deg",
    "°/s": "deg/s",
    "dps": "deg/s",
    "deg/sec": "deg/s",
    "rad/sec": "rad/s",
    "°C": "degC",
    "C": "degC",
    "Celsius": "degC",
    "celsius": "degC",
    "Amps": "A",
    "amp": "A",
    "volt": "V",
    "Volts": "V",
}


def plain_unit(text: str) -> str:
    """A unit as people write it behind a name, in this program's spelling. Raises ValueError where there is none."""
    unit = SPELT.get(text.strip(), text.strip().replace("^-1", ""))
    if not unit:
        raise ValueError("no unit")
    return check_unit(unit)


def kind_of(path: Path) -> str | None:
    """By the end of its name, or by what the folder holds; None where that tells nothing."""
    return BAG if is_bag(path) else SUFFIXES.get(path.suffix.lower())


def read_file(path: Path, section: LogSection) -> Content:
    """Everything in the file. Raises UsageError, in a sentence, where it cannot be read."""
    kind = section.format or kind_of(path)
    if kind is None:
        known = ", ".join(sorted(set(SUFFIXES.values())))
        raise UsageError(f'{path}: its kind is not known by its name; write [log] format = "..." (one of {known})')
    if not path.is_file() and not (kind == BAG and is_bag(path)):
        raise UsageError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}; check the path")
    if path.stat().st_size == 0:
        raise UsageError(f"{path}: is empty; check how it was written")
    try:
        if kind == BAG:
            return _of_streams(path, read_bag(path), ())
        result = READERS[kind](path, section)
    except UsageError:
        raise
    except Exception as wrong:  # each library has errors of its own
        first = (
            "".join(filter(str.isprintable, str(wrong).splitlines()[0][:80])) if str(wrong) else type(wrong).__name__
        )
        raise UsageError(
            f"{path}: cannot be read as {kind} ({first}); check the file, or write [log] format"
        ) from wrong
    streams = by_name(result)
    if streams is not None:
        return _of_streams(path, streams, result.get(REMARKS))
    return _content(path, result)


def _of_streams(path: Path, columns: Columns, remarks: object) -> Content:
    said = remarks if isinstance(remarks, tuple) else ()
    return Content(str(path), columns.arrays, {}, {}, (*said, *columns.remarks), columns.times_s)


def _content(path: Path, result: Mapping[str, object]) -> Content:
    arrays: dict[str, FloatArray] = {}
    numbers: dict[str, float] = {}
    unreadable: dict[str, str] = {}
    remarks = result.get(REMARKS, ())
    result = {name: value for name, value in result.items() if name != REMARKS}
    for name, value in _flat(result, ""):
        try:
            array = np.asarray(value).astype(np.float64)
        except (TypeError, ValueError):
            unreadable[name] = _no_numbers(value)
            continue
        squeezed = np.squeeze(array)
        if squeezed.ndim == 0:
            numbers[name] = float(squeezed)
        elif squeezed.ndim == 1:
            arrays[name] = squeezed
        elif squeezed.ndim == 2:
            rows = squeezed if squeezed.shape[0] <= squeezed.shape[1] else squeezed.T
            arrays.update({f"{name}[{index}]": np.ascontiguousarray(row) for index, row in enumerate(rows)})
        else:
            unreadable[name] = f"has {squeezed.ndim} dimensions; a column has one"
    if not arrays:
        raise UsageError(f"{path}: holds no column of numbers; check the file, its separator, or [log] entries")
    return Content(str(path), arrays, numbers, unreadable, tuple(remarks) if isinstance(remarks, tuple) else ())


def _no_numbers(value: object) -> str:
    """Where a column holds something else than numbers."""
    if isinstance(value, (list, np.ndarray)):
        for row, each in enumerate(value, 1):
            try:
                float(each)
            except (TypeError, ValueError):
                return f"is no number in row {row} ({each!r}); leave such rows out, or empty"
    return "holds no numbers"


def _flat(result: Mapping[str, object], prefix: str) -> Iterator[tuple[str, object]]:
    for name, value in result.items():
        place = f"{prefix}{str(name).strip()}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{place}/")
        else:
            yield place, value


def _read_text_table(path: Path, section: LogSection) -> dict[str, object]:
    table = read_text_table(path, section)
    return _arrow_columns(path, table.names, table.columns) | {REMARKS: table.remarks}


def _read_parquet(path: Path, _: LogSection) -> dict[str, object]:
    parquet = extra("pyarrow.parquet", "reading Parquet")

    table = parquet.read_table(path).flatten()
    return _arrow_columns(path, [name.replace(".", "/") for name in table.column_names], table.columns)


def _arrow_columns(path: Path, names: Sequence[str], columns: Sequence[Any]) -> dict[str, object]:
    """Columns of an Arrow table; what is missing is NaN."""
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise UsageError(f'{path}: the column "{min(repeated)}" is there more than once; rename one in its first line')
    values: dict[str, object] = {}
    for name, column in zip(names, columns, strict=True):
        values[name] = _arrow_values(column)
    return values


def _arrow_values(column: Any) -> npt.NDArray[Any]:
    kind = str(column.type)
    if kind.startswith(("timestamp", "duration")):
        # The unit of a stamp stands in its type; as a number it is in seconds.
        ns = column.cast("timestamp[ns]" if kind.startswith("timestamp") else "duration[ns]").cast("int64")
        return np.asarray(ns.to_numpy(), dtype=np.float64) * 1e-9
    if kind.startswith("time"):
        column = column.cast("string")
    if "string" in str(column.type):
        words = column.to_pylist()
        of_day_s = _of_day_s(words)
        return np.asarray(words, dtype=object) if of_day_s is None else of_day_s
    return np.asarray(column.cast("double").to_numpy() if kind in ("bool", "null") else column.to_numpy())


def _read_mat(path: Path, section: LogSection) -> dict[str, object]:
    """MATLAB's files up to version 7 by scipy; version 7.3 is HDF5."""
    from scipy.io import loadmat  # noqa: PLC0415  (slow to import)

    try:
        result = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        return _read_hdf5(path, section)
    return {name: value for name, value in result.items() if not name.startswith("__")}


def _of_day_s(words: Sequence[str | None]) -> FloatArray | None:
    """Times of day, such as "23:59:59.995", in seconds, also past midnight; None where they are something else."""
    matches = [TIME_OF_DAY.fullmatch(each.strip()) if each else None for each in words]
    if not any(matches) or any(each is not None and match is None for each, match in zip(words, matches, strict=True)):
        return None
    parts = [(float(m[1]), float(m[2]), float(m[3])) if m else (np.nan, np.nan, np.nan) for m in matches]
    time_s = np.array(parts) @ [3600.0, 60.0, 1.0]
    known = np.flatnonzero(np.isfinite(time_s))
    time_s[known] = np.unwrap(time_s[known], period=DAY_S)
    return np.asarray(time_s)


def _read_hdf5(path: Path, _: LogSection) -> dict[str, object]:
    h5py = extra("h5py", "reading HDF5, or MATLAB's files since version 7.3,")

    result: dict[str, object] = {}

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            value = item[()]
            names = getattr(value, "dtype", None) and value.dtype.names
            whole = f"{name}{_unit_behind(item.attrs)}" if np.ndim(value) else name
            result.update({f"{name}/{field}": value[field] for field in names} if names else {whole: value})

    with h5py.File(path) as file:
        file.visititems(visit)
        result.update({name: value for name, value in file.attrs.items() if name not in result})
    return result


def _unit_behind(attributes: Mapping[str, object]) -> str:
    """The unit that a dataset's attributes give, as it stands behind a name."""
    for key in ("units", "unit"):
        value = attributes.get(key)
        text = value.decode() if isinstance(value, bytes) else value
        if isinstance(text, str) and text.strip():
            return f" [{text.strip()}]"
    return ""


def _read_json_lines(path: Path, _: LogSection) -> dict[str, object]:
    entries = []
    with path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            if not line.strip():
                continue
            try:
                entries.append(json.loads(line))
            except json.JSONDecodeError as wrong:
                raise UsageError(f"{path}: line {number} is not JSON ({wrong.msg}); cut it out or mend it") from None
    return _from_entries(path, entries)


def _read_json(path: Path, section: LogSection) -> dict[str, object]:
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as wrong:
        raise UsageError(f"{path}: is not JSON at line {wrong.lineno} ({wrong.msg}); mend it there") from None
    if isinstance(result, list):
        return _from_entries(path, result)
    if not isinstance(result, dict):
        raise UsageError(f"{path}: is neither a list of entries nor a table of columns; check the file")
    if section.entries is None:
        return result
    entries: object = result
    for step in section.entries.split("/"):
        entries = entries.get(step) if isinstance(entries, dict) else None
    if not isinstance(entries, list):
        raise UsageError(
            f'{path}: holds no list "{section.entries}" ([log] entries); {nearest(section.entries, result)}'
        )
    return {
        **{key: value for key, value in result.items() if not isinstance(value, list)},
        **_from_entries(path, entries),
    }


def _from_entries(path: Path, entries: Sequence[object]) -> dict[str, object]:
    """A list of rows as columns; what a row lacks is NaN."""
    rows = []
    for number, entry in enumerate(entries, 1):
        if not isinstance(entry, dict):
            raise UsageError(f"{path}: entry {number} is no table of names and values; check [log] entries")
        rows.append(dict(_flat(entry, "")))
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [_or_nan(row.get(name)) for row in rows] for name in names}


def _or_nan(value: object) -> object:
    return float("nan") if value is None else value


READERS: Mapping[str, Callable[[Path, LogSection], dict[str, object]]] = {
    "csv": _read_text_table,
    "tsv": _read_text_table,
    "mat": _read_mat,
    "hdf5": _read_hdf5,
    "parquet": _read_parquet,
    "json": _read_json,
    "jsonl": _read_json_lines,
}
