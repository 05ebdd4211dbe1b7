"""An encoder against itself: the position must go where the velocity says.

Both come in one reading, but not from one sum: drives filter the velocity, and a count that jumps, sticks or is counted
backwards shows in the position alone. What the two differ by is added up and forgotten again within a tenth of a
second, so that a velocity that is a little off, or a little late, stays within what is allowed.
"""

from operator import attrgetter

from norton_bench.guard.check import STRIKES
from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

FORGET_S = 0.1
# A velocity may be as late as this, or a fifth of it wrong.
SLACK_S = 0.02
LEAST_RAD = 0.05
STEPS = 4  # of the position's resolution
# After a longer pause nobody knows how the shaft moved meanwhile.
LONGEST_GAP_NS = 30_000_000
# Nor where readings come in a heap, and some may be missing after it: so many beyond twice what a tick usually sees.
HEAP = 2
USUAL = 0.02  # of what is new enters what is usual
_READ = {
    "actuator encoder": attrgetter("position_rad", "velocity_rad_s", "motion_age_ns", "motion_count"),
    "load encoder": attrgetter("load_position_rad", "load_velocity_rad_s", "load_motion_age_ns", "load_motion_count"),
}


class EncoderAgreement:
    """One encoder, ``"actuator encoder"`` or ``"load encoder"``."""

    name = "encoder"

    def __init__(self, which: str, resolution_rad: float) -> None:
        self._which = which
        self._read = _READ[which]
        self._least_rad = LEAST_RAD + STEPS * resolution_rad
        self._arrival_ns = 0
        self._position_rad = self._velocity_rad_s = 0.0  # of the last reading
        self._apart_rad = 0.0  # what the two differ by, as far as it is not forgotten
        self._peak_rad_s = 0.0  # the greatest speed, forgotten likewise
        self._usual = 1.0  # readings that a tick sees, where it sees any
        self._heap = False  # whether the last reading was of one
        self._strikes = 0

    def begin(self, sample: Sample) -> None:
        self._arrival_ns = 0
        self._peak_rad_s = 0.0

    def know(self, known: Known) -> None:
        """Nothing that is measured later makes it any sharper."""

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        position_rad, velocity_rad_s, age_ns, count = self._read(sample)
        if not count:
            return None
        arrival_ns = sample.tick_ns - age_ns
        gap_ns = arrival_ns - self._arrival_ns
        turned_rad = position_rad - self._position_rad
        expected_rad_s = 0.5 * (velocity_rad_s + self._velocity_rad_s)
        self._arrival_ns, self._position_rad, self._velocity_rad_s = arrival_ns, position_rad, velocity_rad_s
        heap = count > HEAP + 2 * self._usual
        self._usual += USUAL * (count - self._usual)
        bridged = 0 < gap_ns <= LONGEST_GAP_NS and not (heap or self._heap)
        self._heap = heap
        if not bridged:
            self._apart_rad, self._strikes = 0.0, 0
            return None
        gap_s = gap_ns * 1e-9
        kept = 1 - gap_s / FORGET_S
        self._apart_rad = apart_rad = kept * self._apart_rad + turned_rad - expected_rad_s * gap_s
        self._peak_rad_s = peak_rad_s = max(abs(velocity_rad_s), kept * self._peak_rad_s)
        allowed_rad = self._least_rad + peak_rad_s * (SLACK_S + gap_s)
        if -allowed_rad <= apart_rad <= allowed_rad:
            self._strikes = 0
            return None
        self._strikes += 1
        return None if self._strikes < STRIKES else self._sentence(velocity_rad_s, allowed_rad)

    def _sentence(self, velocity_rad_s: float, allowed_rad: float) -> str:
        return (
            f"{self._which}: its position is {self._apart_rad:+.3g} rad off what its velocity (now "
            f"{velocity_rad_s:.3g} rad/s) makes of the last {FORGET_S:g} s, and {allowed_rad:.2g} rad is the most that "
            "can be: the count jumped, sticks or runs backwards; check encoder, cable and mounting"
        )
