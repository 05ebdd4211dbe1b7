"""What procedures and sessions need of a loop, wherever it runs."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from norton_bench.control.calibration import LoadCalibration
from norton_bench.guard.model import EMPTY_MODEL, GuardModel
from norton_bench.loop.devices import WatchdogFinding
from norton_bench.records import Measured
from norton_bench.segments import Segment
from norton_drivers.readings import DeviceIdentity


@dataclass(frozen=True)
class Learned:
    """``guard`` is for its checks; None stands for what is not known yet, and leaves things as they are."""

    guard: GuardModel = EMPTY_MODEL
    torque_bias_nm: float | None = None
    calibration: LoadCalibration | None = None


class Runner(Protocol):
    """Runs segments on enabled drives."""

    def running(self) -> AbstractContextManager[None]:
        """Drives enabled inside, idle outside, whatever happens in between.

        Raises DeviceError, ExperimentError, and SafetyStopError where the guard has tripped and was not reset.
        """
        ...

    def run(self, segment: Segment) -> Measured:
        """Run one segment inside :meth:`running`; returns what was measured in it.

        Raises SafetyStopError, OperatorStopError, ConnectionFailedError; the drives are idle then.
        """
        ...


class BenchLoop(Runner, Protocol):
    """A loop with all that a session asks of it; everything but :meth:`run` with the drives idle."""

    def subscribe(self, consumer: Callable[[Measured], None]) -> None:
        """Give ``consumer`` all that is measured from now on, in parts, and nobody else."""
        ...

    def identify(self) -> list[DeviceIdentity]:
        """Who everybody says to be. Raises DeviceError."""
        ...

    def verify_watchdogs(self) -> tuple[WatchdogFinding, ...]:
        """See every drive's watchdog act; what is found is put away too. Nothing moves.

        Raises SafetyStopError where one does not, DeviceError where a drive cannot be enabled.
        """
        ...

    def learn(self, learned: Learned) -> None:
        """Know what the session knows. Raises ExperimentError where no controller can be made for this load."""
        ...

    def reset_guard(self, word: str) -> None:
        """Let the drives be enabled again after a trip, on an operator's ``word``, which is put away with the reason.

        Raises UsageError where nothing was said.
        """
        ...

    def tell(self, kind: str, text: str, stamp_ns: int | None = None) -> None:
        """Put an event among what is measured: of now, where ``stamp_ns`` says nothing else."""
        ...

    @property
    def now_ns(self) -> int:
        """The loop's clock."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What this system does not allow the loop, a sentence each."""
        ...

    @property
    def place(self) -> str:
        """Where it runs, in a few words, for the recording."""
        ...
