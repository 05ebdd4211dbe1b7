"""The report: one HTML file that needs nothing else, the same for the same data to the last byte."""

from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from norton_bench.errors import ExperimentError
from norton_bench.models.parameters import BY_NAME, Estimate, Status
from norton_bench.report.facts_tables import derived_facts, model_of
from norton_bench.report.sections import sections
from norton_bench.report.streams import stream_qualities
from norton_bench.report.svg import style
from norton_bench.report.words import TERMS, interval, percent, pretty_unit, symbol, to_its_digits
from norton_bench.result import Result

__all__ = ["Result", "render", "write_report"]


@dataclass(frozen=True)
class Row:
    """One parameter as the headline table shows it."""

    symbol: str
    meaning: str
    value: str
    interval: str
    unit: str
    status: str
    settled: bool


@dataclass(frozen=True)
class Figure:
    """One number in the headline."""

    value: str
    meaning: str


def write_report(path: Path, data: Result) -> Path:
    """Write the report on ``data`` to ``path``, which it returns. Raises ExperimentError where it cannot be written."""
    return write_page(path, render(data))


def write_page(path: Path, text: str) -> Path:
    """Raises ExperimentError where it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ExperimentError(f"cannot write the report {path}: {error.strerror}; choose another folder") from error
    return path


def render(data: Result) -> str:
    """The page."""
    with style():
        parts = sections(data)
    return fill(
        data=data,
        headline=headline(data),
        rows=[row(estimate) for estimate in data.fit.estimates] if data.fit is not None else [],
        verdict=verdict(data),
        sections=parts,
        commands=how_to_repeat(data),
        model=None if data.fit is None else model_of(data.fit, data.command_unit),
        derived=None if data.fit is None else derived_facts(data.fit),
        terms=TERMS,
    )


def fill(**parts: object) -> str:
    """The template with its parts; of a page that is not of one session's network there is no model and no glossary."""
    environment = Environment(
        loader=PackageLoader("norton_bench.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    css = Markup(environment.get_template("report.css").render())
    parts = {"model": None, "derived": None, "terms": (), **parts}
    return environment.get_template("report.html.j2").render(css=css, markup=Markup, **parts)


def row(estimate: Estimate) -> Row:
    """An estimate in words; no number is printed as known where the data cannot tell it."""
    known = estimate.status in (Status.VALID, Status.LEARNING)
    shown = estimate.status is not Status.UNEXCITED
    return Row(
        symbol=symbol(estimate),
        meaning=BY_NAME[estimate.name].meaning if estimate.name in BY_NAME else estimate.name,
        value=to_its_digits(estimate.value, estimate.std) if shown else "–",
        interval=interval(estimate.value, estimate.std) if known else "–",
        unit=pretty_unit(estimate.unit),
        status=estimate.status.value,
        settled=estimate.status is Status.VALID,
    )


def headline(data: Result) -> list[Figure]:
    """The few numbers that come first."""
    numbers = []
    if data.fit is not None:
        valid = sum(estimate.status is Status.VALID for estimate in data.fit.estimates)
        numbers.append(Figure(f"{valid} of {len(data.fit.estimates)}", "parameters valid"))
    if data.validation is not None:
        numbers.append(Figure(percent(data.validation.torque_relative), "torque prediction error"))
        numbers.append(Figure(percent(data.validation.velocity_relative), "free velocity prediction error"))
    if data.measured is not None:
        lost = sum(quality.lost for quality in stream_qualities(data.measured))
        numbers.append(Figure(str(lost), "readings lost"))
    return numbers


def verdict(data: Result) -> list[str]:
    """What the data cannot tell, in sentences."""
    if data.fit is None and (data.source is not None or data.exertion is not None):
        return ["No model was fitted: the actuator is described by its tables.", *data.notes]
    if data.fit is None:
        return [
            "Nothing was fitted: nothing was measured from which a network could be identified.",
            *data.notes,
        ]
    sentences = list(data.fit.verdict)
    if data.validation is None:
        sentences.append("The predictions were not tested: no motion was kept apart from the fit.")
    return [*sentences, *data.notes]


def how_to_repeat(data: Result) -> list[tuple[str, str]]:
    """Commands, each with what it does."""
    known = data.metadata
    commands = []
    seed = f" --seed {known['seed']}" if known.get("seed") else ""
    if known.get("session", "").endswith(".toml"):
        commands.append((f"norton-bench run {known['session']}{seed}", "runs the session again"))
    elif known.get("rig_file"):
        arguments = f" {known['arguments']}" if known.get("arguments") else ""
        commands.append((f"norton-bench identify {known['rig_file']}{arguments}{seed}", "runs the experiment again"))
    if known.get("recording"):
        commands.append((f"norton-bench fit {known['recording']}", "fits this recording again"))
        commands.append((f"norton-bench report {known['recording']}", "writes this report again"))
    return commands
