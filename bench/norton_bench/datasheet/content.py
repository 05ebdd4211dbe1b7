"""What stands on a sheet, in order, whether it becomes a page or paper."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from norton_bench.datasheet.pictures import Palette, Picture, drawings, pictures
from norton_bench.datasheet.sheet import Sheet, compared
from norton_bench.datasheet.tables import (
    difference_table,
    figure_table,
    order_table,
    parameter_difference_table,
    parameter_table,
    range_sentence,
    remarks,
)
from norton_bench.report import svg
from norton_bench.report.render import write_page
from norton_bench.report.section import Facts


@dataclass(frozen=True)
class Content:
    """``subjects`` are a letter (none for a sheet alone), name, file, origin and where each holds."""

    title: str
    subjects: tuple[tuple[str, str, str, str, str], ...]
    told: tuple[str, ...]
    tables: tuple[tuple[str, Facts], ...]  # each with its heading
    pictures: tuple[Picture, ...]


def content_of(sheets: Sequence[Sheet]) -> Content:
    """Of one sheet, or of two side by side."""
    letters = [""] if len(sheets) == 1 else ["A", "B"]
    subjects = tuple(
        (letter, sheet.name, sheet.file, sheet.origin, range_sentence(sheet))
        for letter, sheet in zip(letters, sheets, strict=True)
    )
    told = _told([(*sheet.told, *remarks(sheet)) for sheet in sheets], letters)
    title = " and ".join(dict.fromkeys(sheet.name for sheet in sheets))
    return Content(title, subjects, told, tuple(_tables(sheets, letters)), tuple(pictures(sheets)))


def _told(sentences: Sequence[Sequence[str]], letters: Sequence[str]) -> tuple[str, ...]:
    """Each sentence with the letters of the sheets that it is said of."""
    every = dict.fromkeys(sentence for each in sentences for sentence in each)
    whose = {
        sentence: " and ".join(letter for letter, own in zip(letters, sentences, strict=True) if sentence in own)
        for sentence in every
    }
    return tuple(f"{whose[sentence]}: {sentence}" if whose[sentence] else sentence for sentence in every)


def _tables(sheets: Sequence[Sheet], letters: Sequence[str]) -> list[tuple[str, Facts]]:
    if len(sheets) == 1:
        found = [("Parameters", parameter_table(sheets[0])), ("What follows from them", figure_table(sheets[0]))]
    else:
        first, second = sheets
        found = [
            ("Parameters", parameter_difference_table(first, second)),
            ("What follows from them", difference_table(compared(first, second))),
        ]
    for letter, sheet in zip(letters, sheets, strict=True):
        table = order_table(sheet)
        if table is not None:
            found.append((f"Cogging and ripple {letter}".strip(), table))
    return found


def write_html(path: Path, sheets: Sequence[Sheet]) -> Path:
    """The sheet as one HTML file that needs nothing else, in the report's looks.

    Of one sheet, or of two side by side. Raises ExperimentError where it cannot be written.
    """
    return write_page(path, html(sheets))


def html(sheets: Sequence[Sheet]) -> str:
    """The page: the same for the same sheets, to the last byte."""
    content = content_of(sheets)
    environment = Environment(
        loader=PackageLoader("norton_bench.datasheet", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    with Palette().style():
        drawn = [(picture, Markup(_svg(picture, sheets))) for picture in content.pictures]
    page = environment.get_template("datasheet.html.j2")
    return page.render(content=content, pictures=drawn, css=Markup(svg.style_sheet()))


def _svg(picture: Picture, sheets: Sequence[Sheet]) -> str:
    palette, figure = Palette(), svg.figure(picture.height_in)
    picture.draw(figure, drawings(sheets, palette), palette)
    return svg.svg(figure, picture.name, picture.caption)
