"""Cleans a recording before anything is fitted: what cannot be trusted is left out, and named.

A reading that is left out is a gap, which all that follows knows how to bridge or to go round.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.errors import ExperimentError
from norton_bench.identification import standstill
from norton_bench.identification.counts import SMALLEST_STEP_RAD
from norton_bench.identification.readings import least_to_come, nominal_period_s, one_a_period, sampled_at_s
from norton_bench.identification.redundancy import (
    contradictions,
    in_order,
    jumps,
    longest,
    useless_device_clock,
)
from norton_bench.identification.standstill import spikes
from norton_bench.records import NO_DEVICE_TIME, Measured, Table, has_device_clock, sent_ns

FLAT_LEAST = 0.001
# A step of the position that changes the speed by so many times what is usual, and by so many counts, is no motion.
LEAP = 6.0
LEAP_COUNTS = 16
USUAL = 0.999
# This share of the changes that show at all tells one count.
SMALL = 0.01
# So much on either side of a leap is left out: longer than any gap that is bridged.
LEAP_MARGIN_S = 0.03
# At the end of a record a shaft may rest, though not while others swing by half of their range.
AT_END = 0.5
FEWEST = 100
# Answers follow commands where their delays, as directions with one turn a period, have a mean at least this long:
# that of delays spread evenly over 0.6 of a period. At random it would be below 1/sqrt(FEWEST).
LEAST_RESULTANT = 0.5
# Readings that are new more rarely than this tell nothing of a machine.
SLOWEST_S = 0.025


@dataclass(frozen=True)
class RecordedColumn:
    """One table of a recording: what it is called, its column of values and its stamps; ``role`` is the drive's."""

    field: str
    name: str
    column: str
    stamp: str = "arrival_ns"
    role: str = ""


TICKS = RecordedColumn("ticks", "command", "command", "tick_ns")
TORQUE = RecordedColumn("torque", "torque", "torque_nm")
MOTIONS = (
    RecordedColumn("motion", "position of the actuator", "position_rad", role="actuator"),
    RecordedColumn("load_motion", "position of the load", "position_rad", role="load"),
)
CURRENT = RecordedColumn("current", "current", "current_a", role="actuator")
STREAMS = (TICKS, TORQUE, *MOTIONS, CURRENT)


@dataclass(frozen=True)
class Findings:
    """Sentences: ``remarks`` say what was left out, ``doubts`` what contradicts itself."""

    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


NOTHING_FOUND = Findings()


@dataclass(frozen=True)
class Cleaned:
    """The part of a recording that can be trusted, and what was found on the way."""

    measured: Measured
    findings: Findings


def clean(measured: Measured) -> Cleaned:
    """Keep what can be trusted of a recording. Raises ExperimentError for a stream of which nothing is left."""
    remarks: list[str] = []
    tables = {}
    for stream in STREAMS:
        table = getattr(measured, stream.field)
        if len(table):
            table = in_order(_finite(stream, table, remarks), stream.stamp)
            tables[stream.field] = one_a_period(table) if stream is TORQUE else table
    for stream in STREAMS:
        if stream.field in tables:
            tables[stream.field] = _one_clock(stream, tables, remarks)
    origin_ns = int(tables["ticks"]["tick_ns"][0]) if "ticks" in tables else 0
    if "torque" in tables:
        tables["torque"] = _torque(tables, origin_ns, remarks)
    for stream in MOTIONS:
        if stream.field in tables:
            tables[stream.field] = _motion(stream, tables, origin_ns, remarks)
    for stream in STREAMS:
        if stream.role in measured.chain.answers_commands and {stream.field, "ticks"} <= tables.keys():
            tables[stream.field] = placed_by_commands(tables[stream.field], sent_ns(tables["ticks"]))
    retained = replace(measured, **cast("dict[str, Any]", tables))
    return Cleaned(retained, Findings(tuple(remarks), tuple(contradictions(retained))))


