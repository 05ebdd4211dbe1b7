"""The report on several sessions together: what they agree on, and what differs between them."""

from dataclasses import dataclass
from pathlib import Path

from norton_bench.identification.results import FitResult
from norton_bench.identification.sessions import Fitted, Together, differing
from norton_bench.models.parameters import BY_NAME, Status
from norton_bench.report.data import ReportData
from norton_bench.report.figures_sessions import forest_figure
from norton_bench.report.render import Figure, fill, row, write_page
from norton_bench.report.section import Facts, Section
from norton_bench.report.svg import picture, style
from norton_bench.report.words import number, pretty_unit


@dataclass(frozen=True)
class SessionRow:
    """One session: the recording's name, when it was started (as recorded, "" where unknown), and its fit."""

    recording: str
    started: str
    fit: FitResult


@dataclass(frozen=True)
class SessionsData:
    """All that the report shows."""

    rig_name: str
    sessions: tuple[SessionRow, ...]
    together: Together


def write_sessions_report(path: Path, data: SessionsData) -> Path:
    """Write the report to ``path``, which it returns. Raises ExperimentError where it cannot be written."""
    return write_page(path, render_sessions(data))


def render_sessions(data: SessionsData) -> str:
    """The page."""
    estimates = data.together.estimates
    valid = sum(estimate.status is Status.VALID for estimate in estimates)
    numbers = (
        Figure(str(len(data.sessions)), "sessions"),
        Figure(f"{valid} of {len(estimates)}", "parameters valid"),
        Figure(str(len(differing(data.together.spreads))), "differ between sessions"),
    )
    with style():
        sections = (
            (_forest(data), _between(data), _recordings(data)) if data.together.combined else (_recordings(data),)
        )
    command = " ".join(["norton-bench fit", *(one.recording for one in data.sessions)])
    return fill(
        data=ReportData(f"{data.rig_name}, {len(data.sessions)} sessions"),
        headline=numbers,
        rows=[row(estimate) for estimate in estimates],
        verdict=data.together.verdict,
        sections=sections,
        commands=[(command, "fits these recordings again")],
    )


def _forest(data: SessionsData) -> Section:
    sessions = [Fitted(one.recording, one.fit) for one in data.sessions]
    combined = [estimate for estimate in data.together.estimates if estimate.name in data.together.spreads]
    drawn = picture(
        forest_figure(sessions, combined),
        "forest",
        "See whether the sessions agree: intervals should overlap.",
        "Each session's own value with its 95 % interval, in the order of the table below, and the combined one. "
        "A session without a valid value is left out.",
    )
    return Section("forest", "Session by session", (), (drawn,))


def _between(data: SessionsData) -> Section:
    sentences = (
        "Spreads are standard deviations: that of one typical session's own value, and that from session to session, "
        "which is at most what the next column says, with 95 % confidence. The probability is that of so much "
        "difference by chance alone.",
    )
    head = ("parameter", "within a session", "between sessions", "at most", "unit", "probability")
    units = {estimate.name: estimate.unit for estimate in data.together.estimates}
    rows = tuple(
        (
            BY_NAME[name].symbol,
            number(spread.within_std, 2),
            number(spread.between_std, 2),
            number(spread.between_std_upper, 2),
            pretty_unit(units[name]),
            number(spread.p, 2),
        )
        for name, spread in data.together.spreads.items()
    )
    return Section("between", "Between sessions", sentences, tables=(Facts(head, rows),))


def _recordings(data: SessionsData) -> Section:
    rows = tuple(
        (str(place), one.recording, one.started.replace("T", " ").replace("+00:00", " UTC"), _convergence(one.fit))
        for place, one in enumerate(data.sessions, 1)
    )
    return Section("sessions", "The sessions", tables=(Facts(("", "recording", "started", "fit"), rows),))


def _convergence(fit: FitResult) -> str:
    return "converged" if fit.converged else "did not converge"
