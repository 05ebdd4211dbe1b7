"""A figure to rows of characters, each with the tone it is drawn in. No terminal is needed for it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.screen.plots import braille
from norton_bench.screen.plots.axes import Range, label, prefixed, settled, ticks, tidy_step
from norton_bench.screen.plots.figure import Axis, Figure, Trace
from norton_bench.screen.tones import GRID, LABEL, RULE, TRACES, Row, heading

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
        view = braille.View(*self.x_range, *self.y_range, inner, rows)
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


def _plane(view: braille.View, figure: Figure, traces: list[Trace]) -> list[Row]:
    """The rows of the plane: dots, markers over them, and a line at zero beneath."""
    if traces:
        codes, owner = braille.cells([_dots(view, trace, figure.growing) for trace in traces])
    else:
        codes, owner = np.zeros((view.height, view.width), np.uint8), np.full((view.height, view.width), -1)
    characters = np.where(codes > 0, codes.astype(np.int32) + braille.BLANK, ord(" "))
    tones = np.where(owner >= 0, np.array([*(trace.tone for trace in traces), 0])[owner], -1)
    if view.bottom < 0 < view.top:
        zero = round(float(view.place(np.zeros(1), np.zeros(1))[1][0])) // braille.ROWS
        bare = codes[zero] == 0
        characters[zero, bare], tones[zero, bare] = ord("┈"), -2
    for marks in figure.markers:
        x, y = view.place(marks.x, marks.y)
        column, row = np.rint(x).astype(int) // braille.COLUMNS, np.rint(y).astype(int) // braille.ROWS
        inside = (column >= 0) & (column < view.width) & (row >= 0) & (row < view.height)
        characters[row[inside], column[inside]], tones[row[inside], column[inside]] = ord(marks.sign), marks.tone
    return [_runs(characters[row], tones[row]) for row in range(view.height)]


def _dots(view: braille.View, trace: Trace, growing: bool) -> braille.Dots:
    if trace.cloud:
        return braille.points(view, trace.x, trace.y)
    x, y = braille.envelope(trace.x, trace.y, view.width * braille.COLUMNS) if growing else (trace.x, trace.y)
    return braille.line(view, x, y, dashed=trace.dashed)


def _runs(characters: IntArray, tones: IntArray) -> Row:
    edges = [0, *(np.flatnonzero(np.diff(tones)) + 1).tolist(), len(tones)]
    text = "".join(map(chr, characters.tolist()))
    names = [GRID if tones[first] < 0 else TRACES[tones[first]] for first in edges[:-1]]
    return [(text[first:last], name) for first, last, name in zip(edges, edges[1:], names, strict=False)]


def _with_gutter(plane: list[Row], span: Range, axis: Axis, rows: int) -> list[Row]:
    factor, _ = prefixed(max(abs(span[0]), abs(span[1])), axis.unit)
    most = min(max(2, rows // ROWS_A_TICK), MOST_TICKS)
    places, step = ticks(span, most), tidy_step((span[1] - span[0]) / most) * factor
    said = {}
    for place in places:
        row = round((span[1] - place) / (span[1] - span[0]) * (rows * braille.ROWS - 1)) // braille.ROWS
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
