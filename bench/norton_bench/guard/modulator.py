"""The drive that sets the actuator's impedance: where its command goes, its encoder must go too.

How far is for the session to find out. One that does not follow at all leaves an impedance that nobody asked for, and
shows nowhere else: the source is where it was.
"""

from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

SHARE = 0.1  # of its greatest command: a change that must show
STEPS = 4  # of its encoder: as much is no motion
PATIENCE_NS = 100_000_000


class StuckModulator:
    """``limit`` is its greatest command, in ``unit``; ``resolution_rad`` its encoder's, 0 where unknown."""

    name = "modulator"

    def __init__(self, limit: float, unit: str, resolution_rad: float) -> None:
        self._least = SHARE * limit
        self._unit = unit
        self._steps_rad = STEPS * resolution_rad
        self._position_rad = 0.0
        self._low = self._high = 0.0  # of its command, since it last moved
        self._asked_ns = 0  # when the command had not yet changed by so much

    def begin(self, sample: Sample) -> None:
        self._moved(sample, 0.0)

    def know(self, known: Known) -> None:
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