def _finite(stream: RecordedColumn, table: Table, remarks: list[str]) -> Table:
    good = np.isfinite(table[stream.column])
    if "valid" in (table.dtype.names or ()):
        valid = table["valid"]
        if not valid.any():
            raise ExperimentError(f"no reading of {stream.name} is valid: check the sensor's own status and cable")
        if not valid.all():
            table, good = table[valid], good[valid]
    if not good.any():
        raise ExperimentError(f"no reading of {stream.name} is a finite number: check the sensor and how it is read")
    if good.all():
        return table
    remarks.append(f"{stream.name}: {_of_all(~good)} are not finite numbers, left out.")
    return np.asarray(table[good])


def _of_all(chosen: BoolArray) -> str:
    return f"{np.count_nonzero(chosen)} of {chosen.size} readings"


def _one_clock(stream: RecordedColumn, tables: dict[str, Table], remarks: list[str]) -> Table:
    """The longest part that was stamped without a jump, by clocks that run."""
    table = tables[stream.field]
    if has_device_clock(table) and useless_device_clock(table, stream.stamp):
        table = table.copy()
        table["device_ns"] = NO_DEVICE_TIME
        remarks.append(f"{stream.name}: the sensor's own clock stands still or runs at another rate; it is not used.")
    others = [other for other in STREAMS if other.field in tables and (other is TICKS) != (stream is TICKS)]
    end_ns = max((int(tables[other.field][other.stamp].max()) for other in others), default=np.iinfo(np.int64).max)
    breaks = jumps(table, stream.stamp, end_ns)
    if not breaks.size:
        return table
    part = longest(len(table), breaks)
    at_s = float(table[stream.stamp][breaks[0] - 1] - table[stream.stamp][0]) * 1e-9
    remarks.append(
        f"{stream.name}: a clock jumped {_times(len(breaks))}, first {at_s:.4g} s from the beginning; used is the "
        f"longest part without, {(part.stop - part.start) / len(table):.0%} of it."
    )
    return table[part]


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _torque(tables: dict[str, Table], origin_ns: int, remarks: list[str]) -> Table:
    """Torque where the sensor was within its range and alive."""
    table = _thinned(TORQUE, tables["torque"], remarks)
    values = np.ascontiguousarray(table["torque_nm"])
    _changing(TORQUE, values, "N*m")
    flat = standstill.rows_of(standstill.flat_tops(values), len(values))
    if np.count_nonzero(flat) < FLAT_LEAST * len(values):
        flat[:] = False
    else:
        ends = ", ".join(f"{end:.4g}" for end in np.unique(values[flat]))
        remarks.append(f"torque is saturated, flat at {ends} N*m in {np.mean(flat):.1%} of the readings, left out.")
    frozen = _frozen(values, lambda: list(_others(table, tables, ("motion",)))) & ~flat
    _tell_frozen(TORQUE, frozen, _since_s(table, origin_ns), remarks)
    stray = spikes(values) & ~flat & ~frozen
    if stray.any():
        remarks.append(f"torque: {_of_all(stray)} stand alone far from their neighbours, left out.")
    return _kept(TORQUE, table, ~(flat | frozen | stray))


def _motion(stream: RecordedColumn, tables: dict[str, Table], origin_ns: int, remarks: list[str]) -> Table:
    """Positions that a shaft may have gone through."""
    table = _thinned(stream, tables[stream.field], remarks)
    values = np.ascontiguousarray(table["position_rad"])
    if stream is MOTIONS[0]:
        _changing(stream, values, "rad")
    stray = spikes(values)
    if stray.any():
        remarks.append(f"{stream.name}: {_of_all(stray)} stand alone far from their neighbours, left out.")
        table, values = table[~stray], values[~stray]
    time_s = _since_s(table, origin_ns)
    leaps = _leaps(table, values)
    frozen = _before_leaps(values, leaps)
    frozen |= _frozen(values, lambda: list(_others(table, tables, ("torque",))), share_at_end=AT_END)
    _tell_frozen(stream, frozen, time_s, remarks)
    leaps = leaps[~frozen[leaps]]
    near = np.zeros(len(values), dtype=bool)
    for leap in leaps:
        first, last = np.searchsorted(time_s, time_s[leap] + np.array([-LEAP_MARGIN_S, LEAP_MARGIN_S]))
        near[first : last + 1] = True
    if leaps.size:
        remarks.append(
            f"{stream.name} leaps {_times(leaps.size)}, first at {time_s[leaps[0]]:.4g} s, faster than the shaft can "
            "(counts are lost, or it wraps): what is around is left out; check the encoder."
        )
    return _kept(stream, table, ~(frozen | near))


