"""Figures to inline SVG: the same data give the same bytes, and the page's style sheet chooses the colours."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from importlib.resources import files
from io import StringIO
from typing import Any, cast

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from norton_bench.report.margins import Margins
from norton_bench.report.section import Picture

# Stand-ins, one for each custom property of report.css, so that a figure follows the page into the dark and onto paper.
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
    """Within this, figures look as the report wants them."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def svg(figure: Figure, name: str, caption: str) -> str:
    """The figure as an ``<svg>`` element that scales with the page; ``name`` keeps its inner names apart."""
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
    """The page's own, with every colour in it."""
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
    new = Figure(figsize=(WIDTH_IN, height_in), layout=Margins())
    new.patch.set_visible(False)
    return new
