"""Tables as people write them: the same numbers come out of every one."""

from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import UsageError
from norton_bench.logs.column_map import LogSection
from norton_bench.logs.files import plain_unit, read_file, split_unit
from norton_bench.logs.log import read_log
from tests.bench.logs.machines import column_map

SECTION = LogSection(motion="rotation")
ROWS = [(0.01 * k, round(np.sin(0.05 * k), 6), round(0.5 * np.cos(0.05 * k), 6)) for k in range(80)]


def table(separator: str = ",", end: str = "", comma: bool = False) -> list[str]:
    lines = [separator.join(f"{value:.6f}" for value in row) + end for row in ROWS]
    return [line.replace(".", ",") for line in lines] if comma else lines


UGLY: dict[str, list[str]] = {
    "comments before and between": [
        "# rig 7, 2026-03-02",
        "# by hand",
        "t,q,u",
        *table()[:9],
        "# paused",
        *table()[9:],
    ],
    "a comma at the end of every row": ["t,q,u", *table(end=",")],
    "a comma at the end of the header too": ["t,q,u,", *table(end=",")],
    "a line of units": ["t,q,u", "s,deg,A", *table()],
    "units in the header": ["t [s],q [deg],u (A)", *table()],
    "semicolons and decimal commas": ["t;q;u", *table(";", comma=True)],
    "preamble of a scope": ["Model,DL850", "Date,2026-03-02", "", "t,q,u", *table()],
    "the header as a comment": ["# t q u", *table(" ")],
    "quotes around decimal commas": [
        "t,q,u",
        *(",".join(f'"{c}"' for c in line.split(";")) for line in table(";", comma=True)),
    ],
    "a text in quotes": ["t,q,u,state", *(f'{line},"moving, ok"' for line in table())],
    "blanks in any number": ["t    q  u", *("   ".join(line.split(",")) for line in table())],
    "the header again in the middle": ["t,q,u", *table()[:40], "t,q,u", *table()[40:]],
    "quoted names and tabs": ['"t"\t"q"\t"u"', *table("\t")],
    "Windows line ends": ["t,q,u\r", *(f"{line}\r" for line in table())],
}


@pytest.mark.parametrize("name", UGLY)
def test_an_ugly_file_gives_the_same_numbers(tmp_path: Path, name: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join(UGLY[name]).encode())
    content = read_file(path, SECTION)
    for index, column in enumerate("tqu"):
        np.testing.assert_allclose(content.array(column, "here"), [row[index] for row in ROWS], atol=1e-9)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_what_a_spreadsheet_saves(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join(["t,q,u", *table()]).encode(encoding))
    assert read_file(path, SECTION).array("t", "here").size == 80


def test_a_degree_as_old_spreadsheets_save_it(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join(["t [s],q [°],u [A]", *table()]).encode("cp1252"))
    assert list(read_file(path, SECTION).arrays) == ["t [s]", "q [°]", "u [A]"]


@pytest.mark.parametrize("word", ["-", "n/a", "NaN", "None", ""])
def test_what_stands_for_no_number_is_missing(tmp_path: Path, word: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t,q,u", *table()[:40], f"{ROWS[40][0]},{word},0.1", *table()[41:]]))
    assert np.flatnonzero(np.isnan(read_file(path, SECTION).array("q", "here"))).tolist() == [40]


@pytest.mark.parametrize("words", ["emergency,stop,pressed", "emergency stop", "emergency stop,,"])
def test_what_was_set_aside_is_told(tmp_path: Path, words: str) -> None:
    path = tmp_path / "log.csv"
    lines = ["t,q,u", *table()]
    lines[10] = "0.09,0.43"
    lines[20] = words
    path.write_text("\n".join(lines))
    content = read_file(path, SECTION)
    assert np.isnan(content.array("u", "here")[9])
    assert any("1 lines of words among the rows (first line 21)" in said for said in content.remarks)
    assert any("1 rows lack cells (first in line 11)" in said for said in content.remarks)


def test_a_row_with_more_cells_than_columns_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t,q,u", *table()[:30], "1,2,3,4", *table()[30:]]))
    with pytest.raises(UsageError, match=r"line 32 has 4 cells where the table has 3 columns"):
        read_file(path, SECTION)


def test_a_file_of_words_is_no_table(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("# nothing\n\n# at all\n")
    with pytest.raises(UsageError, match="holds no table of numbers"):
        read_file(path, SECTION)


MAP = """
[log]
motion = "rotation"
[columns]
time = "t"
position = "q"
command = { name = "u", unit = "A" }
"""


def test_units_behind_the_names_count_where_the_map_gives_none(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t [ms],q [deg],u", *table()]))
    log = read_log(path, column_map(MAP))
    assert log.time_s[1] == pytest.approx(1e-5)
    np.testing.assert_allclose(log.columns["position"], np.deg2rad([row[1] for row in ROWS]))
    path.write_text("\n".join(["t [s],q,u", *table()]))
    with pytest.raises(UsageError, match=r"position of map.toml gives no unit, and none stands behind its name; write"):
        read_log(path, column_map(MAP))
    path.write_text("\n".join(["t [s],q [cubits],u", *table()]))
    with pytest.raises(UsageError, match='"cubits" behind its name is none that is known here'):
        read_log(path, column_map(MAP))


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("tau [Nm]", ("tau", "Nm")),
        ("q (deg)", ("q", "deg")),
        ("q[0]", ("q", "0")),
        ("plain", ("plain", "")),
        ("[x]", ("[x]", "")),
    ],
)
def test_a_name_and_the_unit_behind_it(name: str, parts: tuple[str, str]) -> None:
    assert split_unit(name) == parts


@pytest.mark.parametrize(("written", "unit"), [("Nm", "N*m"), ("°/s", "deg/s"), ("rad/s", "rad/s"), ("sec", "s")])
def test_units_as_people_write_them(written: str, unit: str) -> None:
    assert plain_unit(written) == unit
