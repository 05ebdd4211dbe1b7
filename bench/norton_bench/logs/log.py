"""One log in SI: the file's columns as the map means them, every row that can be used, and what was left out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.logs.column_map import ColumnMap, ColumnSection, Given
from norton_bench.logs.files import Content, read_file
from norton_bench.units import conversion

# Fewer rows than this tell nothing of a machine.
LEAST_ROWS = 50


@dataclass(frozen=True)
class Log:
    """A log as it was sampled: nothing is resampled or filtered yet.

    ``columns`` are those of the map by what they hold (``position``, ``command``, ...), each (n,), in the units of
    ``ColumnMap.units``; a row that lacks a value has NaN there. ``givens`` are the known numbers by section and key,
    e.g. ``("load", "inertia")``. ``time_s`` counts from the first row; what ``shifts_s``
    names belongs to a time that is later by so much.
    """

    place: str
    time_s: FloatArray
    columns: Mapping[str, FloatArray]
    givens: Mapping[tuple[str, str], float]
    shifts_s: Mapping[str, float]
    remarks: tuple[str, ...] = field(default=())

    def given(self, section: str, key: str) -> float | None:
        return self.givens.get((section, key))


def read_log(path: Path, column_map: ColumnMap) -> Log:
    """The log by the map. Raises UsageError, in a sentence with place and mend, where it cannot be used."""
    content = read_file(path, column_map.log)
    columns = _columns(content, column_map)
    givens = _givens(content, column_map)
    _check_lengths(content.place, columns)
    time_s = columns.pop("time", None)
    if time_s is None:
        assert column_map.log.rate_hz is not None  # the map was refused otherwise
        time_s = np.arange(len(next(iter(columns.values())))) / column_map.log.rate_hz
    elif np.any(np.isfinite(time_s)):
        time_s = time_s - time_s[np.isfinite(time_s)][0]
    shifts = {
        name: section.shift_s for name, section in column_map.mapped().items() if section.shift_s and name != "time"
    }
    return Log(content.place, time_s, columns, givens, shifts)


def _columns(content: Content, column_map: ColumnMap) -> dict[str, FloatArray]:
    columns = {}
    for name, section in column_map.mapped().items():
        if section.optional and section.name not in content.arrays:
            continue
        where = f"[columns] {name} of {column_map.place}"
        columns[name] = in_si(content.array(section.name, where), section, column_map.units.columns[name])
    return columns


def in_si(raw: FloatArray, section: ColumnSection, unit: str) -> FloatArray:
    """sign · (scale · raw + offset), converted from the section's unit to ``unit``; what is missing is NaN."""
    values = np.where(np.isfinite(raw), raw, np.nan)
    if section.missing is not None:
        values = np.where(values == section.missing, np.nan, values)
    if section.bits is not None:
        # Written unsigned, meant in two's complement; what is negative already stays so.
        values = np.where(values >= 2.0 ** (section.bits - 1), values - 2.0**section.bits, values)
    factor, shift = conversion(section.unit, unit)
    return np.asarray((section.sign * (section.scale * values + section.offset)) * factor + shift)


def _givens(content: Content, column_map: ColumnMap) -> dict[tuple[str, str], float]:
    givens = {}
    for (section, key), given in column_map.givens().items():
        where = f"[{section}] {key} of {column_map.place}"
        value = _value(content, given, column_map.units.givens[section, key], where)
        if value is not None:
            givens[section, key] = value
    return givens


def _value(content: Content, given: Given, unit: str, where: str) -> float | None:
    factor, shift = conversion(given.unit, unit)
    if not {*content.numbers, *content.arrays}.issuperset(given.names) and (
        given.default is not None or given.optional
    ):
        return None if given.default is None else given.default * factor + shift
    product = given.number * float(np.prod([content.number(name, where) for name in given.names]))
    return product * factor + shift


def _check_lengths(place: str, columns: Mapping[str, FloatArray]) -> None:
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise UsageError(f"{place}: its columns differ in length ({said}); map columns that were sampled together")
    if next(iter(lengths.values())) < LEAST_ROWS:
        raise UsageError(f"{place}: has {next(iter(lengths.values()))} rows; {LEAST_ROWS} are the least to learn from")
