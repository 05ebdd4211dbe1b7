"""A torque sensor that lives shows noise: readings that stay the same bit for bit, longer than they ever did, are none.

How long they do at rest is seen by the step ``tare``; of a sensor so coarse that they always do, nothing can be said.
"""

from math import inf

from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

TIMES = 10  # the longest run of equal readings that was seen at rest
LEAST_S = 0.05


class FrozenTorque:
    """Counts equal readings in a row."""

    name = "frozen torque"

    def __init__(self) -> None:
        self._most = inf
        self._last_nm = 0.0
        self._equal = 0

    def begin(self, sample: Sample) -> None:
        self._equal = 0

    def know(self, known: Known) -> None:
        habits = known.torque
        if habits is None or habits.longest_repeat is None:
            self._most = inf
        else:
            self._most = max(TIMES * habits.longest_repeat, LEAST_S / habits.period_s)

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        if not sample.torque_new:
            return None
        torque_nm = sample.torque_nm
        if torque_nm != self._last_nm:
            self._last_nm, self._equal = torque_nm, 1
            return None
        self._equal += 1
        if self._equal <= self._most:
            return None
        return (
            f"torque sensor: gives {torque_nm:.6g} N m in {self._equal} readings in a row, as no living sensor "
            "does: it is frozen or at the end of its range; switch it off and on again, and check its supply"
        )
