"""One log in SI: the file's columns as the map means them, every row that can be used, and what was left out."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.errors import UsageError
from norton_bench.identification import standstill
from norton_bench.identification.standstill import FROZEN_ROWS, flat_tops, rows_of
from norton_bench.logs.column_map import ColumnMap, ColumnSection, Given
from norton_bench.logs.files import Content, plain_unit, read_file
from norton_bench.logs.gears import at_joint
from norton_bench.logs.joints import of_its_joint
from norton_bench.logs.streams import SPARSE, Stream, filled_apart, on_rows
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
    column_map, chosen = of_its_joint(column_map, content)
    columns = _columns(content, column_map)
    columns, givens = at_joint(content.place, columns, _givens(content, column_map), column_map)
    time_s, columns, remarks = _rows_of(content, columns, column_map)
    _check_lengths(content.place, {"time": time_s, **columns})
    if np.any(np.isfinite(time_s)):
        time_s = time_s - time_s[np.isfinite(time_s)][0]
    shifts = {
        name: section.shift_s for name, section in column_map.mapped().items() if section.shift_s and name != "time"
    }
    return Log(content.place, time_s, columns, givens, shifts, (*content.remarks, *chosen, *remarks))


def _rows_of(
    content: Content, columns: Mapping[str, FloatArray], column_map: ColumnMap
) -> tuple[FloatArray, dict[str, FloatArray], tuple[str, ...]]:
    """The times of the rows in seconds, the columns without them, and what was done to those of other times."""
    if content.times_s:
        names = {what: content.spelt(section.name) for what, section in column_map.mapped().items()}
        streams = {what: Stream(names[what], content.times_s[names[what]], values) for what, values in columns.items()}
        return on_rows(content.place, streams, column_map.log.gap_s)
    others = {what: values for what, values in columns.items() if what != "time"}
    if "time" in columns:
        if len({len(values) for values in columns.values()}) == 1 and filled_apart(columns["time"], others):
            names = {what: section.name for what, section in column_map.mapped().items()}
            streams = {what: Stream(names[what], columns["time"], values).ordered() for what, values in others.items()}
            return on_rows(content.place, streams, column_map.log.gap_s)
        return columns["time"], others, ()
    if column_map.log.rate_hz is None:
        raise UsageError(
            f"{content.place}: [columns] time of {column_map.place} is missing; add "
            'time = { name = "t", unit = "s" }, or [log] rate = "1 kHz"'
        )
    return np.arange(len(next(iter(others.values())))) / column_map.log.rate_hz, others, ()


def _columns(content: Content, column_map: ColumnMap) -> dict[str, FloatArray]:
    columns = {}
    for name, section in column_map.mapped().items():
        if section.optional and content.spelt(section.name) not in content.arrays:
            continue
        where = f"[columns] {name} of {column_map.place}"
        unit = column_map.unit_of(name)
        written = _unit_of(content, section, unit, where)
        columns[name] = in_si(content.array(section.name, where), section, written, unit)
    return columns


def _unit_of(content: Content, section: ColumnSection, wanted: str, where: str) -> str:
    """The unit that the map gives, else the one behind the column's name. Raises UsageError for neither."""
    if section.unit is not None or section.gain is not None or not wanted:
        return section.of_product(section.unit or "")
    behind = content.unit(section.name)
    try:
        unit = plain_unit(behind)
        conversion(unit, wanted)
    except ValueError:
        known = f'"{behind}" behind its name is none that is known here' if behind else "none stands behind its name"
        raise UsageError(f'{content.place}: {where} gives no unit, and {known}; write unit = "{wanted}"') from None
    return unit


def in_si(raw: FloatArray, section: ColumnSection, written: str, unit: str) -> FloatArray:
    """sign · gain · (scale · raw + offset), converted from the unit ``written`` to ``unit``; what is missing is NaN."""
    values = np.where(np.isfinite(raw), raw, np.nan)
    if section.missing is not None:
        values = np.where(values == section.missing, np.nan, values)
    if section.bits is not None:
        # Written unsigned, meant in two's complement; what is negative already stays so.
        values = np.where(values >= 2.0 ** (section.bits - 1), values - 2.0**section.bits, values)
    factor, shift = conversion(written, unit)
    gain = 1.0 if section.gain is None else section.gain.number
    return np.asarray((section.sign * gain * (section.scale * values + section.offset)) * factor + shift)


