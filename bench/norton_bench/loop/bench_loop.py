"""What procedures and sessions need of a loop, wherever it runs."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from norton_bench.control.calibration import LoadCalibration
from norton_bench.guard.check import EMPTY_MODEL, GuardModel
from norton_bench.loop.devices import WatchdogFinding
from norton_bench.records import Measured
from norton_bench.segments import Segment
from norton_drivers.readings import DeviceIdentity


@dataclass(frozen=True)
class Learned:
    """Results of the session that the loop uses: ``guard`` in the guard's checks, the others in control.

    None stands for a result that is not there yet; the loop then keeps the one before.
    """

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
        """Give all that is measured from now on, in parts, to ``consumer`` instead of the one before."""
        ...

    def identify(self) -> list[DeviceIdentity]:
        """The identity of every device, as it states it. Raises DeviceError."""
        ...

    def verify_watchdogs(self) -> tuple[WatchdogFinding, ...]:
        """Test every drive's watchdog, and record the results. Nothing moves.

        Raises SafetyStopError where one does not, DeviceError where a drive cannot be enabled.
        """
        ...

    def learn(self, learned: Learned) -> None:
        """Use these results from now on. Raises ExperimentError where no controller can be made for this load."""
        ...

    def reset_guard(self, word: str) -> None:
        """Allow the drives to be enabled again after a trip; the operator's ``word`` is recorded with its reason.

        Raises UsageError where ``word`` is empty.
        """
        ...

    def tell(self, kind: str, text: str, stamp_ns: int | None = None) -> None:
        """Record an event, with the stamp ``stamp_ns`` or that of now."""
        ...

    @property
    def now_ns(self) -> int:
        """The loop's clock."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """The rights that this system does not give the loop, a sentence each."""
        ...

    @property
    def place(self) -> str:
        """Where it runs, in a few words, for the recording."""
        ...
