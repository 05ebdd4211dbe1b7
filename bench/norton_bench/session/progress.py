"""What a running session tells whoever watches it. All of it can be pickled, so it may be watched from elsewhere."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from math import inf, isfinite, nan
from pathlib import Path
from typing import Protocol

from norton_bench.errors import ExitCode, UsageError
from norton_bench.identification.results import LiveEstimate
from norton_bench.models.parameters import BY_NAME, HALF_INTERVAL, Estimate, Status
from norton_bench.records import Measured
from norton_bench.report.words import Facts
from norton_bench.rig.files import nearest
from norton_bench.units import parse_quantity


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


NUMBERS = (Status.VALID, Status.UNEXCITED)


@dataclass(frozen=True)
class Found:
    """What is known of one parameter, and sentences about whether that is what it should be.

    A parameter as far as it is known; ``value`` is NaN and ``interval`` infinite where nothing is.

    ``interval`` is half of the 95 % interval over the value, ``std`` in ``unit`` as ``value`` is.
    """

    name: str
    unit: str
    value: float = nan
    std: float = inf
    status: Status = Status.UNEXCITED

    @property
    def interval(self) -> float:
        if self.status not in NUMBERS or not isfinite(self.std) or not self.value:
            return inf
        return HALF_INTERVAL * self.std / abs(self.value)

    def __str__(self) -> str:
        if not isfinite(self.value):
            return f"{self.name} is not known ({self.status.value})"
        return f"{self.name} = {self.value:.5g} ± {HALF_INTERVAL * self.std:.2g} {self.unit} ({self.status.value})"

    def is_within(self, tolerance: str, reference: str) -> Judged:
        """Whether the value is valid, and at most ``tolerance`` ("2 %", "1 mN*m") from ``reference``.

        Raises ValueError, in a sentence, for what is no quantity of the kind.
        """
        expected = parse_quantity(reference, self.unit)
        allowed = allowed_deviation(tolerance, expected, self.unit)
        away = abs(self.value - expected)
        met = self.status is Status.VALID and away <= allowed
        off = f", but {100 * away / abs(expected):.3g} % off" if expected and away > allowed else ""
        return Judged(self.name, met, f"{self}: {'is' if met else 'is not'} within {tolerance} of {reference}{off}")

    def is_known_within(self, interval: str) -> Judged:
        """Whether it is valid and half of its 95 % interval is at most ``interval`` ("1 %") of the value.

        Raises ValueError, in a sentence, for what is no share.
        """
        met = self.status is Status.VALID and self.interval <= parse_quantity(interval, "")
        width = f"±{100 * self.interval:.2g} %" if isfinite(self.interval) else "without bounds"
        return Judged(
            self.name, met, f"{self}: its 95 % interval, {width}, {'is' if met else 'is not'} within ±{interval}"
        )


def allowed_deviation(tolerance: str, expected: float, unit: str) -> float:
    """``tolerance`` in ``unit``: a quantity of it, or a share of ``expected``. Raises ValueError, in a sentence."""
    try:
        return parse_quantity(tolerance, "") * abs(expected)
    except ValueError:
        return parse_quantity(tolerance, unit)


def found_in(estimates: tuple[Estimate, ...], name: str, command_unit: str) -> Found:
    """What ``estimates`` say of ``name``. Raises UsageError where there is no such parameter."""
    check_name(name)
    for estimate in estimates:
        if estimate.name == name:
            return Found(name, estimate.unit, float(estimate.value), float(estimate.std), estimate.status)
    return Found(name, BY_NAME[name].unit_for(command_unit))


def check_name(name: str) -> None:
    """Raises UsageError where there is no such parameter."""
    if name not in BY_NAME:
        raise UsageError(f'"{name}" is no parameter; {nearest(name, BY_NAME)}')
