"""The screen of a bench that is moved by hand: every signal, and keys that nudge."""

import time
from collections.abc import Callable
from math import ceil, isfinite

from textual.app import ComposeResult
from textual.containers import Container
from textual.screen import Screen
from textual.widgets import Footer

from norton_bench.events import Ended, SessionState
from norton_bench.jog.by_hand import Jog
from norton_bench.jog.hands import bounds_of
from norton_bench.screen import figures
from norton_bench.screen.experiment import Experiment, badge_of
from norton_bench.screen.keyboard import keeps_up
from norton_bench.screen.panels.by_hand import Asking, asked_rows, device_rows, imposes, pushes, ready_rows
from norton_bench.screen.panels.health import in_short, signal_rows
from norton_bench.screen.panels.progress import LINE_BEGINS, log_rows, title_row
from norton_bench.screen.panels.rows import Panel, Plot
from norton_bench.screen.picture.picture import OPERATOR
from norton_bench.screen.plots import PlotFigure
from norton_bench.screen.screens import keys
from norton_bench.screen.screens.questions import Body, Confirm, Mark
from norton_bench.screen.styles import PHONE, Row
from norton_bench.segments import ZERO_TORQUE, Admittance

SHARES = (0.005, 0.01, 0.02, 0.05, 0.1)
USUAL_SHARE = 2
WINDOW_S = 10.0
# Numbers that change more often are not readable.
NUMBERS_EVERY_S = 0.2
CALIBRATION = (
    "The load's controller is tuned from a calibration: both machines push, and shake the shaft for about 20 "
    "s, at speeds up to [limits] velocity. The drives are idle before and after."
)


