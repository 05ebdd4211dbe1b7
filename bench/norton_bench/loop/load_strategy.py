"""What the load drive does in a segment: coast, follow a torque, or obey the admittance law."""

from dataclasses import dataclass
from typing import Protocol

from norton_bench.control.admittance import AdmittanceController
from norton_bench.errors import RigError
from norton_bench.loop.unrolled import Unrolled
from norton_bench.sample import Sample, Target
from norton_bench.segments import LoadMode, Segment

AT_REST = Target()


class LoadStrategy(Protocol):
    """Asked once a tick; told what was really sent."""

    def begin(self, sample: Sample) -> None: ...
    def wish(self, sample: Sample, index: int) -> float:
        """The load torque [N m] wished at tick ``index`` of the segment."""
        ...

    def note_sent(self, load_torque_nm: float) -> None: ...
    def target(self, index: int) -> Target: ...


@dataclass
class OpenLoop:
    """The segment's torque as it stands, or none. A controller that is there watches, so as to take over smoothly."""

    segment: Segment
    controller: AdmittanceController | None

    def begin(self, sample: Sample) -> None:
        """Nothing to prepare."""

    def wish(self, sample: Sample, index: int) -> float:
        if self.controller is not None:
            self.controller.observe(sample)
        return float(self.segment.load_torque_nm[index]) if self.segment.mode is LoadMode.TORQUE else 0.0

    def note_sent(self, load_torque_nm: float) -> None:
        if self.controller is not None:
            self.controller.note_sent(load_torque_nm)

    def target(self, index: int) -> Target:
        return AT_REST


@dataclass
class Imposed:
    """The admittance law about the segment's reference; ``base_rad`` is where that reference begins."""

    segment: Segment
    controller: AdmittanceController
    base_rad: float

    def __post_init__(self) -> None:
        self._position_rad = Unrolled(self.base_rad + self.segment.position_rad)
        self._velocity_rad_s = Unrolled(self.segment.velocity_rad_s)
        self._acceleration_rad_s2 = Unrolled(self.segment.acceleration_rad_s2)
        self._last = len(self._position_rad) - 1
        self._lead_ticks = self.controller.lead_ticks
        self._now = self._made(0)
        self._now_index = 0

    def begin(self, sample: Sample) -> None:
        segment = self.segment
        self.controller.begin(sample, segment.admittance, leads=segment.preview, mends_rad_s=segment.mends_rad_s)

    def wish(self, sample: Sample, index: int) -> float:
        return self.controller.update(sample, self.target(index), self._made(index + self._lead_ticks))

    def note_sent(self, load_torque_nm: float) -> None:
        self.controller.note_sent(load_torque_nm)

    def target(self, index: int) -> Target:
        # Asked for twice a tick.
        if index != self._now_index:
            self._now, self._now_index = self._made(index), index
        return self._now

    def _made(self, index: int) -> Target:
        if self._last < 0:
            return Target(self.base_rad)
        at = min(index, self._last)
        return Target(self._position_rad[at], self._velocity_rad_s[at], self._acceleration_rad_s2[at])


def strategy_for(segment: Segment, controller: AdmittanceController | None, base_rad: float) -> LoadStrategy:
    """Raises RigError for an admittance segment without a calibrated load."""
    if segment.mode is not LoadMode.ADMITTANCE:
        return OpenLoop(segment, controller)
    if controller is None:
        raise RigError(f"{segment.procedure}: needs a calibrated load drive; run the step 'calibrate' before it")
    return Imposed(segment, controller, base_rad)
