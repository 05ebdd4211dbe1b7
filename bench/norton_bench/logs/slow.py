"""The offset that wanders: a broken line over the time that is trained on, which ends where that ends."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.friction_operators import linear_basis

# A log trained on for less than this share of the spacing has one value throughout.
SHARE = 0.5


def drift_columns(
    places: Sequence[str], times_s: Sequence[FloatArray], trained: Sequence[BoolArray], spacing_s: float
) -> dict[str, FloatArray]:
    """The offset as a line with a knot about every ``spacing_s`` of training, log by log, as columns of the equation.

    ``places`` name the log of each stretch, ``times_s`` and ``trained`` are its instants and which of them are fitted.
    A log has knots of its own, because nobody knows what a zero did between two records. The line runs over the time
    trained on alone: outside it keeps its last value (before it, its first), and in a log without training that of the
    last log trained before, or of the first.
    """
    total = sum(map(len, times_s))
    rows: list[FloatArray] = []
    waiting: list[slice] = []
    at = 0
    for _, group in groupby(zip(places, times_s, trained, strict=True), key=lambda each: each[0]):
        parts = list(group)
        clock_s = _trained_clock([part[1] for part in parts], [part[2] for part in parts])
        here = slice(at, at + clock_s.size)
        at += clock_s.size
        if not any(part[2].any() for part in parts):
            if rows:
                rows[-1][here] = 1.0
            else:
                waiting.append(here)
            continue
        new = [np.zeros(total) for _ in range(_knots(clock_s[-1], spacing_s))]
        for row, hat in zip(new, linear_basis(clock_s, len(new)), strict=True):
            row[here] = hat
        for span in waiting:
            new[0][span] = 1.0
        waiting = []
        rows += new
    return {f"offset_{knot}": -row for knot, row in enumerate(rows, 1)}


def _knots(span_s: float, spacing_s: float) -> int:
    return max(2, round(span_s / spacing_s) + 1) if span_s >= SHARE * spacing_s else 1


def _trained_clock(times_s: Sequence[FloatArray], trained: Sequence[BoolArray]) -> FloatArray:
    """Seconds trained on so far, at every instant of a log: a clock that stands still outside the training."""
    steps = [np.diff(time_s, prepend=time_s[0]) * rows for time_s, rows in zip(times_s, trained, strict=True)]
    return np.cumsum(np.concatenate(steps))
