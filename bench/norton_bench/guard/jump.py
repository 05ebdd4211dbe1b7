"""The port torque from one reading to the next: it changes by no more than was seen while the bench was shaken.

A spike that is gone with the next readings is a glitch. A step that stays is a sensor that lost its zero, its amplifier
or its sign, or a shaft that hit something. What the drives were told to change, the port torque may change by.
"""

from math import exp, inf

from norton_bench.guard.check import STRIKES
from norton_bench.guard.commands import NOTHING, Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

TIMES = 3.0  # the greatest step seen
LEAST = 0.5  # of the limit of torque
RINGING_S = 0.02  # how long a change of the commands is remembered
# A tick may see two readings at once, and the next none. Readings further apart are no neighbours, nor are those of a
# heap that was held up on its way, and the first after it: where there was no room for more, some are missing.
LATE = 2.5  # periods
HEAP = 2


class TorqueJump:
    """``torque_nm`` is the rig's limit. Knows from the step ``calibrate`` on how the torque can change."""

    name = "torque jump"

    def __init__(self, torque_nm: float, tick_s: float) -> None:
        self._least_nm = LEAST * torque_nm
        self._limit_nm = inf
        self._kept = exp(-tick_s / RINGING_S)
        self._gain = self._load_gain = 0.0  # torque at the shaft per command
        self._sent = NOTHING
        self._told_nm = 0.0  # by how much the commands changed lately
        self._period_ns = 0.0
        self._last_nm = 0.0
        self._arrival_ns = 0
        self._heap = False  # whether the last reading was of one
        self._before_nm = 0.0  # what stood before the jump
        self._strikes = 0

    def begin(self, sample: Sample) -> None:
        self._arrival_ns = self._strikes = 0
        self._sent, self._told_nm = NOTHING, 0.0

    def know(self, known: Known) -> None:
        habits, actuator, load = known.torque, known.actuator, known.load
        self._limit_nm = inf
        if habits is None or habits.greatest_step_nm is None or actuator is None or load is None:
            return
        self._limit_nm = max(TIMES * habits.greatest_step_nm, self._least_nm)
        self._period_ns = LATE * habits.period_s * 1e9
        self._gain, self._load_gain = actuator.torque_gain, load.torque_gain

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        told_nm = abs(self._gain * (sent.command - self._sent.command))
        told_nm += abs(self._load_gain * (sent.load_torque_nm - self._sent.load_torque_nm))
        self._sent, self._told_nm = sent, max(told_nm, self._kept * self._told_nm)
        if not sample.torque_new:
            return None
        torque_nm, last_nm = sample.torque_nm, self._last_nm
        arrival_ns = sample.tick_ns - sample.torque_age_ns
        heap = sample.torque_count > HEAP
        neighbours = arrival_ns - self._arrival_ns <= self._period_ns and not (heap or self._heap)
        self._last_nm, self._arrival_ns, self._heap = torque_nm, arrival_ns, heap
        if not self._strikes:
            if neighbours and abs(torque_nm - last_nm) > self._limit_nm + self._told_nm:
                self._before_nm, self._strikes = last_nm, 1
            return None
        if abs(torque_nm - self._before_nm) < 0.5 * self._limit_nm:
            self._strikes = 0
            return None
        self._strikes += 1
        return None if self._strikes < STRIKES else self._sentence(torque_nm)

    def _sentence(self, torque_nm: float) -> str:
        return (
            f"port torque: jumped from {self._before_nm:.3g} to {torque_nm:.3g} N m between two readings and stayed "
            f"there, where a change of {self._limit_nm:.2g} N m is the most that can be: check the sensor's zero, "
            "amplifier and cable, and that the shaft hits nothing"
        )
