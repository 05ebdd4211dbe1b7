"""Columns that do not tell what they should: constant, at the end of their range, or frozen on one value."""

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.errors import UsageError
from norton_bench.identification.soundness import standstill
from norton_bench.identification.soundness.standstill import FROZEN_ROWS, flat_tops, rows_of
from norton_bench.logs.log import Log

MEASURED = ("position", "velocity", "exertion", "command")
FLAT_LEAST = 0.001
FROZEN_SHARE = 0.01
NEAR_LIMIT = 0.01


def check_constant(log: Log) -> None:
    """Raises UsageError for a column that never changes."""
    for name in MEASURED:
        values = log.columns.get(name)
        if values is not None and np.ptp(values) == 0:
            mend = "leave it out of the map if the actuator was idle" if name == "command" else "check the column"
            raise UsageError(f"{log.place}: {name} is constant ({values[0]:.6g}): it tells nothing; {mend}")


def untrustworthy(log: Log) -> tuple[BoolArray, tuple[str, ...]]:
    """Rows in which a sensor was at the end of its range or frozen, shape (n,), and a sentence for each such column."""
    wrong = np.zeros(len(log.time_s), dtype=bool)
    sentences = []
    for name in MEASURED:
        if name not in log.columns:
            continue
        values = log.columns[name]
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

    A command may well be held; one that else changes in every row is frozen where it does not.
    """
    values = log.columns[name]
    if name == "command" and np.median(standstill.runs(values)[1]) > 1:
        return []

    def others() -> list[FloatArray]:
        return [log.columns[other] for other in MEASURED if other in log.columns and other != name]

    # A shaft may well rest at the end; not under a command that swings by half of its range.
    share = 0.5 if name == "position" else standstill.ELSEWHERE
    return standstill.frozen(values, others, least=max(FROZEN_ROWS, FROZEN_SHARE * len(values)), share_at_end=share)


def held_rows(log: Log) -> tuple[int, int] | None:
    """Every how manieth row a sensor was read, and from which on; None where every row is a reading of its own."""
    for name in ("position", "velocity", "exertion"):
        found = standstill.held(log.columns[name]) if name in log.columns else None
        if found is not None:
            return found
    return None
