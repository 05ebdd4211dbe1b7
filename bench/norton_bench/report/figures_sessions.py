"""What each session says of each parameter, and all of them together: a forest plot."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from norton_bench.identification.sessions import Fitted
from norton_bench.models.parameters import BY_NAME, Estimate
from norton_bench.report.svg import GRID, MEASURED, PREDICTED, figure
from norton_bench.report.words import power, pretty_unit, scale_of

_COLUMNS = 3


def forest_figure(sessions: Sequence[Fitted], combined: Sequence[Estimate]) -> Figure:
    """A panel a parameter, a row a session with its 95 % interval, the combined value below."""
    rows = max(1, -(-len(combined) // _COLUMNS))
    picture = figure(rows * (0.75 + 0.2 * (len(sessions) + 1)))
    panels = picture.subplots(rows, _COLUMNS, squeeze=False, sharey=True).ravel()
    for axes, estimate in zip(panels, combined, strict=False):
        _panel(axes, sessions, estimate)
    for axes in panels[len(combined) :]:
        axes.set_visible(False)
    # The axis is shared: what is said of one panel's rows holds for all.
    numbers = [str(number) for number in range(1, len(sessions) + 1)]
    panels[0].set_yticks(range(len(sessions) + 1), [*numbers, "all"])
    panels[0].set_ylim(len(sessions) + 0.6, -0.6)
    return picture


def _panel(axes: Axes, sessions: Sequence[Fitted], combined: Estimate) -> None:
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
    axes.set_title(f"{BY_NAME[combined.name].symbol}  [{unit or '1'}]")


def _mark(axes: Axes, place: int, value: float, std: float, colour: str, marker: str) -> None:
    axes.errorbar(
        value, place, xerr=1.96 * np.nan_to_num(std), color=colour, marker=marker, markersize=4, elinewidth=1.3
    )
