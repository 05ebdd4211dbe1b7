"""The report of a log of another program: one HTML file in the style of a session's report."""

from collections.abc import Mapping
from pathlib import Path

from norton_bench.logs.results import Errors, LogFit
from norton_bench.models.parameters import Status
from norton_bench.report.figures_fit import residual_figure, validation_figure
from norton_bench.report.render import HeadlineNumber, fill, row, write_page
from norton_bench.report.svg import picture, style
from norton_bench.report.words import Facts, Section, number, percent, pretty_unit
from norton_bench.result import Result


def write_log_report(path: Path, title: str, fit: LogFit, metadata: Mapping[str, str], command: str) -> Path:
    """Write the report to ``path``, which it returns; ``command`` makes it again.

    Raises ExperimentError where it cannot be written.
    """
    with style():
        parts = [_exertion(fit), _errors(fit), _ladder(fit)]
    valid = sum(estimate.status is Status.VALID for estimate in fit.estimates)
    text = fill(
        data=Result(title, metadata=metadata),
        headline=[HeadlineNumber(f"{valid} of {len(fit.estimates)}", "parameters valid")],
        rows=[row(estimate) for estimate in fit.estimates],
        verdict=fit.verdict,
        sections=parts,
        commands=[(command, "fits this log again")],
    )
    return write_page(path, text)


def _exertion(fit: LogFit) -> Section:
    pictures = (
        picture(
            validation_figure(fit.exertion, "exertion"),
            "exertion",
            "Judge how well the fitted equation of motion describes this log.",
            "Force or torque as known from the log, and as the equation of motion gives it.",
        ),
        picture(
            residual_figure(fit.exertion),
            "residual",
            "Check that the error looks like noise: no stretch worse than others, no long tails.",
            "Measured minus equation, over time, and how often each size occurs.",
        ),
    )
    return Section("exertion", f"Exertion, friction {fit.model}", figures=pictures)


def _errors(fit: LogFit) -> Section:
    rows = [line for side, errors in (("train", fit.train), ("test", fit.test)) for line in _lines(side, errors)]
    head = ("part", "quantity", "rms error", "of its rms", "mean absolute error", "unit")
    return Section("errors", "Errors", tables=(Facts(head, tuple(rows)),))


def _lines(side: str, errors: Errors) -> list[tuple[str, ...]]:
    return [
        (
            side,
            what,
            number(error.rms, 3),
            percent(error.relative),
            number(error.mean_absolute, 3),
            pretty_unit(error.unit),
        )
        for what, error in (("exertion", errors.exertion), ("motion", errors.motion))
        if error is not None
    ]


def _ladder(fit: LogFit) -> Section:
    rows = [
        (step.model, percent(step.train_relative), percent(step.held_out_relative), percent(step.held_out_std))
        for step in fit.ladder
    ]
    sentences = (
        "The data held out, each part of the log in turn, are predicted by a fit to the other parts.",
        "Errors are rms, as a share of the rms of force or torque.",
    )
    facts = Facts(("model", "error, fitted data", "error, data held out", "standard error"), tuple(rows))
    return Section("ladder", "Comparison of friction models", sentences, tables=(facts,))
