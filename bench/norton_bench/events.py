"""What happens in a session, as data: the same inside a process, from process to process, and in a replay.

Whoever watches a session gives it a function that takes these events, one after the other, and returns at once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from norton_bench.errors import ExitCode
from norton_bench.identification.results import LiveEstimate
from norton_bench.models.parameter_result import ExpectationResult
from norton_bench.models.parameters import Estimate
from norton_bench.records import Measured
from norton_bench.report.words import Facts


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
class Planned:
    """The steps ahead. It comes again, with more of them, where a script goes on after the last one."""

    steps: tuple[PlannedStep, ...]


@dataclass(frozen=True)
class StepBegun:
    """Step ``index`` of the plan begins; those between it and the last one were left out."""

    index: int
    name: str


@dataclass(frozen=True)
class PartMeasured:
    """About 100 ms were measured, and this is what is known by now.

    ``dropped`` parts before it did not reach a watcher who was slow; they are in the recording.
    """

    measured: Measured
    live: LiveEstimate
    dropped: int = 0


@dataclass(frozen=True)
class Note:
    """A line for the operator."""

    text: str


@dataclass(frozen=True)
class StateChanged:
    state: SessionState


@dataclass(frozen=True)
class Question:
    """The session waits for the answer: an order "answer"."""

    prompt: Prompt


@dataclass(frozen=True)
class Ended:
    """The session is over; this is the last event, however it ended. ``failure`` is empty where it came to its end.

    Files and figures are there as far as it came. ``torque_relative`` is the rms error of the predicted torque over the
    rms of the torque, under motion and command that no fit has seen; ``velocity_relative`` the same for the free
    motion; None where nothing was validated. ``trials`` says what repeated movements came to; ``tables`` are source and
    impedance as they were tabulated; ``conditions`` whether the network can be told from its port.
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
    expectations: tuple[ExpectationResult, ...] = ()
    trials: tuple[str, ...] = ()
    tables: tuple[Facts, ...] = ()
    conditions: tuple[str, ...] = ()


SessionEvent = Planned | StepBegun | PartMeasured | Note | StateChanged | Question | Ended
Watcher = Callable[[SessionEvent], None]


def ignore(_event: SessionEvent) -> None:
    """The watcher of a session that nobody watches."""
