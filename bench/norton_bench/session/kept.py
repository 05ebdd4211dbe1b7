"""What procedures have measured, kept for later fits without filling the memory: mapped from files without a name."""

from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, cast

import numpy as np

from norton_bench.procedures.knowledge import Knowledge
from norton_bench.records import Measured, Table


def with_last_on_disk(known: Knowledge, folder: Path) -> Knowledge:
    """The same knowledge, its last record mapped from a file in ``folder`` that vanishes with this process."""
    if not known.records:
        return known
    *before, last = known.records
    return replace(known, records=(*before, _mapped(last, folder)))


def _mapped(record: Measured, folder: Path) -> Measured:
    """The same tables; those in memory where the disk has no room for them."""
    tables = {name: getattr(record, name) for name in _TABLES}
    if not any(map(len, tables.values())):
        return record
    try:
        with TemporaryFile(dir=folder) as file:
            for table in tables.values():
                file.write(table.tobytes())
            file.flush()
            content = np.memmap(file, np.uint8, mode="r")
    except OSError:
        return record
    return replace(record, **cast(dict[str, Any], _cut(content, tables)))


def _cut(content: "np.memmap[tuple[int], np.dtype[np.uint8]]", tables: dict[str, Table]) -> dict[str, Table]:
    """The tables again, one after the other."""
    found, start = {}, 0
    for name, table in tables.items():
        found[name] = np.asarray(content[start : start + table.nbytes]).view(table.dtype)
        start += table.nbytes
    return found


_TABLES = tuple(each.name for each in fields(Measured) if isinstance(getattr(Measured(), each.name), np.ndarray))
