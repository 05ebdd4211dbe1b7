"""How far the session has come: its steps, and the time they take."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from norton_bench.session.progress import PlannedStep


@dataclass(frozen=True)
class StepState:
    """One step. ``share`` is 0 before it, 1 after it; ``took_s`` is bench time."""

    planned: PlannedStep
    state: str = "ahead"  # "ahead", "running", "done", "left out", "stopped"
    took_s: float = 0.0

    @property
    def share(self) -> float:
        """How much of it is over: never quite all as long as it runs, for durations are guesses."""
        if self.state != "running":
            return 1.0 if self.state == "done" else 0.0
        return min(self.took_s / self.planned.duration_s, 0.99) if self.planned.duration_s > 0 else 0.0

    @property
    def left_s(self) -> float:
        """Bench time it may still take."""
        if self.state == "ahead":
            return self.planned.duration_s
        return max(self.planned.duration_s - self.took_s, 0.0) if self.state == "running" else 0.0


class Steps:
    """All steps, as they follow each other."""

    def __init__(self) -> None:
        self.all: tuple[StepState, ...] = ()
        self._begun_s = 0.0

    def plan(self, steps: Sequence[PlannedStep]) -> None:
        """What is ahead; those that are there already stay as they are."""
        self.all = tuple(
            replace(self.all[index], planned=step) if index < len(self.all) else StepState(step)
            for index, step in enumerate(steps)
        )

    @property
    def running(self) -> StepState | None:
        return next((step for step in self.all if step.state == "running"), None)

    @property
    def number(self) -> int:
        """That of the step which runs or ran last, from 1; 0 before the first."""
        return max((number for number, step in enumerate(self.all, 1) if step.state != "ahead"), default=0)

    @property
    def left_s(self) -> float:
        """Bench time that all of it may still take."""
        return sum(step.left_s for step in self.all)

    def begin(self, index: int, now_s: float) -> None:
        """Step ``index`` begins; those before it are over, or were left out."""
        self.end(now_s)
        self._begun_s = now_s
        states = list(self.all)
        for number, step in enumerate(states):
            if number < index and step.state == "ahead":
                states[number] = replace(step, state="left out")
            elif number == index:
                states[number] = replace(step, state="running", took_s=0.0)
        self.all = tuple(states)

    def advance(self, now_s: float) -> None:
        """The bench's time is ``now_s``."""
        self._running_becomes("running", now_s)

    def end(self, now_s: float, *, whole: bool = True) -> None:
        """The running step is over, or was ``stopped``."""
        self._running_becomes("done" if whole else "stopped", now_s)

    def _running_becomes(self, state: str, now_s: float) -> None:
        self.all = tuple(
            replace(step, state=state, took_s=now_s - self._begun_s) if step.state == "running" else step
            for step in self.all
        )