def placed_by_commands(table: Table, commanded_ns: IntArray) -> Table:
    """Readings with which a drive answers commands, each with the instant of its command as ``device_ns``.

    ``commanded_ns`` (m,) are those instants. On the way back answers wait for a system and its adapter, often as long
    for seconds on end, in which their arrivals alone would bend the drive's clock. A reading belongs to the newest
    command from which it is away as long as usual, half a period more or less. Unchanged where that is no rule.
    """
    if has_device_clock(table) or len(table) < FEWEST or commanded_ns.size < FEWEST:
        return table
    arrival_ns, period_ns = table["arrival_ns"], float(np.median(np.diff(commanded_ns)))
    newest = np.searchsorted(commanded_ns, arrival_ns, side="right") - 1
    share = (arrival_ns - commanded_ns[np.maximum(newest, 0)]) / period_ns
    mean = np.mean(np.exp(2j * np.pi * share))
    if np.abs(mean) < LEAST_RESULTANT:
        return table
    usual_ns = (np.angle(mean) / (2 * np.pi) % 1.0) * period_ns
    latest_ns = (arrival_ns - usual_ns + 0.5 * period_ns).astype(np.int64)
    command = np.searchsorted(commanded_ns, latest_ns, side="right") - 1
    # What a stalled host hands over at once answers one command each.
    counted = command - np.arange(command.size)
    command = np.arange(command.size) + least_to_come(counted)
    placed: Table = table[command >= 0]
    placed["device_ns"] = commanded_ns[command[command >= 0]]
    return placed


def _since_s(table: Table, origin_ns: int) -> FloatArray:
    return np.asarray((table["arrival_ns"] - origin_ns) * 1e-9, dtype=np.float64)


def _thinned(stream: RecordedColumn, table: Table, remarks: list[str]) -> Table:
    """Without rows that only repeat a reading."""
    rhythm = standstill.held(np.ascontiguousarray(table[stream.column]))
    if rhythm is None:
        return table
    every, first = rhythm
    period_s = every * nominal_period_s(table["arrival_ns"])
    if period_s > SLOWEST_S:
        raise ExperimentError(
            f"{stream.name}: each reading is repeated {every} times, so there is a new one only every "
            f"{1e3 * period_s:.3g} ms: too slow for a fit; set the sensor to a higher rate"
        )
    remarks.append(
        f"{stream.name}: each reading is repeated {every} times, so there is a new one only every "
        f"{1e3 * period_s:.3g} ms; set the sensor to a higher rate."
    )
    return table[first::every]


def _changing(stream: RecordedColumn, values: FloatArray, unit: str) -> None:
    if values.size and np.ptp(values) == 0:
        raise ExperimentError(
            f"{stream.name} never changes ({values[0]:.4g} {unit}): the sensor is stuck or not connected; check it"
        )


def _others(table: Table, tables: dict[str, Table], fields: Sequence[str]) -> Iterator[FloatArray]:
    """What else was going on at the instants of a table: command, load's torque, and the other sensors."""
    ticks = tables.get("ticks")
    if ticks is not None:
        for column in ("command", "load_torque_nm"):
            if np.all(np.isfinite(ticks[column])):
                yield np.interp(table["arrival_ns"], ticks["tick_ns"], ticks[column])
    for stream in STREAMS:
        if stream.field in fields and stream.field in tables:
            other = tables[stream.field]
            yield np.interp(table["arrival_ns"], other["arrival_ns"], other[stream.column])


