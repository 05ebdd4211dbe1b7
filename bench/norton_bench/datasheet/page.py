"""The sheet as one HTML file that needs nothing else, in the report's looks."""

from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from norton_bench.datasheet.content import content_of
from norton_bench.datasheet.pictures import Palette, Picture, drawings
from norton_bench.datasheet.sheet import Sheet
from norton_bench.report import svg
from norton_bench.report.render import write_page


def write_html(path: Path, sheets: Sequence[Sheet]) -> Path:
    """Of one sheet, or of two side by side. Raises ExperimentError where it cannot be written."""
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
