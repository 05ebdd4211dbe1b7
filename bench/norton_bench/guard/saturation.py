"""A torque sensor at the end of its range says nothing of what lies beyond it."""

from norton_bench.guard.check import STRIKES
from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

END = 0.99  # of the range


class Saturation:
    """``range_nm`` is what the sensor states; readings come with their bias taken away, its ends do not."""

    name = "saturation"

    def __init__(self, range_nm: float) -> None:
        self._range_nm = range_nm
        self._bias_nm = 0.0
        self._strikes = 0

    def begin(self, sample: Sample) -> None:
        self._strikes = 0

    def know(self, known: Known) -> None:
        if known.torque is not None:
            self._bias_nm = known.torque.bias_nm

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        if not sample.torque_new:
            return None
        if abs(sample.torque_nm + self._bias_nm) < END * self._range_nm:
            self._strikes = 0
            return None
        self._strikes += 1
        if self._strikes < STRIKES:
            return None
        return (
            f"torque sensor: at the end of its range of {self._range_nm:g} N m for {STRIKES} readings: the torque may "
            "be any; lower the commands, or mount a sensor of a greater range"
        )
