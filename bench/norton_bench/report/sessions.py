"""The report on several sessions: the combined values, and the differences between sessions."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from norton_bench.identification.results import FitResult
from norton_bench.identification.sessions import SessionFit, Together, differing
from norton_bench.models.parameters import Estimate, Status
from norton_bench.report.render import HeadlineNumber, fill, row, write_page
from norton_bench.report.svg import GRID, MEASURED, PREDICTED, figure, picture, style
from norton_bench.report.words import Facts, Section, number, parameter_named, power, pretty_unit, scale_of, symbol
from norton_bench.result import Result

_COLUMNS = 3


def forest_figure(sessions: Sequence[SessionFit], combined: Sequence[Estimate]) -> Drawing:
    """A forest plot: each parameter by session, and combined.

    A panel for each parameter, a row for each session with its 95 % interval, the combined value below.
    """
    rows = max(1, -(-len(combined) // _COLUMNS))
    picture = figure(rows * (0.75 + 0.2 * (len(sessions) + 1)))
    panels = picture.subplots(rows, _COLUMNS, squeeze=False, sharey=True).ravel()
    for axes, estimate in zip(panels, combined, strict=False):
        _panel(axes, sessions, estimate)
    for axes in panels[len(combined) :]:
        axes.set_visible(False)
    # The axis is shared: labels of one panel are valid for all.
    numbers = [str(number) for number in range(1, len(sessions) + 1)]
    panels[0].set_yticks(range(len(sessions) + 1), [*numbers, "all"])
    panels[0].set_ylim(len(sessions) + 0.6, -0.6)
    return picture


def _panel(axes: Axes, sessions: Sequence[SessionFit], combined: Estimate) -> None:
    factor = 10.0 ** -scale_of(combined.value)
    for place, session in enumerate(sessions):
        own = session.taking_part(combined.name)
        if own is not None:
            _mark(axes, place, factor * own.value, factor * own.std, MEASURED, "o")
    _mark(axes, len(sessions), factor * combined.value, factor * combined.std, PREDICTED, "D")
    axes.axvline(factor * combined.value, color=PREDICTED, linewidth=0.7, alpha=0.6)
    axes.axhline(len(sessions) - 0.5, color=GRID, linewidth=0.6)
    axes.grid(visible=False, axis="y")
    axes.locator_params(axis="x", nbins=4)
    unit = f"{power(scale_of(combined.value))[1:]} {pretty_unit(combined.unit)}".strip()
    axes.set_title(f"{symbol(combined)}  [{unit or '1'}]")


def _mark(axes: Axes, place: int, value: float, std: float, colour: str, marker: str) -> None:
    axes.errorbar(
        value, place, xerr=1.96 * np.nan_to_num(std), color=colour, marker=marker, markersize=4, elinewidth=1.3
    )


@dataclass(frozen=True)
class SessionRow:
    """One session: the recording's name, when it was started (as recorded, "" where unknown), and its fit."""

    recording: str
    started: str
    fit: FitResult


@dataclass(frozen=True)
class SessionsData:
    """The data of the report."""

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
        HeadlineNumber(str(len(data.sessions)), "sessions"),
        HeadlineNumber(f"{valid} of {len(estimates)}", "parameters valid"),
        HeadlineNumber(str(len(differing(data.together.spreads))), "differ between sessions"),
    )
    with style():
        sections = (
            (_forest(data), _between(data), _recordings(data)) if data.together.combined else (_recordings(data),)
        )
    command = " ".join(["norton-bench fit", *(one.recording for one in data.sessions)])
    return fill(
        data=Result(f"{data.rig_name}, {len(data.sessions)} sessions"),
        headline=numbers,
        rows=[row(estimate) for estimate in estimates],
        verdict=data.together.verdict,
        sections=sections,
        commands=[(command, "fits these recordings again")],
    )


def _forest(data: SessionsData) -> Section:
    sessions = [SessionFit(one.recording, one.fit) for one in data.sessions]
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
            parameter.symbol if (parameter := parameter_named(name)) else name,
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
