"""A segment while it runs: what it asks for tick by tick, and who decides the load's torque."""

from collections.abc import Iterable
from itertools import repeat
from typing import NamedTuple

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.admittance import AdmittanceController
from norton_bench.errors import RigError
from norton_bench.sample import Sample, Target
from norton_bench.segments import LoadMode, Segment

CHUNK = 128  # ticks
# Who looks ahead by less than this does not make chunks be unrolled again and again.
BACK = 64


class Step(NamedTuple):
    """What a segment asks for at one tick: commands of actuator, modulator and load, and the load's reference."""

    command: float
    modulation: float
    load_torque_nm: float
    target: Target


class Steps:
    """The steps of a segment, whose reference begins at ``base_rad``, in Python's numbers.

    An item of a list costs a tick a fifth of what an array's item costs. The arrays are unrolled in chunks as they are
    asked for: all of a segment of 20 s at once would take 20 ms where the memory is new to the process, and the loop
    would stand still for as long.
    """

    def __init__(self, segment: Segment, base_rad: float) -> None:
        self._segment, self._base_rad = segment, base_rad
        self._last = segment.ticks - 1
        self._first = self._end = 0
        self._chunk: list[Step] = []

    def at(self, index: int) -> Step:
        """The step at a tick of the segment; beyond its end the last one."""
        index = min(index, self._last)
        if not self._first <= index < self._end:
            self._unroll(index)
        return self._chunk[index - self._first]

    def _unroll(self, index: int) -> None:
        segment, first = self._segment, max(index - BACK, 0)
        part = slice(first, index + CHUNK)
        motion: Iterable[Target] = repeat(Target())
        if segment.mode is LoadMode.ADMITTANCE:
            motion = self._motion(part)
        torque = segment.load_torque_nm if segment.mode is LoadMode.TORQUE else np.empty(0)
        commands = _numbers(segment.command, part)
        self._chunk = list(map(Step, commands, _numbers(segment.modulation, part), _numbers(torque, part), motion))
        self._first, self._end = first, first + len(self._chunk)

    def _motion(self, part: slice) -> Iterable[Target]:
        segment = self._segment
        if not len(segment.position_rad):
            return repeat(Target(self._base_rad))
        return map(
            Target,
            (self._base_rad + segment.position_rad[part]).tolist(),
            _numbers(segment.velocity_rad_s, part),
            _numbers(segment.acceleration_rad_s2, part),
        )


def _numbers(values: FloatArray, part: slice) -> Iterable[float]:
    """Zeros where there are no values."""
    numbers: list[float] = np.asarray(values[part], dtype=np.float64).tolist()
    return numbers if len(values) else repeat(0.0)


class SegmentRun:
    """A segment from its first tick to its last; ``index`` is the tick that is due.

    In admittance mode the controller decides the load's torque, about a reference that begins at ``base_rad``. In other
    modes the segment does, and a controller that is there watches, so that it can take over without a bump. Raises
    RigError for a segment in admittance mode without a controller.
    """

    def __init__(self, segment: Segment, controller: AdmittanceController | None, base_rad: float) -> None:
        if segment.mode is LoadMode.ADMITTANCE and controller is None:
            raise RigError(f"{segment.procedure}: needs a calibrated load drive; run the step 'calibrate' before it")
        self.segment = segment
        self.steps = Steps(segment, base_rad)
        self.ticks = segment.ticks
        self.index = 0
        self.fast = False  # the shaft turns as fast as it takes to end the segment
        self._controller = controller
        self._lead = 0 if controller is None else controller.lead_ticks
        self._admits = segment.mode is LoadMode.ADMITTANCE
        self._begun = False

    def load_torque_nm(self, sample: Sample, step: Step) -> float:
        """The load torque wished at this tick, whose ``step`` it is."""
        controller = self._controller
        if controller is None:
            return step.load_torque_nm
        if not self._admits:
            controller.observe(sample)
            return step.load_torque_nm
        if not self._begun:
            segment, self._begun = self.segment, True
            controller.begin(sample, segment.admittance, leads=segment.preview, mends_rad_s=segment.mends_rad_s)
        ahead = self.steps.at(self.index + self._lead).target
        return controller.update(sample, step.target, ahead)

    def sent(self, load_torque_nm: float) -> None:
        """This load torque acts from now on for a tick, which may be one that was missed."""
        if self._controller is not None:
            self._controller.note_sent(load_torque_nm)

    def skip(self, ticks: int) -> None:
        """Go on so many ticks later; the last one of the segment is not skipped."""
        self.index = min(self.index + ticks, self.ticks - 1)

    @property
    def end_rad(self) -> float | None:
        """Where the reference of the last tick stood; None without a reference."""
        law = self.segment.admittance
        if not (self._admits and (law.rigid or law.has_body)):
            return None
        return self.steps.at(self.index - 1).target.position_rad

    def keeps_reference_for(self, segment: Segment) -> bool:
        """Whether the reference of the next segment begins where this one's ended, not where the load stands.

        An imposed motion may have left the load behind, and a spring may be deflected: none begins where the other
        ended. A spring that is let go keeps its place while it goes; one that comes has a new one, and so has one whose
        wall comes, goes or moves: before the wall the load may be anywhere.
        """
        before, after = self.segment.admittance, segment.admittance
        if after.has_body:
            same = before.has_body and before.wall_rad == after.wall_rad
            return same and (before.stiffness_nm_rad > 0.0 or after.stiffness_nm_rad == 0.0)
        return before.rigid or not after.rigid
