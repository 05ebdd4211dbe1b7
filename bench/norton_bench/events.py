"""What happens in a session, as data: the same inside a process, from process to process, and in a replay.

A watcher of a session is a function that takes these events, one after the other, and returns at once.
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
    """A step of the plan. ``label`` distinguishes steps of one name: the values that vary, the number of the
    repetition.

    ``certain`` is False where a condition will decide whether the step runs.
    """

    name: str
    duration_s: float  # estimated bench time; of an adaptive step: at most
    label: str = ""
    certain: bool = True


@dataclass(frozen=True)
class Prompt:
    """A question to the operator. ``choices`` are the answers allowed; empty: any text, also an empty one."""

    name: str
    text: str
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Planned:
    """The plan. It comes again, with more steps, when a script continues after the last one."""

    steps: tuple[PlannedStep, ...]


@dataclass(frozen=True)
class StepBegun:
    """Step ``index`` of the plan begins; steps between the last one and it were left out."""

    index: int
    name: str


@dataclass(frozen=True)
class PartMeasured:
    """About 100 ms of measurements, with the newest estimates.

    ``dropped`` parts before it did not reach a watcher that was slow; they are in the recording.
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
    """A prompt to the operator: the session waits for an order "answer"."""

    prompt: Prompt


@dataclass(frozen=True)
class Ended:
    """The session is over; this is the last event, however it ended. ``failure`` is empty where it came to its end.

    Files and figures are given as far as the session came. ``torque_relative`` is the rms error of the predicted torque
    over the rms of the torque, under motion and command that no fit has seen; ``velocity_relative`` the same for the
    free motion; None where nothing was validated. ``trials`` are the results of repeated movements and
    the laws that were rendered; ``tables`` are source and impedance as tabulated; ``conditions`` say whether
    measurements at the port determine the network.
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
    """A watcher that does nothing."""