def _frozen(
    values: FloatArray, others: Callable[[], Sequence[FloatArray]], share_at_end: float = standstill.ELSEWHERE
) -> BoolArray:
    result = standstill.frozen(values, others, least=standstill.FROZEN_ROWS, share_at_end=share_at_end)
    return standstill.rows_of(result, len(values))


def _tell_frozen(stream: RecordedColumn, frozen: BoolArray, time_s: FloatArray, remarks: list[str]) -> None:
    if frozen.any():
        remarks.append(
            f"{stream.name} is frozen in {np.mean(frozen):.1%} of the readings (first at "
            f"{time_s[int(np.argmax(frozen))]:.4g} s), left out."
        )


def _leaps(table: Table, values: FloatArray) -> npt.NDArray[np.int64]:
    """Rows before which the position goes on from somewhere else."""
    period_s = nominal_period_s(table["arrival_ns"])
    # What leaps shows even where missing readings are not looked for; they take longer to find.
    if len(values) < FEWEST or not period_s > 0 or not _sharp(np.diff(values)).any():
        return np.empty(0, dtype=np.int64)
    own = table["device_ns"] if has_device_clock(table) else None
    steps_s = np.diff(sampled_at_s(table["arrival_ns"], own, int(table["arrival_ns"][0])))
    near = (steps_s > 0.5 * period_s) & (steps_s < 1.5 * period_s)
    steps = np.where(near, np.diff(values) / np.where(near, steps_s / period_s, 1.0), np.nan)
    sharp = _sharp(steps)
    # The step that leaps changes the speed before it and after it.
    return np.flatnonzero(sharp[:-1] & sharp[1:]) + 2


def _sharp(steps: FloatArray) -> BoolArray:
    """Where steps (n,) change far more than they usually do, and by many counts: shape (n - 1,)."""
    change = np.abs(np.diff(steps))
    known = change[np.isfinite(change)]
    moving = known[known > SMALLEST_STEP_RAD]
    if not moving.size:
        return np.zeros(change.size, dtype=bool)
    least = max(LEAP * float(np.quantile(known, USUAL)), LEAP_COUNTS * float(np.quantile(moving, SMALL)))
    return np.asarray(np.nan_to_num(change) > least)


def _before_leaps(values: FloatArray, leaps: npt.NDArray[np.int64]) -> BoolArray:
    """Where the readings stood still until they leapt."""
    first, length = standstill.runs(values)
    ends = first + length
    stuck = np.isin(ends, leaps) & (length >= standstill.FROZEN_ROWS)
    return standstill.rows_of(zip(first[stuck].tolist(), length[stuck].tolist(), strict=True), len(values))


def _kept(stream: RecordedColumn, table: Table, good: BoolArray) -> Table:
    if np.count_nonzero(good) < min(FEWEST, len(good)):
        raise ExperimentError(f"{stream.name} cannot be cleaned: hardly a reading follows from those around it")
    return table if good.all() else table[good]


# Readings arrive within so long of the ticks of their part.
STRAY_NS = 1_000_000_000


def clean_part(part: Measured) -> Measured:
    """A part of a session under way, without readings that are not finite, stand alone far off, or bear an impossible
    time: what goes on learning must not be poisoned by what a look at the whole would leave out."""
    ticks = part.ticks[np.isfinite(part.ticks["command"])]
    if not len(ticks):
        return replace(part, ticks=ticks, motion=part.motion[:0], torque=part.torque[:0])
    ticks = ticks[standstill.rising(ticks["tick_ns"])]
    span_ns = int(ticks["tick_ns"][0]) - STRAY_NS, int(ticks["tick_ns"][-1]) + STRAY_NS
    return replace(
        part,
        ticks=ticks,
        motion=_within(part.motion, "position_rad", span_ns),
        torque=_within(part.torque[part.torque["valid"]], "torque_nm", span_ns),
    )


def _within(table: Table, column: str, span_ns: tuple[int, int]) -> Table:
    arrival_ns = table["arrival_ns"]
    table = table[np.isfinite(table[column]) & (arrival_ns >= span_ns[0]) & (arrival_ns <= span_ns[1])]
    return table[~spikes(table[column])]
