"""The screen with the result of an experiment."""

import os
import sys
from pathlib import Path

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.geometry import Size
from textual.screen import Screen
from textual.widgets import Footer

from norton_bench.screen.experiment import Experiment, badge_of
from norton_bench.screen.panels.progress import title_row
from norton_bench.screen.panels.result import result_rows
from norton_bench.screen.panels.rows import Panel
from norton_bench.screen.screens import keys
from norton_bench.screen.styles import LABEL, STRONG, Row

LOOK_EVERY_S = 0.2
GRAPHICAL = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")


class Page(Panel):
    """A page as high as its rows."""

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        return max(len(self.draw(width, 0)), 1)


class ResultsScreen(Screen[None]):
    """Shows the result, and before it the stage of the fit."""

    BINDINGS = keys.RESULTS

    def __init__(self, experiment: Experiment) -> None:
        super().__init__()
        self.experiment = experiment
        self._shown = False

    def compose(self) -> ComposeResult:
        yield Panel(self._title, id="title")
        with VerticalScroll(id="page"):
            yield Page(self._rows, id="result")
        yield Footer()

    def on_mount(self) -> None:
        self.query_one("#page").focus()
        self.set_interval(LOOK_EVERY_S, self._look)

    def _title(self, width: int, height: int) -> list[Row]:
        return [title_row(self.experiment.picture, self.experiment.what, "results", width, badge_of(self.experiment))]

    def _rows(self, width: int, height: int) -> list[Row]:
        summary = self.experiment.summary
        if summary is None:
            stage = self.experiment.fitting
            return [
                [(f"◌ {stage}", STRONG)],
                [("It takes up to a minute; then the result is shown here. Escape goes back.", LABEL)],
            ]
        return result_rows(summary, width)

    def _look(self) -> None:
        """Until the result is known, show the stage of the fit."""
        if self._shown:
            return
        self._shown = self.experiment.summary is not None
        page = self.query_one("#result", Page)
        page.changed()
        page.refresh(layout=True)
        self.query_one("#title", Panel).changed()
        if self._shown:
            self.refresh_bindings()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        return action != "open_report" or self._report is not None

    @property
    def _report(self) -> Path | None:
        summary = self.experiment.summary
        return None if summary is None else summary.report

    def action_open_report(self) -> None:
        """Open it in a graphical browser; over ssh a text browser would take the terminal."""
        if self._report is None:
            return
        if sys.platform == "darwin" or any(os.environ.get(name) for name in GRAPHICAL):
            self.app.open_url(self._report.resolve().as_uri())
        self.notify(str(self._report), title="The report")

    def action_back(self) -> None:
        self.dismiss()
