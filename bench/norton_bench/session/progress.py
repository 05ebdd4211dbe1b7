"""What a running session tells whoever watches it. All of it can be pickled, so it may be watched from elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

from norton_bench.errors import ExitCode
from norton_bench.identification.results import LiveEstimate
from norton_bench.models.parameters import Estimate
from norton_bench.records import Measured
from norton_bench.report.section import Facts


class SessionState(Enum):
    """Where a session is; drives may be enabled in RUNNING and PAUSING alone."""

    PREPARING = "preparing"
    RUNNING = "running"
    PAUSING = "pausing"  # a pause was ordered; the next checkpoint obeys it
    PAUSED = "paused"
    ASKING = "asking"  # a prompt waits for its answer
    CONCLUDING = "concluding"  # the drives are idle for good; the final fit runs
    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class PlannedStep:
    """A step ahead. ``label`` tells it from others of its name: what it varies, which repetition it is.

    ``certain`` is False where a condition decides, when its turn comes, whether it runs.
    """

    name: str
    duration_s: float  # about, of bench time; of an adaptive step: at most
    label: str = ""
    certain: bool = True


@dataclass(frozen=True)
class Prompt:
    """A question to the operator. ``choices`` are the answers allowed, none: any text, also an empty one."""

    name: str
    text: str
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judged:
    """Something expected of a result: whether it came true, and the sentence that says so."""

    name: str
    met: bool
    said: str


@dataclass(frozen=True)
class Summary:
    """How a session ended. Paths and estimates are there as far as it came; ``failure`` is empty where it came through.

    ``torque_relative`` is the rms error of the predicted torque over the rms of the torque, under motion and command
    that no fit has seen; ``velocity_relative`` the same for the free motion. None where nothing was validated.
    ``trials`` says what repeated movements came to; ``tables`` are source and impedance as they were tabulated;
    ``conditions`` whether the network can be told from its port.
    """

    exit_code: ExitCode
    failure: str = ""
    recording: Path | None = None
    report: Path | None = None
    network: Path | None = None
    estimates: tuple[Estimate, ...] = ()
    verdict: tuple[str, ...] = ()
    torque_relative: float | None = None
    velocity_relative: float | None = None
    expectations: tuple[Judged, ...] = ()
    trials: tuple[str, ...] = ()
    tables: tuple[Facts, ...] = ()
    conditions: tuple[str, ...] = ()


class Progress(Protocol):
    """Receives the session's news; every method must return at once."""

    def plan(self, steps: Sequence[PlannedStep]) -> None:
        """The steps ahead. It comes again, longer, where a script goes on after the last of them."""
        ...

    def step(self, index: int, name: str) -> None:
        """Step ``index`` of the plan begins; those between it and the last one were left out."""
        ...

    def part(self, measured: Measured, live: LiveEstimate) -> None:
        """About 100 ms were measured, and this is what is known by now."""
        ...

    def note(self, text: str) -> None:
        """Something worth a line."""
        ...

    def state(self, state: SessionState) -> None:
        """The session has come to ``state``."""
        ...

    def ask(self, prompt: Prompt) -> None:
        """An answer is waited for: an order "answer"."""
        ...

    def result(self, summary: Summary) -> None:
        """The session is over, and this is what came of it."""
        ...


class Silent:
    """Nobody watches."""

    def plan(self, steps: Sequence[PlannedStep]) -> None: ...
    def step(self, index: int, name: str) -> None: ...
    def part(self, measured: Measured, live: LiveEstimate) -> None: ...
    def note(self, text: str) -> None: ...
    def state(self, state: SessionState) -> None: ...
    def ask(self, prompt: Prompt) -> None: ...
    def result(self, summary: Summary) -> None: ...