def _givens(content: Content, column_map: ColumnMap) -> dict[tuple[str, str], float]:
    givens = {}
    for (section, key), given in column_map.givens().items():
        where = f"[{section}] {key} of {column_map.place}"
        value = _value(content, given, column_map.unit_of_given(section, key), where)
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
        message = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise UsageError(f"{place}: its columns differ in length ({message}); map columns that were sampled together")
    count = next(iter(lengths.values()))
    if count < LEAST_ROWS:
        raise UsageError(f"{place}: has {count} rows; {LEAST_ROWS} are the least to learn from; use a longer log")


MEASURED = ("position", "velocity", "link_position", "exertion", "command")
FLAT_LEAST = 0.001
FROZEN_SHARE = 0.01
NEAR_LIMIT = 0.01
# A link may be locked for the whole of a log, so that its joint only twists.
MAY_REST = ("link_position",)


# Which rows of a log can be used: numbers in every column, and a clock that goes forward.
def check_constant(log: Log) -> None:
    """Columns that do not tell what they should: constant, at the end of their range, or frozen on one value.

    Raises UsageError for a column that never changes.
    """
    for name in MEASURED:
        values = log.columns.get(name)
        if values is not None and np.ptp(values) == 0 and name not in MAY_REST:
            mend = "leave it out of the map if the actuator was idle" if name == "command" else "check the column"
            raise UsageError(f"{log.place}: {name} is constant ({values[0]:.6g}): it tells nothing; {mend}")


def untrustworthy(log: Log) -> tuple[BoolArray, tuple[str, ...]]:
    """Rows in which a sensor was at the end of its range or frozen, shape (n,), and a sentence for each such column."""
    wrong = np.zeros(len(log.time_s), dtype=bool)
    sentences = []
    for name in MEASURED:
        values = log.columns.get(name)
        if values is None or np.ptp(values) == 0:
            continue
        flat = rows_of(flat_tops(values), len(values)) & ~_limited(log, name)
        if np.count_nonzero(flat) >= FLAT_LEAST * len(values):
            wrong |= flat
            ends = ", ".join(f"{end:.4g}" for end in np.unique(values[flat]))
            sentences.append(
                f"{log.place}: {name} is saturated, flat at {ends} in {np.mean(flat):.1%} of the rows, left out."
            )
        frozen = rows_of(_frozen(log, name), len(values)) & ~flat & ~_limited(log, name)
        if frozen.any():
            wrong |= frozen
            first = log.time_s[int(np.argmax(frozen))]
            sentences.append(
                f"{log.place}: {name} is frozen in {np.mean(frozen):.1%} of the rows (first at {first:.4g} s), "
                "left out."
            )
    return wrong, tuple(sentences)


def _limited(log: Log, name: str) -> BoolArray:
    """Where a command rightly stands still: at the limit that the device's law keeps to, or switched off."""
    rows = np.zeros(len(log.time_s), dtype=bool)
    if name != "command":
        return rows
    limit = log.given("loop", "limit")
    if limit is not None:
        rows |= np.abs(np.abs(log.columns[name]) - limit) < NEAR_LIMIT * limit
    if "enabled" in log.columns:
        rows |= log.columns["enabled"] < 0.5
    return rows


def _frozen(log: Log, name: str) -> list[tuple[int, int]]:
    """Long runs of one column during which another one moved on.

    A velocity of zero is that of a shaft at rest; one that stands still elsewhere is told by the position alone. A
    command may well be held; one that else changes in every row is frozen where it does not.
    """
    values = log.columns[name]
    if name == "command" and np.median(standstill.runs(values)[1]) > 1:
        return []

    def others() -> list[FloatArray]:
        # A shaft at rest has no velocity, whatever pushes it: only a position that goes on shows that it does not rest.
        telling = ("position",) if name == "velocity" else MEASURED
        return [log.columns[other] for other in telling if other in log.columns and other != name]

    # A shaft may well rest at the end; not under a command that swings by half of its range.
    share = 0.5 if name in ("position", "link_position") else standstill.ELSEWHERE
    least = max(FROZEN_ROWS, FROZEN_SHARE * len(values))
    found = standstill.frozen(values, others, least=least, share_at_end=share)
    return [(first, length) for first, length in found if not (name == "velocity" and values[first] == 0.0)]


