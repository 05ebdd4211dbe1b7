"""The actuator on its bench: whatever torque comes and goes at the port, a shaft that can turn gives a little.

A shaft that is held looks like an actuator without any give: within every limit, and in balance with the load. That it
has some was seen while the bench was shaken.
"""

from math import inf

from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

TIMES = 3.0  # the greatest swing of the port torque that was seen to leave the shaft where it stood
LEAST = 0.1  # of the limit of torque
# Where the load's end is held instead, the sensor's twist shows at the actuator: in so many steps of its encoder.
STEPS = 4
PATIENCE_NS = 100_000_000
FRESH_NS = 30_000_000  # an encoder that is silent does not stand still


class HeldShaft:
    """``torque_nm`` is the rig's limit, ``resolution_rad`` the actuator's encoder's.

    Knows from the step ``calibrate`` on how the shaft gives.
    """

    name = "standstill"

    def __init__(self, torque_nm: float, resolution_rad: float) -> None:
        self._least_nm = LEAST * torque_nm
        self._steps_rad = STEPS * resolution_rad
        self._swing_nm = inf
        self._position_rad = 0.0
        self._since_ns = 0  # when the encoder last moved
        self._low_nm = self._high_nm = 0.0  # the port torque since then

    def begin(self, sample: Sample) -> None:
        self._moved(sample)

    def know(self, known: Known) -> None:
        seen_nm, stiffness_nm_rad = known.still_swing_nm, known.sensor_stiffness_nm_rad
        if seen_nm is None or stiffness_nm_rad is None:
            self._swing_nm = inf
        else:
            self._swing_nm = max(TIMES * seen_nm, self._least_nm, self._steps_rad * stiffness_nm_rad)

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        # Bit for bit: what gives at all moves by a count.
        if sample.position_rad != self._position_rad or sample.motion_age_ns > FRESH_NS:
            self._moved(sample)
            return None
        torque_nm = sample.torque_nm
        if torque_nm < self._low_nm:
            self._low_nm = torque_nm
        elif torque_nm > self._high_nm:
            self._high_nm = torque_nm
        if self._high_nm - self._low_nm <= self._swing_nm or sample.tick_ns - self._since_ns <= PATIENCE_NS:
            return None
        return (
            f"actuator encoder: stands still at {sample.position_rad:.6g} rad for {PATIENCE_NS / 1e6:g} ms while the "
            f"port torque goes from {self._low_nm:.3g} to {self._high_nm:.3g} N m, where a swing of "
            f"{self._swing_nm:.2g} N m is the most that left it so before: the encoder is stuck, or the shaft is held; "
            "check both"
        )

    def _moved(self, sample: Sample) -> None:
        self._position_rad, self._since_ns = sample.position_rad, sample.tick_ns
        self._low_nm = self._high_nm = sample.torque_nm
