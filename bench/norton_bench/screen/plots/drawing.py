"""A figure to rows of characters, each with the style it is drawn in. No terminal is needed for it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.screen.plots.figure import Axis, Figure, Range, Trace, label, prefixed, settled, ticks, tidy_step
from norton_bench.screen.styles import GRID, LABEL, RULE, TRACES, Row, heading

Dots = npt.NDArray[np.bool_]

COLUMNS, ROWS = 2, 4  # dots in a cell
BLANK = 0x2800
_WEIGHTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], np.uint8)
# Dashes tell a second trace from the first where there are no colours.
DASH_DOTS, DASH_PERIOD_DOTS = 4, 8


class View(NamedTuple):
    """Curves and points as braille cells: two by four dots a character, so that any terminal shows them.

    Dots of several traces are joined in a cell, never replaced: a cell shows everything that passes through it.
    Bits of a braille character: Unicode standard, chapter 21, "Braille Patterns" (U+2800).

    The piece of the plane that is drawn: least and greatest x and y at the outer edges, and its size in cells.
    """

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


GUTTER = 7  # columns for the numbers at the left, the same for all plots so that they stand in line
ROWS_A_TICK, COLUMNS_A_TICK = 2, 10
MOST_TICKS = 6


IntArray = npt.NDArray[np.integer]


@dataclass
class Drawer:
    """Draws one plot, again and again: its ranges are remembered, so that they stand still."""

    x_range: Range | None = None
    y_range: Range | None = None

    def draw(self, figure: Figure, width: int, height: int) -> list[Row]:
        """``height`` rows of ``width`` characters: a heading, the plane, the numbers below it."""
        inner, rows = width - GUTTER - 1, height - 1 - figure.feet
        known = [trace for trace in figure.traces if len(trace.x)]
        if inner < 4 or rows < 2 or not (known or figure.markers):
            return [heading(figure.title, "", "", width), *_empty(figure.empty, width, height - 1)]
        self._settle(figure)
        assert self.x_range is not None
        assert self.y_range is not None
        head = heading(figure.title, _unit(figure.y, self.y_range), figure.latest, width, figure.legend)
        view = View(*self.x_range, *self.y_range, inner, rows)
        plane = _plane(view, figure, known)
        feet = [_feet(self.x_range, figure.x, inner)] if figure.feet else []
        return [head, *_with_gutter(plane, self.y_range, figure.y, rows), *feet]

    def forget(self) -> None:
        """The next figure has nothing to do with those before."""
        self.x_range = self.y_range = None

    def _settle(self, figure: Figure) -> None:
        xs = [trace.x for trace in figure.traces] + [marks.x for marks in figure.markers]
        ys = [trace.y for trace in figure.traces] + [marks.y for marks in figure.markers]
        self.x_range = figure.x.span or settled(self.x_range, np.concatenate(xs), figure.x.least_span)
        self.y_range = figure.y.span or settled(self.y_range, np.concatenate(ys), figure.y.least_span)


def _unit(axis: Axis, span: Range) -> str:
    return prefixed(max(abs(span[0]), abs(span[1])), axis.unit)[1]


def _plane(view: View, figure: Figure, traces: list[Trace]) -> list[Row]:
    """The rows of the plane: dots, markers over them, and a line at zero beneath."""
    if traces:
        codes, owner = cells([_dots(view, trace, figure.growing) for trace in traces])
    else:
        codes, owner = np.zeros((view.height, view.width), np.uint8), np.full((view.height, view.width), -1)
    characters = np.where(codes > 0, codes.astype(np.int32) + BLANK, ord(" "))
    styles = np.where(owner >= 0, np.array([*(trace.style for trace in traces), 0])[owner], -1)
    if view.bottom < 0 < view.top:
        zero = round(float(view.place(np.zeros(1), np.zeros(1))[1][0])) // ROWS
        bare = codes[zero] == 0
        characters[zero, bare], styles[zero, bare] = ord("┈"), -2
    for marks in figure.markers:
        x, y = view.place(marks.x, marks.y)
        column, row = np.rint(x).astype(int) // COLUMNS, np.rint(y).astype(int) // ROWS
        inside = (column >= 0) & (column < view.width) & (row >= 0) & (row < view.height)
        characters[row[inside], column[inside]], styles[row[inside], column[inside]] = ord(marks.sign), marks.style
    return [_runs(characters[row], styles[row]) for row in range(view.height)]


def _dots(view: View, trace: Trace, growing: bool) -> Dots:
    if trace.cloud:
        return points(view, trace.x, trace.y)
    x, y = envelope(trace.x, trace.y, view.width * COLUMNS) if growing else (trace.x, trace.y)
    return line(view, x, y, dashed=trace.dashed)


def _runs(characters: IntArray, styles: IntArray) -> Row:
    edges = [0, *(np.flatnonzero(np.diff(styles)) + 1).tolist(), len(styles)]
    text = "".join(map(chr, characters.tolist()))
    names = [GRID if styles[first] < 0 else TRACES[styles[first]] for first in edges[:-1]]
    return [(text[first:last], name) for first, last, name in zip(edges, edges[1:], names, strict=False)]


def _with_gutter(plane: list[Row], span: Range, axis: Axis, rows: int) -> list[Row]:
    factor, _ = prefixed(max(abs(span[0]), abs(span[1])), axis.unit)
    most = min(max(2, rows // ROWS_A_TICK), MOST_TICKS)
    places, step = ticks(span, most), tidy_step((span[1] - span[0]) / most) * factor
    said = {}
    for place in places:
        row = round((span[1] - place) / (span[1] - span[0]) * (rows * ROWS - 1)) // ROWS
        said[row] = label(place * factor, step)
    return [
        [(said.get(number, "").rjust(GUTTER)[:GUTTER], LABEL), ("┤" if number in said else "│", RULE), *row]
        for number, row in enumerate(plane)
    ]


def _feet(span: Range, axis: Axis, inner: int) -> Row:
    """The numbers below, and the unit at the right end."""
    factor, unit = prefixed(max(abs(span[0]), abs(span[1])), axis.unit)
    room = [" "] * (GUTTER + 1 + inner)
    room[len(room) - len(unit) :] = unit
    most = max(2, inner // COLUMNS_A_TICK)
    step = tidy_step((span[1] - span[0]) / most) * factor
    for place in ticks(span, most):
        text = label(place * factor, step)
        middle = GUTTER + 1 + round((place - span[0]) / (span[1] - span[0]) * (inner - 1))
        first = max(0, middle - len(text) // 2)
        if first + len(text) < len(room) - len(unit):
            room[first : first + len(text)] = text
    return [("".join(room), LABEL)]


def _empty(text: str, width: int, height: int) -> list[Row]:
    blank: list[Row] = [[(" " * width, LABEL)] for _ in range(height)]
    if blank:
        blank[height // 2] = [(text[:width].center(width), LABEL)]
    return blank
