"""The main screen, shown during the experiment."""

from collections.abc import Callable
from math import ceil

from textual.app import ComposeResult
from textual.containers import Container
from textual.screen import Screen
from textual.widgets import Footer

from norton_bench.events import Ended, Prompt, SessionState
from norton_bench.screen import figures
from norton_bench.screen.experiment import Experiment, badge_of
from norton_bench.screen.keyboard import keeps_up
from norton_bench.screen.panels.health import health_rows, in_short
from norton_bench.screen.panels.progress import clock, log_rows, step_rows, table_rows, title_row, view_row
from norton_bench.screen.panels.result import LEARNT, LEARNT_IN_SITU, parameter_rows
from norton_bench.screen.panels.rows import Panel, Plot
from norton_bench.screen.plots import PlotFigure
from norton_bench.screen.screens import keys
from norton_bench.screen.screens.questions import FIT_GIVEN_UP, Ask, Confirm, Mark
from norton_bench.screen.styles import PHONE, Row

VIEWS = ["Overview", "Loops", "Source", "Bench"]
WINDOWS_S = (2.0, 5.0, 10.0, 20.0, 40.0)
USUAL_WINDOW = 2
# Tables change slowly: they are drawn only with one frame of this number.
TABLES_EVERY_S = 0.2


class ExperimentScreen(Screen[None]):
    """Shows the state of ``experiment`` at ``fps`` frames a second, and sends the orders of its keys."""

    BINDINGS = keys.EXPERIMENT
    HORIZONTAL_BREAKPOINTS = [*PHONE, (110, "-medium"), (150, "-wide"), (190, "-widest")]  # noqa: RUF012  (textual declares it so)
    VERTICAL_BREAKPOINTS = [(0, "-short"), (32, "-tall"), (44, "-high")]  # noqa: RUF012

    def __init__(self, experiment: Experiment, *, fps: float, abort: Callable[[], None]) -> None:
        super().__init__()
        self.experiment = experiment
        self.frames = 0
        self._fps, self._abort = fps, abort
        self._view, self._window, self._back = 0, USUAL_WINDOW, 0
        self._drawn_changes, self._drawn_segment = -1, -1
        self._tables_every = max(1, ceil(TABLES_EVERY_S * fps))
        self._asked: Prompt | None = None
        self._told_state: SessionState | None = None
        self._told_end: Ended | None = None

    def compose(self) -> ComposeResult:
        yield Panel(self._title, id="title")
        yield Panel(self._views, id="views")
        with Container(id="body"):
            with Container(id="traces"):
                yield Plot(id="torque")
                yield Plot(id="velocity")
                yield Plot(id="command")
            with Container(id="planes"):
                yield Plot(id="torque-velocity")
                yield Plot(id="torque-position")
                yield Plot(id="source")
            with Container(id="tables"):
                yield Panel(self._results, id="parameters")
                yield Panel(lambda w, h: step_rows(self.experiment.picture.steps, w, h), id="steps")
                yield Panel(lambda w, h: health_rows(self.experiment.picture, w, h), id="health")
        yield Panel(lambda w, h: log_rows(self.experiment.picture.log, w, h, back=self._back), id="log")
        yield Footer()

    def on_mount(self) -> None:
        self.action_view(0)
        self.set_interval(1 / self._fps, self._frame)

    def on_resize(self) -> None:
        """What had no room until now has missed the last frames, and after the end there are no more."""
        self.call_after_refresh(self.draw_frame, all_of_it=True)

    def _frame(self) -> None:
        """Read the events; draw, where there are any and the terminal has taken the last frame."""
        self.experiment.update()
        self._attend()
        if self.app.screen is self and keeps_up(self.app._driver):
            self.draw_frame()

    def draw_frame(self, *, all_of_it: bool = False) -> None:
        """Draw everything that changed."""
        picture = self.experiment.picture
        if picture.changes == self._drawn_changes and not all_of_it:
            return
        self._drawn_changes = picture.changes
        self.frames += 1
        if picture.segment is not None and picture.segment.index != self._drawn_segment:
            self._drawn_segment = picture.segment.index
            for name in ("torque-velocity", "torque-position"):
                self.query_one(f"#{name}", Plot).forget()
        for plot in self.query(Plot):
            if plot.is_on_screen or all_of_it:
                plot.show(self._figure(plot.id or ""))
        if self.frames % self._tables_every == 1 or self._tables_every == 1 or all_of_it:
            for panel in self.query(Panel):
                panel.changed()

    def _figure(self, name: str) -> PlotFigure:
        picture, window_s = self.experiment.picture, WINDOWS_S[self._window]
        over_time = {"torque": figures.torque, "velocity": figures.velocity, "command": figures.command}
        if name in over_time:
            return over_time[name](picture, window_s)
        planes = {"torque-velocity": figures.torque_velocity, "torque-position": figures.torque_position}
        return planes.get(name, figures.source)(picture)

    def _results(self, width: int, height: int) -> list[Row]:
        """The parameters so far, or the tables of an actuator without a model."""
        picture = self.experiment.picture
        if picture.rig.modelled:
            before = LEARNT_IN_SITU if picture.in_situ else LEARNT
            return parameter_rows(picture.known, width, height, before=before)
        return table_rows(picture.tabulated, picture.rig.command.unit, width, height)

    def _title(self, width: int, height: int) -> list[Row]:
        experiment = self.experiment
        message = in_short(experiment.picture.health)
        if experiment.replay is not None:
            replay = experiment.replay.replay
            message = f"{clock(replay.now_s)} of {clock(replay.duration_s)}, {replay.speed:g}×"
        elif experiment.stopped and experiment.live:
            message = "stopping"
        return [title_row(experiment.picture, experiment.what, message, width, badge_of(experiment))]

    def _views(self, width: int, height: int) -> list[Row]:
        return [view_row(self.experiment.picture, VIEWS, self._view, width)]

    def _attend(self) -> None:
        """Show questions, and the end, at once."""
        self._tell_end()
        prompt = self.experiment.prompt
        if prompt is not None and prompt is not self._asked and self.app.screen is self:
            self._asked = prompt
            self.action_answer()
        state = self.experiment.picture.state
        if state is not self._told_state:
            self._told_state = state
            self.refresh_bindings()
            self.draw_frame(all_of_it=True)

    def _tell_end(self) -> None:
        """Show the end of a session, in whatever view."""
        summary = self.experiment.summary
        if summary is not None and summary is not self._told_end and self.experiment.replay is None:
            self._told_end = summary
            if summary.failure:
                self.notify(summary.failure, title="Stopped", severity="error", timeout=10, markup=False)
            elif self.app.screen is self:
                self.notify("Done; r shows the results.", timeout=10)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Hide keys that have no effect now."""
        experiment = self.experiment
        replayed, state = experiment.replay is not None, experiment.picture.state
        waiting = state is SessionState.ASKING
        may = {
            "start": not replayed and not experiment.live,
            "pause": not experiment.paused and (replayed or (experiment.moving and not waiting)),
            "resume": experiment.paused,
            "answer": experiment.prompt is not None,
            "tare": experiment.moving,
            "mark": experiment.moving,
            "skip": experiment.moving,
            "results": experiment.summary is not None or replayed or experiment.picture.concluding,
            "seek": replayed,
            "speed": replayed,
        }
        return may.get(action, True)

    def action_start(self) -> None:
        self.experiment.start()
        self._drawn_changes = self._drawn_segment = -1
        self.refresh_bindings()

    def action_pause(self) -> None:
        self.experiment.order("pause")
        self.refresh_bindings()
        if self.experiment.live:
            self.notify("Will pause at the next checkpoint, with the drives idle.")

    def action_resume(self) -> None:
        self.experiment.order("resume")
        self.refresh_bindings()

    def action_tare(self) -> None:
        self.experiment.order("tare")
        self.notify("Will tare at the next checkpoint.")

    def action_skip(self) -> None:
        self.experiment.order("skip")
        self.notify("The next step will be left out.")

    def action_mark(self) -> None:
        self.app.push_screen(Mark(), lambda text: self.experiment.order("mark", text) if text else None)

    def action_answer(self) -> None:
        prompt = self.experiment.prompt
        if prompt is not None:
            self.app.push_screen(Ask(prompt), self._answered)

    def _answered(self, text: str | None) -> None:
        if text is not None:
            self.experiment.order("answer", text)

    def action_abort(self) -> None:
        if self.experiment.live:
            consequence = "The drives stop at once." if self.experiment.moving else FIT_GIVEN_UP
            self.app.push_screen(Confirm("Abort the experiment?", consequence, "Abort"), self._abort_if)
        else:
            self._abort()

    def _abort_if(self, sure: bool | None) -> None:
        if sure:
            self.experiment.stop("the operator aborted it")
            self._abort()

    def action_view(self, chosen: int) -> None:
        self._view = chosen
        for number in range(len(VIEWS)):
            self.set_class(number == chosen, f"-view-{number}")
        self.call_after_refresh(self.draw_frame, all_of_it=True)

    def action_window(self, steps: int) -> None:
        self._window = min(max(self._window + steps, 0), len(WINDOWS_S) - 1)
        self.draw_frame(all_of_it=True)

    def action_scroll_log(self, lines: int) -> None:
        most = max(len(self.experiment.picture.log.lines) - 1, 0)
        self._back = min(max(self._back + lines, 0), most)
        self.query_one("#log", Panel).changed()

    def action_seek(self, by_s: float) -> None:
        replayed = self.experiment.replay
        if replayed is not None:
            self.experiment.seek(replayed.replay.now_s + by_s)
            self._drawn_changes = self._drawn_segment = -1

    def action_speed(self, steps: int) -> None:
        replayed = self.experiment.replay
        if replayed is not None:
            replayed.replay.faster(steps)
            self.query_one("#title", Panel).changed()

    def action_results(self) -> None:
        self.app.show_results()  # type: ignore[attr-defined]