def held_rows(log: Log) -> tuple[int, int] | None:
    """Every how manieth row a sensor was read, and from which on; None where every row is a reading of its own."""
    for name in ("position", "velocity", "link_position", "exertion"):
        result = standstill.held(log.columns[name]) if name in log.columns else None
        if result is not None:
            return result
    return None


# More rows than this without a number, or with the stamp of the row before, and the log is not what it is taken for.
MOST_MISSING = 0.5
# With more steps back than this a column is not the time.
NO_CLOCK = 0.01


def usable_rows(log: Log) -> Log:
    """The log without the rows that hold no number or repeat a stamp; what was left out is said in its remarks.

    Raises UsageError where time runs backwards or stands still, a column is constant, or too little is left.
    """
    log = _without(log, ~np.isfinite(log.time_s), "time")
    for name in sorted(set(log.columns) - set(SPARSE)):
        log = _without(log, ~np.isfinite(log.columns[name]), name)
    log = _filled(log)
    check_constant(log)
    _check_order(log)
    return _readings(_without_repeats(log))


def _without(log: Log, wrong: BoolArray, name: str) -> Log:
    count = int(np.count_nonzero(wrong))
    if not count:
        return log
    total = len(wrong)
    if total - count < LEAST_ROWS or count > MOST_MISSING * total:
        raise UsageError(
            f"{log.place}: {name} holds no number in {count} of {total} rows; check the column, its unit and `missing`"
        )
    message = f"{name} holds no number in {count} of {total} rows (first in row {int(np.argmax(wrong)) + 1}); left out."
    return replace(_rows(log, ~wrong), remarks=(*log.remarks, f"{log.place}: {message}"))


def _rows(log: Log, keep: BoolArray) -> Log:
    return replace(log, time_s=log.time_s[keep], columns={name: values[keep] for name, values in log.columns.items()})


def _filled(log: Log) -> Log:
    """Slow columns keep their last value where they lack one."""
    columns = dict(log.columns)
    for name in set(SPARSE) & set(columns):
        known = np.isfinite(columns[name])
        if not known.any():
            raise UsageError(
                f"{log.place}: {name} holds no number at all; check the column, or leave it out of the map"
            )
        last = np.maximum.accumulate(np.where(known, np.arange(known.size), int(np.argmax(known))))
        columns[name] = columns[name][last]
    return replace(log, columns=columns)


def _check_order(log: Log) -> None:
    backwards = np.diff(log.time_s) < 0
    if backwards.any():
        row = int(np.argmax(backwards))
        if np.count_nonzero(backwards) > NO_CLOCK * len(backwards):
            raise UsageError(
                f"{log.place}: time runs backwards in {int(backwards.sum())} rows; that column is no clock"
            )
        raise UsageError(
            f"{log.place}: time runs backwards after row {row + 1} (from {log.time_s[row]:.6g} s to "
            f"{log.time_s[row + 1]:.6g} s); a clock jumped or logs were joined: cut the log there"
        )


def _without_repeats(log: Log) -> Log:
    repeats = np.concatenate([[False], np.diff(log.time_s) == 0])
    count = int(np.count_nonzero(repeats))
    if not count:
        return log
    if count > MOST_MISSING * len(repeats) or len(repeats) - count < LEAST_ROWS:
        raise UsageError(
            f"{log.place}: {count} of {len(repeats)} rows have the same time as the row before; check the column and "
            'its unit, or leave it out and write [log] rate = "1 kHz"'
        )
    message = f"{count} of {len(repeats)} rows have the same time as the row before; left out."
    return replace(_rows(log, ~repeats), remarks=(*log.remarks, f"{log.place}: {message}"))


def _readings(log: Log) -> Log:
    """One row a reading, where the log repeats a sensor's readings: the repetitions are old."""
    held = held_rows(log)
    if held is None or len(log.time_s) // held[0] < LEAST_ROWS:
        return log
    every, first = held
    keep = np.arange(len(log.time_s)) % every == first
    message = f"a sensor was read in every {every}. row only, the others repeat it; left out."
    return replace(_rows(log, keep), remarks=(*log.remarks, f"{log.place}: {message}"))
