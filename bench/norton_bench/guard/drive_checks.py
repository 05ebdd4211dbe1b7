"""What a drive must do: give the current that was asked for, and move what it drives."""

from operator import attrgetter

from norton_bench.guard.check import PATIENCE_NS, STEPS, STRIKES, Commands, GuardModel
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
    """A drive's measured current against its command: never much more than was asked for, never against it.

    Less is no alarm: a drive that reaches its supply's voltage gives less. The current lags, and is told late: it
    is held against all that was commanded within the last tenth of a second. What a command should give is known
    from the first tick where it is a current itself, else from the step ``tare`` on.

    One drive, ``"actuator"`` or ``"load"``; ``greatest`` is its greatest command, ``unit`` that command's unit.
    """

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

    def learn(self, model: GuardModel) -> None:
        self._amperes = _AMPERES[self._which](model) or self._amperes

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


SHARE_THAT_MOVES = 0.1  # of its greatest command: a change that must show


class StuckModulator:
    """The drive that sets the actuator's impedance: where its command goes, its encoder must go too.

    How far is for the session to find out. One that does not follow at all leaves an impedance that nobody asked
    for, and shows nowhere else: the source is where it was.

    ``limit`` is its greatest command, in ``unit``; ``resolution_rad`` its encoder's, 0 where unknown.
    """

    name = "modulator"

    def __init__(self, limit: float, unit: str, resolution_rad: float) -> None:
        self._least = SHARE_THAT_MOVES * limit
        self._unit = unit
        self._steps_rad = STEPS * resolution_rad
        self._position_rad = 0.0
        self._low = self._high = 0.0  # of its command, since it last moved
        self._asked_ns = 0  # when the command had not yet changed by so much

    def begin(self, sample: Sample) -> None:
        self._moved(sample, 0.0)

    def learn(self, model: GuardModel) -> None:
        """Nothing that is measured later makes it any sharper."""

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        modulation = sent.modulation
        if abs(sample.modulator_position_rad - self._position_rad) > self._steps_rad:
            self._moved(sample, modulation)
            return None
        if modulation < self._low:
            self._low = modulation
        elif modulation > self._high:
            self._high = modulation
        if self._high - self._low <= self._least:
            self._asked_ns = sample.tick_ns
            return None
        if sample.tick_ns - self._asked_ns <= PATIENCE_NS:
            return None
        return (
            f"modulator encoder: stands still at {sample.modulator_position_rad:.6g} rad, though "
            f"{PATIENCE_NS / 1e6:g} ms ago its command had gone from {self._low:.3g} to {self._high:.3g} {self._unit}: "
            "it is stuck or at a stop, or its encoder is; check both, and [modulator.command] limit"
        )

    def _moved(self, sample: Sample, modulation: float) -> None:
        self._position_rad, self._asked_ns = sample.modulator_position_rad, sample.tick_ns
        self._low = self._high = modulation
