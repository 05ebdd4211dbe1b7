"""Room around a figure's panels in inches, by what stands beside them, not by how wide its letters come out.

Matplotlib's own layouts draw every label several times to find out, which took half of a report's time.
"""

from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.gridspec import SubplotSpec
from matplotlib.layout_engine import LayoutEngine

# Inches, for text of the report's size.
EDGE_IN = 0.08
RIGHT_IN = 0.08  # half of the last number stands out
NUMBERS_LEFT_IN = 0.47
NUMBERS_BELOW_IN = 0.21
LABEL_IN = 0.21
TITLE_IN = 0.26


class Margins(LayoutEngine):
    """Places the panels of a figure, and those of each of its subfigures, in their grid."""

    _adjust_compatible = True
    _colorbar_gridspec = False

    def execute(self, fig: Figure) -> None:
        parts: Sequence[Figure | SubFigure] = fig.subfigs or [fig]
        for part in parts:
            panels = {axes: spec for axes in part.axes if (spec := axes.get_subplotspec()) and axes.get_visible()}
            if panels:
                _place(part, fig.dpi, panels)


def _place(part: Figure | SubFigure, dpi: float, panels: dict[Axes, SubplotSpec]) -> None:
    grid: Any = next(iter(panels.values())).get_gridspec()

    def most(room_in: Callable[[Axes], float], line: Callable[[SubplotSpec], int], count: int) -> list[float]:
        """What the panel that asks for most asks for, in each row or column."""
        return [max((room_in(axes) for axes, at in panels.items() if line(at) == k), default=0.0) for k in range(count)]

    width, height = part.bbox.width / dpi, part.bbox.height / dpi
    before = most(_left_in, lambda at: at.colspan.start, grid.ncols)
    columns = _spans(width, before, [RIGHT_IN] * grid.ncols, grid.get_width_ratios())
    above = most(_above_in, lambda at: at.rowspan.start, grid.nrows)
    rows = _spans(height, above, most(_below_in, lambda at: at.rowspan.stop - 1, grid.nrows), grid.get_height_ratios())
    for axes, at in panels.items():
        left, right = columns[at.colspan.start][0], columns[at.colspan.stop - 1][1]
        top, bottom = rows[at.rowspan.start][0], rows[at.rowspan.stop - 1][1]
        axes.set_position((left, 1.0 - bottom, right - left, bottom - top))


def _spans(
    length_in: float, before: Sequence[float], after: Sequence[float], ratios: Sequence[float]
) -> list[tuple[float, float]]:
    """Where panels begin and end, as shares of ``length_in``, with that room before and after each of them."""
    around = [EDGE_IN + first + last for first, last in zip(before, after, strict=True)]
    left_in = length_in - EDGE_IN - sum(around)
    steps = [room + left_in * ratio / sum(ratios) for room, ratio in zip(around, ratios, strict=True)]
    ends = pairwise(accumulate(steps, initial=0.0))
    return [
        ((start + EDGE_IN + first) / length_in, (end - last) / length_in)
        for (start, end), first, last in zip(ends, before, after, strict=True)
    ]


def _left_in(axes: Axes) -> float:
    return _numbers(axes.yaxis, "labelleft", NUMBERS_LEFT_IN) + (LABEL_IN if axes.get_ylabel() else 0.0)


def _below_in(axes: Axes) -> float:
    return _numbers(axes.xaxis, "labelbottom", NUMBERS_BELOW_IN) + (LABEL_IN if axes.get_xlabel() else 0.0)


def _numbers(axis: Any, side: str, room_in: float) -> float:
    return room_in if axis.get_tick_params()[side] else 0.0


def _above_in(axes: Axes) -> float:
    """For the title, and for a legend that was anchored outside the panel, however many lines it has."""
    title_in, legend = TITLE_IN if axes.get_title(loc="left") else 0.0, axes.get_legend()
    if legend is None or legend.get_bbox_to_anchor() is axes.bbox:
        return title_in
    over: Any = axes.figure.dpi_scale_trans.inverted().transform((0.0, legend.get_window_extent().y1 - axes.bbox.y1))
    return max(title_in, float(over[1]))
