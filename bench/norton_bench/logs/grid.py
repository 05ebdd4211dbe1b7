"""A log on a uniform grid: cut into stretches where it has gaps, resampled where its clock is uneven."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import make_interp_spline

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.errors import UsageError
from norton_bench.identification.soundness.standstill import resolution
from norton_bench.logs.log import Log
from norton_bench.logs.sensors import untrustworthy

# Intervals this much longer than the usual one are gaps; shorter ones are bridged.
GAP = 5.0
# Intervals that agree this well are one: nothing is interpolated.
EVEN = 1e-3
# A stretch with fewer samples than this is left out.
SHORTEST = 50
# Not to be interpolated: they step.
HELD = ("enabled", "goal")
# A step of the position beyond this many times those around it is none of the machine's.
LEAP = 8.0
LEAP_AROUND = 3


@dataclass(frozen=True)
class Stretch:
    """A part of one log without a gap, every ``dt_s``; arrays (n,). ``sound`` says where sensors can be trusted."""

    log: Log
    dt_s: float
    time_s: FloatArray
    columns: Mapping[str, FloatArray]
    sound: BoolArray


def usual_interval(log: Log) -> float:
    return float(np.median(np.diff(log.time_s)))


def common_interval(logs: Sequence[Log], rate_hz: float | None) -> float:
    """The interval of the grid: as asked for, or that of the log sampled fastest. UsageError for a longer one."""
    fastest = min(map(usual_interval, logs))
    if rate_hz is None:
        return fastest
    if 1 / rate_hz > fastest * (1 + GAP * EVEN):
        raise UsageError(
            f"[log] rate: {rate_hz:.6g} Hz is less than the {1 / fastest:.6g} Hz of {logs[0].place}; leave it out, and "
            "write [filter] rate for coarser rows"
        )
    return 1 / rate_hz


def stretches(log: Log, dt_s: float, gap_s: float | None) -> tuple[tuple[Stretch, ...], tuple[str, ...]]:
    """The log's parts on a grid, and what is to be said of its clock and sensors. Raises UsageError for no part."""
    wrong, remarks = untrustworthy(log)
    usual = usual_interval(log)
    steps = np.diff(log.time_s)
    gaps = steps > (gap_s or GAP * usual)
    leaps = _leaps(log) & ~gaps
    ends = np.concatenate([[0], np.flatnonzero(gaps | leaps) + 1, [len(log.time_s)]])
    parts = [slice(a, b) for a, b in pairwise(ends) if b - a >= SHORTEST]
    if not parts:
        raise UsageError(f"{log.place}: gaps leave no stretch of {SHORTEST} rows; check its time, or write [log] gap")
    sentences = list(remarks)
    if gaps.any():
        sentences.append(
            f"{log.place}: {int(gaps.sum())} gaps or jumps of the clock, the longest of {steps.max():.3g} s at "
            f"{log.time_s[int(np.argmax(steps))]:.4g} s; the log is cut there."
        )
    if leaps.any():
        sentences.append(
            f"{log.place}: position leaps {int(leaps.sum())} times, first at {log.time_s[int(np.argmax(leaps))]:.4g} s "
            "(rows are missing, or it wraps); the log is cut there."
        )
    return tuple(_stretch(log, dt_s, part, wrong) for part in parts), tuple(sentences)


def _leaps(log: Log) -> BoolArray:
    """Where the position goes on from somewhere else: one step far beyond those around it, shape (n − 1,)."""
    position = log.columns.get("position")
    if position is None:
        return np.zeros(len(log.time_s) - 1, dtype=bool)
    ways = np.abs(np.diff(position))
    around = np.pad(ways, LEAP_AROUND)
    beside = np.max([around[k : k + ways.size] for k in range(2 * LEAP_AROUND + 1) if k != LEAP_AROUND], axis=0)
    usual = np.percentile(ways[ways > 0], 95)
    return np.asarray((ways > LEAP * np.maximum(beside, resolution(position))) & (ways > 2 * usual))


def _stretch(log: Log, dt_s: float, part: slice, wrong: BoolArray) -> Stretch:
    time_s = log.time_s[part]
    steps = np.diff(time_s)
    columns = {name: values[part] for name, values in log.columns.items()}
    even = bool(np.all(np.abs(steps - dt_s) < EVEN * dt_s))
    if even and not log.shifts_s:
        return Stretch(log, dt_s, time_s, columns, ~wrong[part])
    grid = time_s if even else time_s[0] + dt_s * np.arange(int((time_s[-1] - time_s[0]) / dt_s + 1e-6) + 1)
    shifted = {name: time_s + log.shifts_s.get(name, 0.0) for name in columns}
    moved = {name: _at(name, shifted[name], values, grid) for name, values in columns.items()}
    sound = np.interp(grid, time_s, wrong[part].astype(np.float64)) == 0.0
    return Stretch(log, dt_s, grid, moved, sound)


def _at(name: str, time_s: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    """A column at the instants of the grid: what steps is held, position is a cubic spline, the rest is linear."""
    if name in HELD:
        return np.asarray(values[np.maximum(np.searchsorted(time_s, grid, side="right") - 1, 0)])
    if name == "position":
        return np.asarray(make_interp_spline(time_s, values, k=3)(grid))
    return np.interp(grid, time_s, values)
