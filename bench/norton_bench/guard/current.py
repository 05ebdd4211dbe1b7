"""A drive's measured current against its command: never much more than was asked for, never against it.

Less is no alarm: a drive that reaches its supply's voltage gives less. The current lags, and is told late: it is held
against all that was commanded within the last tenth of a second. What a command should give is known from the first
tick where it is a current itself, else from the step ``tare`` on.
"""

from operator import attrgetter

from norton_bench.guard.check import STRIKES
from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

# Commands are remembered for one to two of these.
WINDOW_NS = 50_000_000
# Beyond what was commanded: this share of it, and this share of the greatest command.
SHARE = 0.3
SHARE_OF_GREATEST = 0.1
_READ = {
    "actuator": attrgetter("current_a", "current_new"),
    "load": attrgetter("load_current_a", "load_current_new"),
}
_COMMAND = {"actuator": attrgetter("command"), "load": attrgetter("load_torque_nm")}
_AMPERES = {"actuator": attrgetter("amperes_per_command"), "load": attrgetter("load_amperes_per_nm")}


class CurrentAgreement:
    """One drive, ``"actuator"`` or ``"load"``; ``greatest`` is its greatest command, ``unit`` that command's unit."""

    name = "current"

    def __init__(self, which: str, greatest: float, unit: str, amperes_per_command: float | None = None) -> None:
        self._which = which
        self._unit = unit
        self._read, self._command = _READ[which], _COMMAND[which]
        self._margin = SHARE_OF_GREATEST * greatest
        self._amperes = amperes_per_command
        self._low = self._high = self._low_before = self._high_before = 0.0
        self._window_ns = 0
        self._strikes = 0

    def begin(self, sample: Sample) -> None:
        self._low = self._high = self._low_before = self._high_before = 0.0
        self._strikes = 0

    def know(self, known: Known) -> None:
        self._amperes = _AMPERES[self._which](known) or self._amperes

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        command = self._command(sent)
        if sample.tick_ns - self._window_ns > WINDOW_NS:
            self._window_ns = sample.tick_ns
            self._low_before, self._high_before = self._low, self._high
            self._low = self._high = command
        elif command > self._high:
            self._high = command
        elif command < self._low:
            self._low = command
        current_a, is_new = self._read(sample)
        if not is_new or self._amperes is None:
            return None
        # Both as commands, so that the sign of the amperes does not matter.
        acted = current_a / self._amperes
        low, high = min(self._low, self._low_before), max(self._high, self._high_before)
        beyond = max(acted - high, low - acted)
        if beyond <= SHARE * max(high, -low) + self._margin:
            self._strikes = 0
            return None
        self._strikes += 1
        return None if self._strikes < STRIKES else self._sentence(current_a, low, high)

    def _sentence(self, current_a: float, low: float, high: float) -> str:
        assert self._amperes is not None
        asked_a = sorted((low * self._amperes, high * self._amperes))
        return (
            f"{self._which} drive: its current is {current_a:.3g} A, though all commands of the last tenth of a second "
            f"({low:.3g} to {high:.3g} {self._unit}) ask for {asked_a[0]:.3g} to {asked_a[1]:.3g} A: it follows "
            "something else, or reports a wrong current; check the drive's control mode, who else is on the bus, and "
            "its current sensing"
        )
