"""The sheet on paper: A4 pages drawn by matplotlib alone, so that nothing else need be installed."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import accumulate, zip_longest
from pathlib import Path

import matplotlib as mpl
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

from norton_bench.datasheet.data import Content, content_of
from norton_bench.datasheet.pictures import Picture, drawings
from norton_bench.datasheet.sheet import Sheet
from norton_bench.errors import ExperimentError
from norton_bench.report.svg import WIDTH_IN, FigureMargins, Palette
from norton_bench.report.words import Facts

PAGE_IN = (8.27, 11.69)  # A4
MARGIN_IN = 0.6
ROOM_IN = PAGE_IN[1] - 2 * MARGIN_IN
SCALE = (PAGE_IN[0] - 2 * MARGIN_IN) / WIDTH_IN  # of pictures that are drawn for the page's width
LINE_IN = 0.165
GAP_IN = 0.14  # between columns
LEAST_IN, LAST_IN = 1.2, 1.55  # of the column with the words, at least; of the last, at most
LEAST_SHARE = 0.7  # of its height that a picture may be given up to, so that one more is on the page
FEWEST_LINES = 5  # of a table under its heading, or both go to the next page
BODY_PT, SMALL_PT, HEADING_PT, TITLE_PT = 8.0, 7.0, 10.5, 17.0


def write_pdf(path: Path, sheets: Sequence[Sheet]) -> Path:
    """Of one sheet, or of two side by side. Raises ExperimentError where it cannot be written."""
    content, palette = content_of(sheets), Palette.of_print()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with palette.style(), mpl.rc_context({"pdf.fonttype": 42}), PdfPages(path, metadata=_about(content)) as pdf:
            for page in pages(content, sheets, palette):
                pdf.savefig(page)
    except OSError as error:
        raise ExperimentError(f"cannot write the data sheet {path}: {error.strerror}; choose another folder") from error
    return path


def pages(content: Content, sheets: Sequence[Sheet], palette: Palette) -> Iterator[Figure]:
    """Text and tables first, then the pictures, as many on a page as fit."""
    paper = _text(content, palette)
    *full, page = paper.pages
    yield from full
    room_in, waiting = paper.left_in - LINE_IN, list[Picture]()
    for picture in content.pictures:
        if _share((*waiting, picture), room_in) < LEAST_SHARE:
            yield _with_pictures(page, room_in, waiting, sheets, palette)
            page, room_in, waiting = _blank(), ROOM_IN, []
        waiting.append(picture)
    yield _with_pictures(page, room_in, waiting, sheets, palette)


def _share(chosen: Sequence[Picture], room_in: float) -> float:
    """Of their height that the pictures have on a page, all of it if there is room."""
    drawn_in = SCALE * sum(picture.height_in for picture in chosen)
    words_in = sum(map(_height_in, chosen)) - drawn_in
    return min(1.0, (room_in - words_in) / drawn_in)


def _blank() -> Figure:
    return Figure(figsize=PAGE_IN, layout=FigureMargins())


def _about(content: Content) -> dict[str, str | None]:
    """No date: the same sheet is the same file."""
    return {"Title": f"{content.title}: data sheet", "Creator": "Norton Bench", "CreationDate": None}


class _Writer:
    """Lines from the top of a page down, on as many pages as they need."""

    def __init__(self, palette: Palette) -> None:
        self._palette = palette
        self.left_in = 0.0
        self.pages: list[Figure] = []

    def line(
        self, cells: Sequence[tuple[float, str]], size_pt: float, *, bold: bool = False, muted: bool = False
    ) -> None:
        """Cells of one line, each with its place from the left margin [in]."""
        height_in = LINE_IN * max(1.0, size_pt / BODY_PT)
        if not self.fits(height_in):
            self.turn()
        self.left_in -= height_in
        for place_in, text in cells:
            self.pages[-1].text(
                (MARGIN_IN + place_in) / PAGE_IN[0],
                (MARGIN_IN + self.left_in) / PAGE_IN[1],
                text,
                fontsize=size_pt,
                weight="bold" if bold else "normal",
                color=self._palette.muted if muted else self._palette.ink,
            )

    def paragraph(self, text: str, size_pt: float = BODY_PT, *, muted: bool = False) -> None:
        for line in _wrapped(text, PAGE_IN[0] - 2 * MARGIN_IN, size_pt):
            self.line([(0.0, line)], size_pt, muted=muted)

    def space(self, lines: float = 0.6) -> None:
        self.left_in -= lines * LINE_IN

    def fits(self, height_in: float) -> bool:
        return self.left_in >= height_in

    def turn(self) -> None:
        """The next page."""
        self.pages.append(_blank())
        self.left_in = ROOM_IN


def _text(content: Content, palette: Palette) -> _Writer:
    """Everything but the pictures."""
    paper = _Writer(palette)
    paper.line([(0.0, "Data sheet · Norton Bench")], BODY_PT, muted=True)
    paper.line([(0.0, content.title)], TITLE_PT, bold=True)
    for letter, name, file, origin, holds in content.subjects:
        whose = f"{letter}: {name}, {file}" if letter else file
        paper.paragraph(f"{whose} · {origin}" if origin else whose, muted=True)
        paper.paragraph(holds)
    for heading, table in content.tables:
        paper.space(1.0)
        if not paper.fits(FEWEST_LINES * LINE_IN):
            paper.turn()
        paper.line([(0.0, heading)], HEADING_PT, bold=True)
        _table(paper, table)
    paper.space(1.0)
    paper.line([(0.0, "What was seen, and what was not measured")], HEADING_PT, bold=True)
    for sentence in content.told:
        paper.paragraph(sentence)
    return paper


def _table(paper: _Writer, table: Facts) -> None:
    """Columns as wide as their longest cell; the second, which has the words, takes what is left. It and the last one
    wrap. A row stays on one page, and the next page has the head again."""
    room_in, last = PAGE_IN[0] - 2 * MARGIN_IN, len(table.head) - 1
    widths = [max(_width_in(row[k]) for row in (table.head, *table.rows)) + GAP_IN for k in range(len(table.head))]
    widths[last] = min(widths[last], LAST_IN)
    widths[1] = min(widths[1], max(room_in - sum(widths) + widths[1], LEAST_IN))
    widths[last] -= max(sum(widths) - room_in, 0.0)
    places = [0.0, *accumulate(widths)]
    head = list(zip(places, table.head, strict=False))
    paper.line(head, SMALL_PT, muted=True)
    for row in table.rows:
        wrapped = [
            _wrapped(cell, widths[k] - GAP_IN, SMALL_PT) if k in (1, last) else [cell] for k, cell in enumerate(row)
        ]
        lines = list(zip_longest(*wrapped, fillvalue=""))
        if not paper.fits(len(lines) * LINE_IN):
            paper.turn()
            paper.line(head, SMALL_PT, muted=True)
        for line in lines:
            paper.line(list(zip(places, line, strict=False)), SMALL_PT)


def _wrapped(text: str, width_in: float, size_pt: float) -> list[str]:
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".lstrip()
        if lines[-1] and _width_in(longer, size_pt) > width_in:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


@cache
def _width_in(text: str, size_pt: float = SMALL_PT) -> float:
    """As matplotlib's own font is wide."""
    if not text.strip():
        return 0.0
    width_pt, _height_pt, _descent_pt = text_to_path.get_text_width_height_descent(
        text, FontProperties(size=size_pt), ismath=False
    )
    return float(width_pt) / 72


