"""Every kind of file gives the same numbers, and what cannot be read is said."""

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from norton_bench.errors import UsageError
from norton_bench.logs.column_map import LogSection
from norton_bench.logs.files import read_file
from norton_bench.logs.log import read_log
from tests.bench.logs.machines import FREE, Columns, Machine, column_map, write_csv

SHORT = Machine(rate_hz=50.0, duration_s=4.0)
SECTION = LogSection(motion="rotation", entries="entries")


def as_tsv(path: Path, columns: Columns) -> None:
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, table, delimiter="\t", header="\t".join(columns), comments="", fmt="%.17g")


def as_csv(path: Path, columns: Columns) -> None:
    path.write_text(
        ";".join(columns)
        + "\n"
        + "\n".join(";".join(map(repr, map(float, row))) for row in zip(*columns.values(), strict=True))
    )


def as_mat(path: Path, columns: Columns) -> None:
    savemat(path, {name: values[:, None] for name, values in columns.items()} | {"mass": 0.5})


def as_hdf5(path: Path, columns: Columns) -> None:
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[f"run/{name}"] = values[None, :]
        file.attrs["mass"] = 0.5


def as_mat73(path: Path, columns: Columns) -> None:
    """As MATLAB writes version 7.3: HDF5 behind a header of its own."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in columns.items():
            file[name] = values[None, :]
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def as_parquet(path: Path, columns: Columns) -> None:
    pq.write_table(pa.table(columns), path)


def rows_of(columns: Columns) -> list[dict[str, float]]:
    return [dict(zip(columns, map(float, row), strict=True)) for row in zip(*columns.values(), strict=True)]


def as_jsonl(path: Path, columns: Columns) -> None:
    path.write_text("\n".join(map(json.dumps, rows_of(columns))))


def as_json(path: Path, columns: Columns) -> None:
    path.write_text(json.dumps({"mass": 0.5, "motor": "x", "entries": rows_of(columns)}))


KINDS: dict[str, Callable[[Path, Columns], None]] = {
    "log.tsv": as_tsv,
    "log.csv": as_csv,
    "log.mat": as_mat,
    "log.h5": as_hdf5,
    "73.mat": as_mat73,
    "log.parquet": as_parquet,
    "log.jsonl": as_jsonl,
    "log.json": as_json,
}


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_file_gives_the_same_numbers(tmp_path: Path, name: str) -> None:
    columns = SHORT.log()
    KINDS[name](tmp_path / name, columns)
    content = read_file(tmp_path / name, SECTION)
    folder = "run/" if name.endswith(".h5") else ""
    for column, values in columns.items():
        np.testing.assert_array_equal(content.array(f"{folder}{column}", "here"), values)
    if name in ("log.mat", "log.h5", "log.json"):
        assert content.number("mass", "here") == 0.5


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("x.csv", "", "is empty"),
        ("x.log", "t,q\n1,2\n", 'its kind is not known by its name; write [log] format = "..."'),
        ("x.json", "{", "is not JSON at line 1"),
        ("x.json", '{"a": 1}', 'holds no list "entries"'),
        ("x.jsonl", '{"t": 1}\n{"t": \n', "line 2 is not JSON"),
        ("x.mat", "no matlab", "cannot be read as mat"),
        ("x.h5", "no hdf", "cannot be read as hdf5"),
        ("x.parquet", "no parquet", "cannot be read as parquet"),
        ("x.csv", "t,q,q\n1,2,3\n", 'the column "q" is there more than once'),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(UsageError) as raised:
        read_file(tmp_path / name, SECTION)
    assert str(raised.value).startswith(str(tmp_path / name))
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_column_that_is_not_there_is_named_with_the_nearest(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", SHORT.log())
    with pytest.raises(UsageError, match=r'holds no "uu" \(\[columns\] command of map.toml\); did you mean "u2"|"u"'):
        read_log(path, column_map(FREE.replace('"u"', '"uu"')))


def test_words_among_numbers_are_named_with_their_row(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,q,u\n" + "\n".join(f"{k},{'off' if k == 3 else k},1" for k in range(80)))
    with pytest.raises(UsageError, match=r'"q" \(\[columns\] position of map.toml\) is no number in row 4 \(\'off\'\)'):
        read_log(path, column_map(FREE))


def test_a_table_needs_a_time_or_a_rate(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", SHORT.log())
    with pytest.raises(UsageError, match=r"\[columns\] time of map.toml is missing; add time = .*, or \[log\] rate"):
        read_log(path, column_map(FREE.replace('time = { name = "t", unit = "s" }', "")))


def test_units_scale_offset_sign_and_complement(tmp_path: Path) -> None:
    rows = np.arange(60.0)
    path = write_csv(tmp_path / "log.csv", {"t": rows, "q": rows, "u": np.where(rows % 2, 65535.0, 3.0)})
    text = FREE.replace('{ name = "t", unit = "s" }', '{ name = "t", unit = "ms" }')
    text = text.replace(
        '{ name = "q", unit = "rad" }', '{ name = "q", unit = "deg", scale = 2, offset = 3, sign = -1 }'
    )
    text = text.replace('{ name = "u", unit = "A" }', '{ name = "u", unit = "mA", bits = 16 }')
    log = read_log(path, column_map(text.replace("N*m/A", "N*m/mA")))
    np.testing.assert_allclose(log.time_s, rows / 1000)
    np.testing.assert_allclose(log.columns["position"], -np.deg2rad(2 * rows + 3))
    # A command keeps the unit that it is written in.
    np.testing.assert_array_equal(log.columns["command"], np.where(rows % 2, -1.0, 3.0))
    assert log.given("actuator", "torque_gain") == pytest.approx(2.0)


def test_text_tables_with_lines_before_flags_and_no_names(tmp_path: Path) -> None:
    rows = [f"{k},{k / 2},{'true' if k % 2 else 'false'}" for k in range(80)]
    (tmp_path / "log.csv").write_text("\n".join(["made by a scope", "t,q,on", *rows]))
    content = read_file(tmp_path / "log.csv", LogSection(motion="rotation", skip=1))
    np.testing.assert_array_equal(content.array("on", "here"), np.arange(80) % 2)
    (tmp_path / "log.csv").write_text("\n".join(rows))
    content = read_file(tmp_path / "log.csv", LogSection(motion="rotation", header=False))
    np.testing.assert_array_equal(content.array("column 2", "here"), np.arange(80) / 2)


def test_numbers_of_the_file_itself_are_known_values(tmp_path: Path) -> None:
    as_json(tmp_path / "log.json", SHORT.log())
    text = FREE.replace('motion = "rotation"', 'motion = "rotation"\nentries = "entries"')
    text += '[load]\ngravity = { keys = ["mass", "mass"], scale = 9.81, unit = "N*m" }\n'
    text += 'inertia = { key = "nothing", unit = "kg*m^2", default = 0.25 }\n'
    log = read_log(tmp_path / "log.json", column_map(text))
    assert log.given("load", "gravity") == pytest.approx(9.81 / 4)
    assert log.given("load", "inertia") == 0.25
    with pytest.raises(UsageError, match='holds no number "nothing"'):
        read_log(tmp_path / "log.json", column_map(text.replace(", default = 0.25", "")))


def test_units_in_the_attributes_of_a_dataset_stand_behind_its_name(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, unit in (("angle", "deg"), ("speed", b"rpm"), ("tau", None)):
            file[name] = np.arange(5.0)
            if unit is not None:
                file[name].attrs["units"] = unit
    content = read_file(tmp_path / "log.h5", LogSection(motion="rotation"))
    assert [content.unit(name) for name in ("angle", "speed", "tau")] == ["deg", "rpm", ""]
    assert content.array("angle", "here") == pytest.approx(np.arange(5.0))


def test_times_of_day_are_seconds_also_past_midnight(tmp_path: Path) -> None:
    rows = [f"{hour}:{minute:02}:{second},{k},{k},{k}" for k, (hour, minute, second) in enumerate(NIGHT)]
    (tmp_path / "log.csv").write_text("\n".join(["clock,q,w,u", *rows]))
    content = read_file(tmp_path / "log.csv", LogSection(motion="rotation"))
    assert np.diff(content.array("clock", "here")) == pytest.approx([0.005, 0.005, 0.005], abs=1e-6)


NIGHT = [(23, 59, "59.990"), (23, 59, "59.995"), (0, 0, "00.000"), (0, 0, "00.005")]
