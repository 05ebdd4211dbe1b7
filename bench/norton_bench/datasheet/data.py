"""The sheet for programs: plain data, units beside every number (docs/datasheet.md)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from norton_bench.datasheet.evidence import Evidence
from norton_bench.datasheet.pictures import Picture, drawings, pictures
from norton_bench.datasheet.ripple import Order, Wave
from norton_bench.datasheet.sheet import Difference, Sheet, SheetValue, compared
from norton_bench.datasheet.spectra import Spectra, Transfer
from norton_bench.datasheet.tables import (
    difference_table,
    figure_table,
    order_table,
    parameter_difference_table,
    parameter_table,
    range_sentence,
    remarks,
    valid_where,
)
from norton_bench.models.derived import Figure, Interval
from norton_bench.report import svg
from norton_bench.report.render import write_page
from norton_bench.report.svg import Palette
from norton_bench.report.words import Facts


def sheet_data(sheet: Sheet) -> dict[str, Any]:
    """One sheet; values that are not known are not finite, and null once written as JSON."""
    prediction = sheet.network.prediction
    return {
        "name": sheet.name,
        "file": sheet.file,
        "command_unit": sheet.network.command_unit,
        "parameters": {each.name: _parameter(each) for each in sheet.parameters},
        "figures": [_figure(figure, sheet) for figure in sheet.figures()],
        "valid": None if prediction is None else prediction.as_json(sheet.network.command_unit),
        "measured": _evidence(sheet.evidence) if sheet.recorded else None,
        "remarks": [*sheet.told, *remarks(sheet)],
    }


def comparison_data(differences: Sequence[Difference]) -> list[dict[str, Any]]:
    """What the second sheet's figures are more than the first's."""
    return [
        {
            "name": each.first.row.name,
            "at": _at(each.first),
            "unit": each.first.unit,
            "values": [each.first.value, each.second.value],
            "intervals": [_data_told(figure.interval, known=figure.settled) for figure in (each.first, each.second)],
            "statuses": [
                None if figure.status is None else figure.status.value for figure in (each.first, each.second)
            ],
            "extrapolated": [each.first.extrapolated, each.second.extrapolated],
            "difference": each.value,
            "interval": list(each.interval),
            "significant": each.significant,
        }
        for each in differences
    ]


def _parameter(each: SheetValue) -> dict[str, Any]:
    return {
        "value": each.shown,
        "interval": _data_told(each.interval, known=each.settled),
        "unit": each.unit,
        "status": _status(each),
    }


def _figure(figure: Figure, sheet: Sheet) -> dict[str, Any]:
    return {
        "name": figure.row.name,
        "symbol": figure.row.symbol,
        "meaning": figure.row.meaning,
        "formula": figure.row.formula,
        "value": figure.shown,
        "interval": _data_told(figure.interval, known=figure.settled),
        "unit": figure.unit,
        "at": _at(figure),
        "valid": valid_where(figure, sheet),
        "extrapolated": figure.extrapolated,
        "status": _status(figure),
    }


def _status(each: SheetValue | Figure) -> str | None:
    return None if each.status is None else each.status.value


def _data_told(interval: Interval, *, known: bool) -> list[float] | None:
    return list(interval) if known else None


def _at(figure: Figure) -> dict[str, Any] | None:
    at = figure.at
    if at is None:
        return None
    return {"name": at.name, "command": at.command, "velocity_rad_s": at.velocity_rad_s}


def _evidence(evidence: Evidence) -> dict[str, Any]:
    gap, warming = evidence.gap, evidence.warming
    return {
        "spectra": None if evidence.spectra is None else _spectra(evidence.spectra),
        "cogging": [_order(order) for order in evidence.orders],
        "free_play": None
        if gap is None
        else {"width_rad": gap.width_rad, "interval_rad": list(gap.interval_rad), "shows": bool(gap.is_gap)},
        "temperature": None
        if warming is None
        else {
            "from_c": warming.from_c,
            "to_c": warming.to_c,
            "friction_change_nm": warming.change_nm,
            "half_width_nm": warming.half_width_nm,
        },
        "electrical_efficiency": None,
    }


def _spectra(spectra: Spectra) -> dict[str, Any]:
    return {
        "averages": spectra.averages,
        "velocity_rms_rad_s": spectra.velocity_rms_rad_s,
        "torque_over_command": _path(spectra.torque),
        "impedance_nms_rad": _path(spectra.impedance),
    }


def _path(path: Transfer) -> dict[str, list[float]]:
    return {
        "frequency_hz": path.frequency_hz.tolist(),
        "magnitude": np.abs(path.response).tolist(),
        "half_width": path.half_width.tolist(),
        "phase_deg": np.degrees(np.angle(path.response)).tolist(),
        "coherence": path.coherence.tolist(),
    }


def _order(order: Order) -> dict[str, Any]:
    return {
        "periods_per_turn": order.periods_per_turn,
        "cogging_nm": _wave(order.cogging_nm),
        "ripple": _wave(order.ripple),
        "angle_error_rad": _wave(order.angle_error_rad),
    }


def _wave(wave: Wave) -> dict[str, Any]:
    return {"amplitude": wave.amplitude, "half_width": wave.half_width, "significant": wave.shows}


# What stands on a sheet, in order, whether it becomes a page or paper.
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
    evidence = _content_told([(*sheet.told, *remarks(sheet)) for sheet in sheets], letters)
    title = " and ".join(dict.fromkeys(sheet.name for sheet in sheets))
    return Content(title, subjects, evidence, tuple(_tables(sheets, letters)), tuple(pictures(sheets)))


def _content_told(sentences: Sequence[Sequence[str]], letters: Sequence[str]) -> tuple[str, ...]:
    """Each sentence with the letters of the sheets that it is said of."""
    every = dict.fromkeys(sentence for each in sentences for sentence in each)
    whose = {
        sentence: " and ".join(letter for letter, own in zip(letters, sentences, strict=True) if sentence in own)
        for sentence in every
    }
    return tuple(f"{whose[sentence]}: {sentence}" if whose[sentence] else sentence for sentence in every)


def _tables(sheets: Sequence[Sheet], letters: Sequence[str]) -> list[tuple[str, Facts]]:
    if len(sheets) == 1:
        result = [("Parameters", parameter_table(sheets[0])), ("What follows from them", figure_table(sheets[0]))]
    else:
        first, second = sheets
        result = [
            ("Parameters", parameter_difference_table(first, second)),
            ("What follows from them", difference_table(compared(first, second))),
        ]
    for letter, sheet in zip(letters, sheets, strict=True):
        table = order_table(sheet)
        if table is not None:
            result.append((f"Cogging and ripple {letter}".strip(), table))
    return result


# The sheet as one HTML file that needs nothing else, in the report's looks.
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
