"""Text tables as people write them: what stands around the numbers is set aside, and pyarrow reads the rest.

Comments, lines before the table, a second line of units, rows with a comma too many or cells too few, decimal commas,
and the byte order marks of spreadsheets. A row that cannot be a row is named with its line.
"""

import re
from collections import Counter
from collections.abc import Sequence
from csv import reader as csv_lines
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from norton_bench.errors import UsageError
from norton_bench.logs.column_map import LogSection
from norton_bench.on_demand import extra

SEPARATORS = ("\t", ";", ",")
COMMENTS = ("#", "%", "//")
# The first lines, of which a table is made out.
LOOKED_AT = 200
# A number with a point or a comma; what spreadsheets write where there is none; words for flags.
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?")
NOTHING = ("", "nan", "na", "n/a", "null", "none", "-", "inf", "-inf", "+inf", "true", "false", "#n/a")
# Those of them that stand for no number, as they may be written.
NULLS = ["", "nan", "NaN", "NAN", "na", "NA", "n/a", "N/A", "#N/A", "null", "NULL", "none", "None", "-"]
STAMP = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*")
# A whole log in one block: the types of columns are then found from all of it.
BLOCK_BYTES = 1 << 30


@dataclass(frozen=True)
class TextTable:
    """``names`` are those of the header, ``rows`` Arrow columns; ``remarks`` say what was set aside."""

    names: tuple[str, ...]
    columns: Sequence[Any]
    remarks: tuple[str, ...]


def read_text_table(path: Path, section: LogSection) -> TextTable:
    """Raises UsageError for a file without a table, or a row with more cells than the table has columns."""
    lines = _lines(path, section.skip)
    separator = section.separator or _separator(lines)
    first = _first_row(lines, separator)
    if first == len(lines):
        raise UsageError(_no_table(path))
    header = _header(lines[:first], separator, section)
    rows = lines[first:]
    width = _width(header, rows, separator)
    names = _names(header, width)
    text, remarks = _even(path, rows, width, separator)
    csv = extra("pyarrow.csv", "reading CSV")
    table = csv.read_csv(
        BytesIO(text.encode()),
        read_options=csv.ReadOptions(use_threads=False, block_size=BLOCK_BYTES, autogenerate_column_names=True),
        parse_options=csv.ParseOptions(delimiter=separator),
        convert_options=csv.ConvertOptions(
            null_values=NULLS, strings_can_be_null=True, decimal_point="," if _decimal_comma(rows, separator) else "."
        ),
    )
    return TextTable(names, table.columns, remarks)


def _no_table(path: Path) -> str:
    return f"{path} is not an MCAP recording, and holds no table of numbers; name a .mcap file, or a log"


def _lines(path: Path, skip: int) -> list[tuple[int, str]]:
    """Number and text of every line that is neither empty nor a comment; that of the header may be one."""
    raw = path.read_bytes()
    numbered = list(enumerate(_decoded(raw).splitlines(), 1))[skip:]
    kept = [(number, line) for number, line in numbered if line.strip() and not line.lstrip().startswith(COMMENTS)]
    # numpy writes its header as a comment: it counts where nothing else names the columns.
    marked = [(n, line.lstrip().lstrip("#%/ ")) for n, line in numbered if line.lstrip().startswith(COMMENTS)]
    if marked and kept and marked[-1][0] < kept[0][0]:
        kept.insert(0, marked[-1])
    if not kept:
        raise UsageError(_no_table(path))
    return kept


def _decoded(raw: bytes) -> str:
    """As spreadsheets write: UTF-8, UTF-16 with or without its mark, or the old code page of Western Europe."""
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16", errors="replace")
    # In tables every other byte of UTF-16 is zero.
    if b"\0" in raw[:4]:
        return raw.decode("utf-16-be" if raw[:1] == b"\0" else "utf-16-le", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _separator(lines: Sequence[tuple[int, str]]) -> str:
    """That of tab, semicolon and comma which stands most often in a line, in most lines; blanks where there is none."""
    sample = [line for _, line in lines[-LOOKED_AT:]]
    for separator in SEPARATORS:
        if sum(separator in line for line in sample) > len(sample) // 2:
            return separator
    return "," if len(sample[0].split()) < 2 else " "


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        cells = line.split()
    elif '"' in line:
        # What is in quotes may hold the separator: a decimal comma, or one in a text, which no number needs.
        cells = [_without(cell.strip(), separator) for cell in next(csv_lines([line], delimiter=separator))]
    else:
        cells = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in cells]


