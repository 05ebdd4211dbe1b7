"""Figures to inline SVG: the same data give the same bytes, and the page's style sheet chooses the colours."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from io import StringIO
from itertools import accumulate, pairwise
from typing import Any, cast

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure, SubFigure
from matplotlib.gridspec import SubplotSpec
from matplotlib.layout_engine import LayoutEngine

from norton_bench.arrays import FloatArray
from norton_bench.report.words import Picture

# Inches, for text of the report's size.
EDGE_IN = 0.08
RIGHT_IN = 0.08  # half of the last number is outside
NUMBERS_LEFT_IN = 0.47
NUMBERS_BELOW_IN = 0.21
LABEL_IN = 0.21
TITLE_IN = 0.26


class FigureMargins(LayoutEngine):
    """Room around a figure's panels in inches, by the labels beside them, not by the width of their letters.

    Matplotlib's own layouts draw every label several times to find out, which took half of a report's time.

    Places the panels of a figure, and those of each of its subfigures, in their grid.
    """

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
        """The greatest margin needed in each row or column."""
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


POINTS = 2000


# Fewer points, same picture.
def envelope(time_s: FloatArray, values: FloatArray, points: int = POINTS) -> tuple[FloatArray, FloatArray]:
    """At most ``points`` of the given ones: least and greatest of each stretch, in order, so that no spike is lost.

    A stretch without a finite value becomes one NaN, so that gaps stay gaps.
    """
    stretches = points // 2
    if len(values) <= points:
        return time_s, values
    edges = np.linspace(0, len(values), stretches + 1).astype(int)
    rows = edges[:-1, None] + np.arange(np.max(np.diff(edges)))
    pieces = np.where(rows < edges[1:, None], values[np.minimum(rows, len(values) - 1)], np.nan)
    missing = np.isnan(pieces)
    least, greatest = (edges[:-1] + np.argmin(np.where(missing, np.inf, sign * pieces), axis=1) for sign in (1.0, -1.0))
    ends = np.sort(np.stack([least, greatest], axis=1))
    chosen = ends[np.stack([np.full(stretches, True), ends[:, 0] != ends[:, 1]], axis=1)]
    return time_s[chosen], values[chosen]


def thinned(count: int, points: int = POINTS) -> npt.NDArray[np.intp]:
    """Indices of at most ``points`` of ``count`` things, evenly spread: for clouds, where order means nothing."""
    return np.unique(np.linspace(0, count - 1, min(points, count)).astype(np.intp)) if count else np.empty(0, np.intp)


# A colour for each custom property of report.css, so that figures follow the dark theme and printing.
INK = "#0a0001"
MUTED = "#0a0002"
GRID = "#0a0003"
MEASURED = "#0a0004"
PREDICTED = "#0a0005"
ACCENT = "#0a0006"
PROPERTIES = {
    INK: "--ink",
    MUTED: "--muted",
    GRID: "--grid",
    MEASURED: "--measured",
    PREDICTED: "--predicted",
    ACCENT: "--accent",
}
WIDTH_IN = 8.2

_STYLE: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "text.color": INK,
    "axes.facecolor": "none",
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.4,
    "lines.linewidth": 1.1,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
}
_LONG_DECIMALS = re.compile(r"(\d\.\d)\d+")
_PATH = re.compile(r' d="[^"]*"')


@contextmanager
def style() -> Iterator[None]:
    """Inside, figures have the style of the report."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def svg(figure: Figure, name: str, caption: str) -> str:
    """The figure as an ``<svg>`` element that scales with the page; ``name`` makes its inner ids unique."""
    text = StringIO()
    with mpl.rc_context({**_STYLE, "svg.hashsalt": name}):
        canvas: Any = FigureCanvasSVG(figure)
        canvas.print_svg(text, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    markup = text.getvalue()
    markup = markup[markup.index("<svg") :]
    markup = re.sub(r"<metadata>.*?</metadata>", "", markup, flags=re.DOTALL)
    box = cast(re.Match[str], re.search(r'viewBox="[^"]*"', markup)).group()
    markup = re.sub(r"<svg [^>]*>", f'<svg {box} role="img" aria-label="{escape(caption, quote=True)}">', markup)
    markup = re.sub(r'<g id="[^"]*">', "<g>", markup)
    markup = _PATH.sub(lambda path: _LONG_DECIMALS.sub(r"\1", path.group()), markup)
    for colour, name_of_property in PROPERTIES.items():
        markup = markup.replace(colour, f"var({name_of_property})")
    return markup.strip()


def picture(figure: Figure, name: str, purpose: str, caption: str = "") -> Picture:
    """The figure with what it is for; ``name`` as in :func:`svg`."""
    return Picture(svg(figure, name, f"{purpose} {caption}".strip()), purpose, caption)


def style_sheet() -> str:
    """The style sheet of the page, with every colour."""
    return files("norton_bench.report").joinpath("report.css").read_text(encoding="utf-8")


def standalone(markup: str) -> str:
    """What :func:`svg` made, as the content of a file of its own, in the colours of the page."""
    css = style_sheet()
    colours = css[: css.index("* {")]
    spaces = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    head = f"<svg {spaces} "
    end_of_tag = markup.index(">") + 1
    colouring = f"<style>{colours}svg {{ background: var(--page); }}</style>"
    return head + markup[len("<svg ") : end_of_tag] + colouring + markup[end_of_tag:] + "\n"


def figure(height_in: float) -> Figure:
    """An empty figure of the page's width, on the page's own background."""
    new = Figure(figsize=(WIDTH_IN, height_in), layout=FigureMargins())
    new.patch.set_visible(False)
    return new


COLOUR = re.compile(r"--(\w+): (#\w+)")


@dataclass(frozen=True)
class Palette:
    """Colours by what they are for: placeholders that a style sheet fills in, or those of print."""

    ink: str = INK
    muted: str = MUTED
    grid: str = GRID
    measured: str = MEASURED
    predicted: str = PREDICTED
    accent: str = ACCENT

    @classmethod
    def of_print(cls) -> "Palette":
        """As the report's style sheet has them for paper."""
        css = style_sheet()
        named = dict(COLOUR.findall(css[css.index("@media print") :]))
        return cls(*(named[name] for name in ("ink", "muted", "grid", "measured", "predicted", "accent")))

    @contextmanager
    def style(self) -> Iterator[None]:
        """Within this, figures look as the report wants them, in these colours."""
        stand_ins = Palette()
        own = {getattr(stand_ins, name): getattr(self, name) for name in self.__dataclass_fields__}
        with style():
            changed: Any = {key: own[value] for key, value in mpl.rcParams.items() if str(value) in own}
            mpl.rcParams.update(changed)
            yield
