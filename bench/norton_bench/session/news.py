"""A session's news as plain data, one class for each method of :class:`~norton_bench.session.progress.Progress`.

They cross from process to process, and are the same whether a session runs or a recording of one is played back.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from threading import Condition

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


# About ten seconds of a session in wall time.
MOST_PARTS = 256


class Mailbox:
    """News on their way to a watcher, who may be slow: parts are bounded in number, all else is kept.

    Between threads. Where too many parts wait, the oldest is dropped, and the next part says how many were.
    """

    def __init__(self, most_parts: int = MOST_PARTS) -> None:
        self._most_parts = most_parts
        self._news: deque[News] = deque()
        self._parts = 0
        self._closed = False
        self._changed = Condition()

    def put(self, news: News) -> None:
        """Never waits."""
        with self._changed:
            self._news.append(news)
            if isinstance(news, PartNews):
                self._parts += 1
                if self._parts > self._most_parts:
                    self._drop_one()
            self._changed.notify()

    def take(self) -> tuple[News, ...]:
        """All there is, in order. Never waits."""
        with self._changed:
            news = tuple(self._news)
            self._news.clear()
            self._parts = 0
            return news

    def wait(self) -> News | None:
        """The next one, as soon as there is one; None once the box is closed and empty."""
        with self._changed:
            self._changed.wait_for(lambda: self._news or self._closed)
            if not self._news:
                return None
            news = self._news.popleft()
            self._parts -= isinstance(news, PartNews)
            return news

    def close(self) -> None:
        """Nothing more will be put."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def _drop_one(self) -> None:
        places = [place for place, news in enumerate(self._news) if isinstance(news, PartNews)]
        oldest, following = self._news[places[0]], self._news[places[1]]
        assert isinstance(oldest, PartNews)
        assert isinstance(following, PartNews)
        self._news[places[1]] = replace(following, lost=following.lost + oldest.lost + 1)
        del self._news[places[0]]
        self._parts -= 1