class ByHandScreen(Screen[None]):
    """Shows the state of ``experiment``, in which ``jog`` moves the bench, and sends the orders of its keys."""

    BINDINGS = keys.BY_HAND
    HORIZONTAL_BREAKPOINTS = [*PHONE, (130, "-wide")]  # noqa: RUF012  (textual declares it so)
    VERTICAL_BREAKPOINTS = [(0, "-short"), (40, "-high")]  # noqa: RUF012

    def __init__(self, experiment: Experiment, jog: Jog, *, fps: float, abort: Callable[[], None]) -> None:
        super().__init__()
        self.experiment = experiment
        self._jog, self._bounds = jog, bounds_of(experiment.rig, jog.speed_rad_s)
        self._fps, self._abort = fps, abort
        self._share, self._touched_s = USUAL_SHARE, time.monotonic()
        self._law = ZERO_TORQUE  # of the last body that was asked for
        self._frames, self._numbers_every = 0, max(1, ceil(NUMBERS_EVERY_S * fps))
        self._told_state: SessionState | None = None
        self._told_end: Ended | None = None
        self._told_lines = 0  # of the log
        self._marks = set[str]()  # of one's own

    def compose(self) -> ComposeResult:
        yield Panel(self._title, id="title")
        yield Panel(self._asked, id="asked")
        with Container(id="by-hand"):
            yield Panel(self._signals, id="signals")
            with Container(id="by-hand-plots"):
                yield Plot(id="velocity")
                yield Plot(id="torque")
                yield Plot(id="command")
        with Container(id="by-hand-below"):
            yield Panel(lambda w, h: device_rows(self.experiment.picture, w, h), id="devices")
            yield Panel(lambda w, h: log_rows(self.experiment.picture.log, w, h), id="happened")
        yield Footer()

    def on_mount(self) -> None:
        self.set_interval(1 / self._fps, self._frame)

    def on_resize(self) -> None:
        """What had no room until now has missed the last frames, and after the end there are no more."""
        self.call_after_refresh(self.draw_frame, all_of_it=True)

    def _frame(self) -> None:
        """Read the events; draw, where the terminal has taken the last frame."""
        self.experiment.update()
        self._attend()
        if self.app.screen is self and keeps_up(self.app._driver):
            self.draw_frame()

    def draw_frame(self, *, all_of_it: bool = False) -> None:
        """Draw the plots with every frame, numbers less often."""
        self._frames += 1
        for plot in self.query(Plot):
            if plot.is_on_screen or all_of_it:
                plot.show(self._figure(plot.id))
        if self._frames % self._numbers_every == 0 or all_of_it:
            for panel in self.query(Panel):
                panel.changed()

    def _figure(self, name: str | None) -> PlotFigure:
        picture = self.experiment.picture
        if name == "velocity":
            return figures.velocity(picture, WINDOW_S, imposed=imposes(picture))
        return (figures.torque if name == "torque" else figures.command)(picture, WINDOW_S)

    def _title(self, width: int, height: int) -> list[Row]:
        experiment = self.experiment
        message = "stopping" if experiment.stopped and experiment.live else in_short(experiment.picture.health)
        return [title_row(experiment.picture, experiment.what, message, width, badge_of(experiment))]

    def _asked(self, width: int, height: int) -> list[Row]:
        asking = Asking(SHARES[self._share], self._left_s)
        return asked_rows(self.experiment.picture, self._bounds, asking, width, live=self.experiment.live)

    def _signals(self, width: int, height: int) -> list[Row]:
        rig = self.experiment.rig
        if not any(isfinite(each.value) for each in self.experiment.picture.signals.seen()):
            return ready_rows(self.experiment.picture, self._bounds, self._jog.dead_man_s, width, height)
        seen, stale_after_s = self.experiment.picture.signals.seen(), rig.limits.stale_after_ns * 1e-9
        return signal_rows(seen, stale_after_s, width, height, live=self.experiment.live)

    @property
    def _left_s(self) -> float | None:
        if not self.experiment.live or not pushes(self.experiment.picture):
            return None
        return max(self._jog.dead_man_s - (time.monotonic() - self._touched_s), 0.0)

    def _attend(self) -> None:
        """Show at once that drives are enabled, and the end."""
        state, summary = self.experiment.picture.state, self.experiment.summary
        self._tell_answers()
        if state is not self._told_state:
            self._told_state, self._touched_s = state, time.monotonic()
            self.refresh_bindings()
            self.draw_frame(all_of_it=True)
        if summary is not None and summary is not self._told_end:
            self._told_end = summary
            if summary.failure:
                severity = "warning" if self.experiment.stopped else "error"
                self.notify(summary.failure, title="Stopped", severity=severity, timeout=10, markup=False)  # type: ignore[arg-type]
            else:
                self.notify(f"Done; recorded in {summary.recording}", timeout=10, markup=False)

    def _tell_answers(self) -> None:
        """Show what the log has no room for: why a key has not done what was asked for."""
        log = self.experiment.picture.log
        new = list(log.lines)[-(log.total - self._told_lines) :] if log.total > self._told_lines else []
        self._told_lines = log.total
        room = self.query_one("#happened").size.width - LINE_BEGINS
        for line in new:
            text = line.text.removeprefix("mark: ")
            if line.kind == OPERATOR and len(line.text) > room and text not in self._marks:
                self.notify(text, severity="warning", timeout=15, markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Hide keys that have no effect now."""
        live, load = self.experiment.live, self.experiment.rig.wiring.load is not None
        if action in ("order", "mark", "end"):
            return live
        if action in ("nudge_load", "load", "body", "calibrate"):
            return live and load
        return not live if action == "start" else True

    def _order(self, text: str) -> None:
        self._touched_s = time.monotonic()
        self.experiment.order("jog", text)

    def action_start(self) -> None:
        self.experiment.start()
        self.refresh_bindings()

    def action_order(self, text: str) -> None:
        self._order(text)

    def action_nudge(self, sign: int) -> None:
        if self.experiment.live:
            self._order(f"actuator {sign * SHARES[self._share]:g}")

    def action_nudge_load(self, sign: int) -> None:
        self._order(f"load {sign * SHARES[self._share]:g}")

    def action_load(self, does: str) -> None:
        self._order(does)

    def action_body(self) -> None:
        def act(law: Admittance | None) -> None:
            if law is not None:
                self._law = law
                wall = () if law.wall_rad is None else (law.wall_rad,)
                self._order("body " + " ".join(map(repr, (*law.values, *wall))))

        self.app.push_screen(Body(self._law, lambda: self._order("here")), act)

    def action_share(self, steps: int) -> None:
        self._share = min(max(self._share + steps, 0), len(SHARES) - 1)
        self.query_one("#asked", Panel).changed()

    def action_calibrate(self) -> None:
        self.app.push_screen(
            Confirm("Calibrate the load?", CALIBRATION, "Calibrate"),
            lambda sure: self._order("calibrate") if sure else None,
        )

    def action_extremes(self) -> None:
        self.experiment.picture.signals.forget_extremes()
        self.draw_frame(all_of_it=True)

    def action_devices(self) -> None:
        self.toggle_class("-devices")
        self.call_after_refresh(self.draw_frame, all_of_it=True)

    def action_mark(self) -> None:
        def put(text: str | None) -> None:
            if text:
                self._marks.add(text)
                self.experiment.order("mark", text)

        self.app.push_screen(Mark(), put)

    def action_end(self) -> None:
        self._order("end")

    def action_abort(self) -> None:
        self.experiment.stop("the operator went back")
        self._abort()
