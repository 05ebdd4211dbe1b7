"""Progress of a session on stderr: a bar with the time left on a terminal, else a line for each step."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count

from rich.console import Console
from rich.progress import BarColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from norton_bench.cli.output import Output
from norton_bench.events import (
    Note,
    PartMeasured,
    Planned,
    PlannedStep,
    SessionEvent,
    SessionState,
    StateChanged,
    StepBegun,
    Watcher,
    ignore,
)
from norton_bench.identification.results import LiveEstimate
from norton_bench.models.parameters import Status
from norton_bench.records import Measured

PREPARING = "preparing; the very first run compiles for a while"


class LineProgress:
    """A line for each step."""

    def __init__(self, output: Output) -> None:
        self._output = output
        self._steps: Sequence[PlannedStep] = ()

    def __call__(self, event: SessionEvent) -> None:
        match event:
            case Planned(steps):
                self._steps = steps
                total_s = sum(step.duration_s for step in steps)
                self._output.say(f"{len(steps)} steps, about {total_s:.0f} s of bench time")
            case StepBegun(index, name):
                self._output.say(f"[{index + 1}/{len(self._steps)}] {name}")
            case StateChanged(SessionState.PREPARING):
                self._output.say(PREPARING)
            case Note(text):
                self._output.say(text)


class BarProgress:
    """A bar for the whole session, with the running step and the number of parameters that are known."""

    def __init__(self, bars: Bars, tick_s: float) -> None:
        self._bars = bars
        self._tick_s = tick_s
        self._steps: Sequence[PlannedStep] = ()
        self._task: TaskID | None = None

    def __call__(self, event: SessionEvent) -> None:
        match event:
            case Planned(steps):
                self._steps = steps
                total_s = sum(step.duration_s for step in steps)
                self._task = self._bars.add_task("preparing", total=total_s, known="")
            case StepBegun(index, name):
                self._begin(index, name)
            case PartMeasured(measured, live):
                self._advance(measured, live)
            case StateChanged(SessionState.PREPARING):
                self._bars.console.print(PREPARING, markup=False, highlight=False)
            case StateChanged(SessionState.PAUSED | SessionState.ASKING):
                self._bars.stop()  # it must not overwrite what the operator types
            case StateChanged():
                self._bars.start()
            case Note(text):
                self._bars.console.print(text, markup=False, highlight=False)

    def _begin(self, index: int, name: str) -> None:
        if self._task is None:
            return
        before_s = sum(step.duration_s for step in self._steps[:index])
        self._bars.update(self._task, description=f"{index + 1}/{len(self._steps)} {name}", completed=before_s)

    def _advance(self, measured: Measured, live: LiveEstimate) -> None:
        if self._task is None:
            return
        valid = sum(estimate.status is Status.VALID for estimate in live.estimates)
        known = f"{valid} of {len(live.estimates)} parameters known" if live.estimates else ""
        self._bars.update(self._task, advance=len(measured.ticks) * self._tick_s, known=known)


@contextmanager
def counting(output: Output, total: int) -> Iterator[Callable[[str], None]]:
    """A function to call with a line of text after each of ``total`` tasks."""
    if output.quiet:
        yield lambda _line: None
    elif not sys.stderr.isatty():
        done = count(1)
        yield lambda line: output.say(f"[{next(done)}/{total}] {line}")
    else:
        columns = (BarColumn(), TextColumn("{task.completed}/{task.total}"), TimeRemainingColumn())
        with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
            task = bars.add_task("", total=total)

            def step(line: str) -> None:
                bars.console.print(line, markup=False, highlight=False)
                bars.advance(task)

            yield step


@contextmanager
def showing_progress(output: Output, tick_s: float) -> Iterator[Watcher]:
    """The watcher to give to a session, so that its progress is shown."""
    if output.quiet:
        yield ignore
    elif not sys.stderr.isatty():
        yield LineProgress(output)
    else:
        columns = (
            TextColumn("{task.description:<16}"),
            BarColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[known]}"),
        )
        with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
            yield BarProgress(bars, tick_s)
