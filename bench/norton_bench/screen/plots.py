"""Plots as plain data, and drawn as rows of characters with styles. No terminal is needed for it."""

from dataclasses import dataclass
from math import ceil, floor, isfinite, log10
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.report.words import pretty_unit
from norton_bench.screen.styles import GRID, LABEL, RULE, TRACES, Row, heading

NOTHING_YET = "nothing measured yet"


@dataclass(frozen=True)
class PlotTrace:
    """One curve or cloud, arrays of shape (n,), in SI units. ``style`` is 0 for the main one, 1 beside it, 2 faint."""

    x: FloatArray
    y: FloatArray
    style: int = 0
    dashed: bool = False
    cloud: bool = False


@dataclass(frozen=True)
class Markers:
    """A character at each point."""

    x: FloatArray
    y: FloatArray
    sign: str
    style: int = 0


@dataclass(frozen=True)
class PlotAxis:
    """What an axis is called, its unit, and the least range that is worth looking at. ``span`` fixes the range."""

    name: str
    unit: str
    least_span: float
    span: tuple[float, float] | None = None


@dataclass(frozen=True)
class PlotFigure:
    """One plot. ``growing`` means that x is time. ``latest`` is written at the right of its heading."""

    title: str
    x: PlotAxis
    y: PlotAxis
    traces: tuple[PlotTrace, ...] = ()
    markers: tuple[Markers, ...] = ()
    latest: str = ""
    legend: str = ""  # the meaning of the second style
    growing: bool = False
    feet: bool = True  # numbers below; not where the plot beneath has the same
    empty: str = NOTHING_YET


Range = tuple[float, float]

MARGIN = 0.06
# A range becomes narrower only when less than this share of it is used, so that it rarely changes.
NARROW_BELOW = 0.45
STEPS = 10  # a range ends on round numbers, with about so many steps
PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"))
_MANTISSAS = (1.0, 2.0, 5.0, 10.0)


def settled(before: Range | None, values: FloatArray, least_span: float) -> Range:
    """The range to show ``values`` in: the range ``before`` as long as it fits, so that it rarely changes."""
    known = values[np.isfinite(values)]
    if not known.size:
        return before or (-least_span / 2, least_span / 2)
    low, high = float(known.min()), float(known.max())
    span = max(high - low, least_span)
    middle = (high + low) / 2
    low, high = min(low, middle - span / 2), max(high, middle + span / 2)
    if before is not None and before[0] <= low and high <= before[1] and span > NARROW_BELOW * (before[1] - before[0]):
        return before
    step = tidy_step(span / STEPS)
    return floor((low - MARGIN * span) / step) * step, ceil((high + MARGIN * span) / step) * step


def tidy_step(least: float) -> float:
    """The smallest of 1, 2, 5, 10, 20 ... (and their tenths) that is not below ``least``."""
    if not (isfinite(least) and least > 0):
        return 1.0
    power = 10.0 ** floor(log10(least))
    return float(next(power * mantissa for mantissa in _MANTISSAS if power * mantissa >= least * (1 - 1e-9)))


def ticks(span: Range, most: int) -> list[float]:
    """At most ``most`` tidy places within the range."""
    low, high = span
    if most < 1 or not high > low:
        return []
    step = tidy_step((high - low) / most)
    first = ceil(low / step - 1e-9)
    return [number * step for number in range(first, floor(high / step + 1e-9) + 1)][:most]


def label(value: float, step: float) -> str:
    """A tick's number, with the digits that its step leaves meaning."""
    decimals = max(0, -floor(log10(step) + 1e-9)) if step > 0 else 0
    text = f"{value:.{decimals}f}"
    return "0" if float(text) == 0 else text.replace("-", "−")


def prefixed(greatest: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which numbers up to ``greatest`` are easy to read: 0.003 N*m as 3 mN·m."""
    factor, prefix = next(
        (pair for pair in PREFIXES if greatest >= pair[0]), PREFIXES[-1] if greatest > 0 else PREFIXES[0]
    )
    pretty = pretty_unit(unit)
    return (1.0 / factor, f"{prefix}{pretty}") if pretty[:1].isalpha() else (1.0, pretty)


Dots = npt.NDArray[np.bool_]

COLUMNS, ROWS = 2, 4  # dots in a cell
BLANK = 0x2800
_WEIGHTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], np.uint8)
# Dashes tell a second trace from the first where there are no colours.
DASH_DOTS, DASH_PERIOD_DOTS = 4, 8


class View(NamedTuple):
    """Curves and points as braille cells: two by four dots a character, so that any terminal shows them.

    Dots of several traces in one cell are combined, never replaced.
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
    """The dots of the curve through the points, in order; a point that is not finite interrupts it."""
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


GUTTER = 7  # columns for the numbers at the left, the same for all plots so that they are aligned
ROWS_A_TICK, COLUMNS_A_TICK = 2, 10
MOST_TICKS = 6


IntArray = npt.NDArray[np.integer]


@dataclass
class Drawer:
    """Draws one plot repeatedly, and remembers its ranges, so that they rarely change."""

    x_range: Range | None = None
    y_range: Range | None = None

    def draw(self, figure: PlotFigure, width: int, height: int) -> list[Row]:
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
        """Forget the ranges: the next figure is another one."""
        self.x_range = self.y_range = None

    def _settle(self, figure: PlotFigure) -> None:
        xs = [trace.x for trace in figure.traces] + [marks.x for marks in figure.markers]
        ys = [trace.y for trace in figure.traces] + [marks.y for marks in figure.markers]
        self.x_range = figure.x.span or settled(self.x_range, np.concatenate(xs), figure.x.least_span)
        self.y_range = figure.y.span or settled(self.y_range, np.concatenate(ys), figure.y.least_span)


def _unit(axis: PlotAxis, span: Range) -> str:
    return prefixed(max(abs(span[0]), abs(span[1])), axis.unit)[1]


def _plane(view: View, figure: PlotFigure, traces: list[PlotTrace]) -> list[Row]:
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


def _dots(view: View, trace: PlotTrace, growing: bool) -> Dots:
    if trace.cloud:
        return points(view, trace.x, trace.y)
    x, y = envelope(trace.x, trace.y, view.width * COLUMNS) if growing else (trace.x, trace.y)
    return line(view, x, y, dashed=trace.dashed)


def _runs(characters: IntArray, styles: IntArray) -> Row:
    edges = [0, *(np.flatnonzero(np.diff(styles)) + 1).tolist(), len(styles)]
    text = "".join(map(chr, characters.tolist()))
    names = [GRID if styles[first] < 0 else TRACES[styles[first]] for first in edges[:-1]]
    return [(text[first:last], name) for first, last, name in zip(edges, edges[1:], names, strict=False)]


def _with_gutter(plane: list[Row], span: Range, axis: PlotAxis, rows: int) -> list[Row]:
    factor, _ = prefixed(max(abs(span[0]), abs(span[1])), axis.unit)
    most = min(max(2, rows // ROWS_A_TICK), MOST_TICKS)
    places, step = ticks(span, most), tidy_step((span[1] - span[0]) / most) * factor
    labels = {}
    for place in places:
        row = round((span[1] - place) / (span[1] - span[0]) * (rows * ROWS - 1)) // ROWS
        labels[row] = label(place * factor, step)
    return [
        [(labels.get(number, "").rjust(GUTTER)[:GUTTER], LABEL), ("┤" if number in labels else "│", RULE), *row]
        for number, row in enumerate(plane)
    ]


def _feet(span: Range, axis: PlotAxis, inner: int) -> Row:
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