def _height_in(picture: Picture) -> float:
    """Of a picture with its heading and its caption."""
    lines = len(_wrapped(picture.caption, PAGE_IN[0] - 2 * MARGIN_IN, SMALL_PT))
    return picture.height_in * SCALE + LINE_IN * (lines + 3)


def _with_pictures(
    page: Figure, room_in: float, chosen: Sequence[Picture], sheets: Sequence[Sheet], palette: Palette
) -> Figure:
    """Each picture between its heading and its caption, in the lowest ``room_in`` of the page."""
    if not chosen:
        return page
    share = _share(chosen, room_in)
    chosen = [replace(picture, height_in=share * picture.height_in) for picture in chosen]
    left_in = MARGIN_IN + room_in
    parts = []
    for picture in chosen:
        parts.append((left_in, picture))
        left_in -= _height_in(picture)
    heights = list(_heights(chosen, PAGE_IN[1] - MARGIN_IN - room_in))
    spec = page.add_gridspec(
        2 * len(chosen) + 1, 3, left=0, right=1, top=1, bottom=0, hspace=0, wspace=0,
        width_ratios=(MARGIN_IN, PAGE_IN[0] - 2 * MARGIN_IN, MARGIN_IN),
        height_ratios=[*heights, PAGE_IN[1] - sum(heights)],
    )  # fmt: skip
    for place, (top_in, picture) in enumerate(parts):
        part = page.add_subfigure(spec[2 * place + 1, 1])
        picture.draw(part, drawings(sheets, palette), palette)
        heading_in = top_in - 1.4 * LINE_IN
        page.text(MARGIN_IN / PAGE_IN[0], heading_in / PAGE_IN[1], picture.title, fontsize=HEADING_PT, weight="bold")
        under_in = top_in - 2 * LINE_IN - picture.height_in * SCALE
        for line, text in enumerate(_wrapped(picture.caption, PAGE_IN[0] - 2 * MARGIN_IN, SMALL_PT)):
            y = (under_in - (line + 1) * 0.8 * LINE_IN) / PAGE_IN[1]
            page.text(MARGIN_IN / PAGE_IN[0], y, text, fontsize=SMALL_PT, color=palette.muted)
    return page


def _heights(chosen: Sequence[Picture], top_in: float) -> Iterator[float]:
    """Inches above each picture, the first of which has ``top_in`` above its heading, and of the picture itself."""
    above_in = top_in + 2 * LINE_IN
    for picture in chosen:
        drawn_in = picture.height_in * SCALE
        yield above_in
        yield drawn_in
        above_in = _height_in(picture) - drawn_in
