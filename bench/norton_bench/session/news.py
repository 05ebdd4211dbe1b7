"""A session's news as plain data, one class for each method of :class:`~norton_bench.session.progress.Progress`.

They cross from process to process, and are the same whether a session runs or a recording of one is played back.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from norton_bench.identification.results import LiveEstimate
from norton_bench.records import Measured
from norton_bench.session.progress import PlannedStep, Progress, Prompt, SessionState, Summary


@dataclass(frozen=True)
class PlanNews:
    steps: tuple[PlannedStep, ...]

    def tell(self, progress: Progress) -> None:
        progress.plan(self.steps)


@dataclass(frozen=True)
class StepNews:
    index: int
    name: str

    def tell(self, progress: Progress) -> None:
        progress.step(self.index, self.name)


@dataclass(frozen=True)
class PartNews:
    """``lost`` parts before it were dropped on the way to a watcher who was slow; the recording has them."""

    measured: Measured  # without raw frames
    live: LiveEstimate
    lost: int = 0

    def tell(self, progress: Progress) -> None:
        progress.part(self.measured, self.live)


@dataclass(frozen=True)
class NoteNews:
    text: str

    def tell(self, progress: Progress) -> None:
        progress.note(self.text)


@dataclass(frozen=True)
class StateNews:
    state: SessionState

    def tell(self, progress: Progress) -> None:
        progress.state(self.state)


@dataclass(frozen=True)
class AskNews:
    prompt: Prompt

    def tell(self, progress: Progress) -> None:
        progress.ask(self.prompt)


@dataclass(frozen=True)
class ResultNews:
    summary: Summary

    def tell(self, progress: Progress) -> None:
        progress.result(self.summary)


News = PlanNews | StepNews | PartNews | NoteNews | StateNews | AskNews | ResultNews


class Teller:
    """A session's progress, told as news to ``hear``."""

    def __init__(self, hear: Callable[[News], None]) -> None:
        self._hear = hear

    def plan(self, steps: Sequence[PlannedStep]) -> None:
        self._hear(PlanNews(tuple(steps)))

    def step(self, index: int, name: str) -> None:
        self._hear(StepNews(index, name))

    def part(self, measured: Measured, live: LiveEstimate) -> None:
        self._hear(PartNews(measured.without_frames(), live))

    def note(self, text: str) -> None:
        self._hear(NoteNews(text))

    def state(self, state: SessionState) -> None:
        self._hear(StateNews(state))

    def ask(self, prompt: Prompt) -> None:
        self._hear(AskNews(prompt))

    def result(self, summary: Summary) -> None:
        self._hear(ResultNews(summary))
