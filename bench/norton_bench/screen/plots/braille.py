"""Curves and points as braille cells: two by four dots a character, so that any terminal shows them.

Dots of several traces are joined in a cell, never replaced: a cell shows everything that passes through it. Bits of a
braille character: Unicode standard, chapter 21, "Braille Patterns" (U+2800).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray

Dots = npt.NDArray[np.bool_]

COLUMNS, ROWS = 2, 4  # dots in a cell
BLANK = 0x2800
_WEIGHTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], np.uint8)
# Dashes tell a second trace from the first where there are no colours.
DASH_DOTS, DASH_PERIOD_DOTS = 4, 8


class View(NamedTuple):
    """The piece of the plane that is drawn: least and greatest x and y at the outer edges, and its size in cells."""

    left: float
    right: float
    bottom: float
    top: float
    width: int
    height: int

    def place(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points in dots from the upper left corner; not finite where they are not."""
        column = (x - self.left) / (self.right - self.left) * (self.width * COLUMNS - 1)
        row = (self.top - y) / (self.top - self.bottom) * (self.height * ROWS - 1)
        return column, row

    def blank(self) -> Dots:
        return np.zeros((self.height * ROWS, self.width * COLUMNS), np.bool_)


def line(view: View, x: FloatArray, y: FloatArray, *, dashed: bool = False) -> Dots:
    """The dots of the curve through the points, in their order; one that is not finite breaks it."""
    column, row = view.place(x, y)
    known = np.isfinite(column) & np.isfinite(row)
    whole = known[:-1] & known[1:]
    begin_x, begin_y = column[:-1][whole], row[:-1][whole]
    far = 2.0 * max(view.width * COLUMNS, view.height * ROWS)
    begin_x, begin_y, end_x, end_y = (
        np.clip(each, -far, far) for each in (begin_x, begin_y, column[1:][whole], row[1:][whole])
    )
    steps = np.maximum(np.ceil(np.maximum(abs(end_x - begin_x), abs(end_y - begin_y))), 1).astype(np.intp)
    before = np.cumsum(steps) - steps
    share = (np.arange(int(steps.sum())) - np.repeat(before, steps)) / np.repeat(steps, steps)
    dots = view.blank()
    _mark(dots, np.repeat(begin_x, steps) + share * np.repeat(end_x - begin_x, steps),
          np.repeat(begin_y, steps) + share * np.repeat(end_y - begin_y, steps))  # fmt: skip
    _mark(dots, column[known], row[known])
    if dashed:
        dots[:, np.arange(dots.shape[1]) % DASH_PERIOD_DOTS >= DASH_DOTS] = False
    return dots


def points(view: View, x: FloatArray, y: FloatArray) -> Dots:
    """A dot for each point."""
    dots, (column, row) = view.blank(), view.place(x, y)
    known = np.isfinite(column) & np.isfinite(row)
    _mark(dots, column[known], row[known])
    return dots


def _mark(dots: Dots, column: FloatArray, row: FloatArray) -> None:
    places_x, places_y = np.rint(column).astype(np.intp), np.rint(row).astype(np.intp)
    inside = (places_x >= 0) & (places_x < dots.shape[1]) & (places_y >= 0) & (places_y < dots.shape[0])
    dots[places_y[inside], places_x[inside]] = True


def envelope(x: FloatArray, y: FloatArray, columns: int) -> tuple[FloatArray, FloatArray]:
    """The curve's first, least, greatest and last point in each of ``columns`` equal stretches: the same picture.

    ``x`` must grow. A stretch without a finite value becomes a gap. (Jugel et al., "M4", VLDB 2014.)
    """
    if len(x) <= 4 * columns:
        return x, y
    edges = np.unique(np.searchsorted(x, np.linspace(x[0], x[-1], columns, endpoint=False)))
    last = np.append(edges[1:], len(x)) - 1
    missing = np.isnan(y)
    least = np.minimum.reduceat(np.where(missing, np.inf, y), edges)
    greatest = np.maximum.reduceat(np.where(missing, -np.inf, y), edges)
    corners = np.stack([y[edges], least, greatest, y[last]], axis=1)
    corners[np.isinf(corners)] = np.nan
    return np.repeat((x[edges] + x[last]) / 2, 4), corners.ravel()


def cells(traces: list[Dots]) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.intp]]:
    """For every cell its eight dots as bits, and which trace has most of them: -1 where there is none."""
    blocks = [
        dots.reshape(dots.shape[0] // ROWS, ROWS, dots.shape[1] // COLUMNS, COLUMNS).swapaxes(1, 2) for dots in traces
    ]
    codes = [(block * _WEIGHTS).sum(axis=(2, 3), dtype=np.uint8) for block in blocks]
    counts = np.stack([block.sum(axis=(2, 3)) for block in blocks])
    owner = np.where(counts.any(axis=0), counts.argmax(axis=0), -1)
    return np.bitwise_or.reduce(codes), owner