def _without(cell: str, separator: str) -> str:
    decimal = separator == "," and NUMBER.fullmatch(cell) is not None
    return cell.replace(separator, "." if decimal else " ")


def _numeric(cells: Sequence[str]) -> bool:
    """Whether a row can be one of numbers: at least one is, and most are or are missing."""
    numbers = sum(NUMBER.fullmatch(cell) is not None or STAMP.fullmatch(cell) is not None for cell in cells)
    other = sum(cell.lower() in NOTHING for cell in cells)
    return numbers > 0 and 2 * (numbers + other) > len(cells)


def _first_row(lines: Sequence[tuple[int, str]], separator: str) -> int:
    """The first line that is of numbers and as wide as those that follow."""
    widths = Counter(len(_cells(line, separator)) for _, line in lines[-LOOKED_AT:])
    usual = widths.most_common(1)[0][0]
    for index, (_, line) in enumerate(lines):
        cells = _cells(line, separator)
        if _numeric(cells) and len(cells) >= usual - 1:
            return index
    return len(lines)


def _header(before: Sequence[tuple[int, str]], separator: str, section: LogSection) -> tuple[list[str], list[str]]:
    """The names, and the units where a line of their own has them; both empty for a table without a header."""
    if not section.header or not before:
        return [], []
    rows = [_cells(line, separator) for _, line in before]
    if len(rows) > 1 and len(rows[-1]) == len(rows[-2]) > 1:
        return rows[-2], rows[-1]
    return rows[-1], []


def _width(header: tuple[list[str], list[str]], rows: Sequence[tuple[int, str]], separator: str) -> int:
    """How many columns there are: as many as are named, or as most rows have."""
    names = header[0]
    while names and not names[-1]:
        names.pop()
    if names:
        return len(names)
    widths = Counter(len(_cells(line, separator)) for _, line in rows[:LOOKED_AT])
    return widths.most_common(1)[0][0] if widths else 0


def _names(header: tuple[list[str], list[str]], width: int) -> tuple[str, ...]:
    names, units = header
    if not names:
        return tuple(f"column {index}" for index in range(1, width + 1))
    units = [*units, *[""] * width]
    return tuple(f"{name} [{unit.strip('[]() ')}]" if unit else name for name, unit in zip(names, units, strict=False))


def _even(path: Path, rows: Sequence[tuple[int, str]], width: int, separator: str) -> tuple[str, tuple[str, ...]]:
    """All rows with as many cells as there are columns; rows of words in between are left out, and told."""
    result: list[str] = []
    words: list[int] = []
    short: list[int] = []
    for number, line in rows:
        cells = _cells(line, separator)
        while len(cells) > width and not cells[-1]:
            cells.pop()
        if len(cells) > width:
            raise UsageError(
                f"{path}: line {number} has {len(cells)} cells where the table has {width} columns; mend that line, or "
                "write [log] separator"
            )
        if width > 1 and _of_words(cells):
            words.append(number)
            continue
        if len(cells) < width:
            short.append(number)
        result.append(separator.join(cells + [""] * (width - len(cells))))
    return "\n".join(result) + "\n", tuple(_told(path, words, short))


def _of_words(cells: Sequence[str]) -> bool:
    """Whether a row says something, and no number."""
    said = [cell for cell in cells if cell.lower() not in NOTHING]
    return bool(said) and not any(NUMBER.fullmatch(cell) or STAMP.fullmatch(cell) for cell in said)


def _told(path: Path, words: Sequence[int], short: Sequence[int]) -> list[str]:
    result = []
    if words:
        result.append(f"{path}: {len(words)} lines of words among the rows (first line {words[0]}), left out.")
    if short:
        result.append(f"{path}: {len(short)} rows lack cells (first in line {short[0]}); what they lack is missing.")
    return result


def _decimal_comma(rows: Sequence[tuple[int, str]], separator: str) -> bool:
    """Where commas do not separate columns, and no cell has a point, commas are decimal."""
    if separator == ",":
        return False
    cells = [cell for _, line in rows[:LOOKED_AT] for cell in _cells(line, separator)]
    numbers = [cell for cell in cells if NUMBER.fullmatch(cell)]
    return any("," in cell for cell in numbers) and not any("." in cell for cell in numbers)
