"""Two encoders on one shaft: apart from its twist, what one turns the other turns.

A coupling that breaks or slips shows here, and an encoder that jumps, sticks or counts backwards. Positions are taken
to the tick's instant with their velocities. What may still differ is the twist, and, at speed, what the two readings'
times of travel differ by.
"""

from math import exp, isinf

from norton_bench.guard.check import STRIKES
from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known
from norton_bench.sample import Sample

SKEW_S = 3e-3  # the times of travel of the two encoders' readings may differ by this
FRESH_NS = 30_000_000  # older readings are the business of [limits] stale_after
FORGET_S = 0.1
STEPS = 4  # of either position's resolution
# Once the stiffness is measured: the limit of torque may twist the shaft by so many times what it should.
TWISTS = 4.0
LEAST_RAD = 0.05


class Coupling:
    """``twist_rad`` is the rig's limit, ``torque_nm`` the greatest torque, ``resolution_rad`` that of both encoders."""

    name = "coupling"

    def __init__(self, twist_rad: float, torque_nm: float, resolution_rad: float, tick_s: float) -> None:
        self._greatest_rad = twist_rad
        self._torque_nm = torque_nm
        self._steps_rad = STEPS * resolution_rad
        self._limit_rad = twist_rad + self._steps_rad
        self._kept = exp(-tick_s / FORGET_S)
        self._start_rad: float | None = None
        self._peak_rad_s = 0.0  # the greatest speed, slowly forgotten
        self._strikes = 0
        self._new = self._load_new = False  # whether either encoder spoke since the last strike
        self._first = (0.0, 0.0)  # both positions when it began to be wrong

    def begin(self, sample: Sample) -> None:
        self._start_rad = None
        self._strikes = 0

    def know(self, known: Known) -> None:
        stiffness_nm_rad = known.sensor_stiffness_nm_rad
        if stiffness_nm_rad is None or isinf(self._greatest_rad):
            return
        twist_rad = max(TWISTS * self._torque_nm / stiffness_nm_rad, LEAST_RAD)
        self._limit_rad = min(twist_rad, self._greatest_rad) + self._steps_rad

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        age_ns, load_age_ns = sample.motion_age_ns, sample.load_motion_age_ns
        if age_ns > FRESH_NS or load_age_ns > FRESH_NS:
            return None
        velocity_rad_s, load_velocity_rad_s = sample.velocity_rad_s, sample.load_velocity_rad_s
        self._peak_rad_s = peak_rad_s = max(
            abs(velocity_rad_s), abs(load_velocity_rad_s), self._kept * self._peak_rad_s
        )
        here_rad = sample.position_rad + velocity_rad_s * age_ns * 1e-9
        there_rad = sample.load_position_rad + load_velocity_rad_s * load_age_ns * 1e-9
        if self._start_rad is None:
            self._start_rad = here_rad - there_rad
        twist_rad = here_rad - there_rad - self._start_rad
        allowed_rad = self._limit_rad + peak_rad_s * (SKEW_S + 2e-9 * (age_ns + load_age_ns))
        if -allowed_rad <= twist_rad <= allowed_rad:
            self._strikes = 0
            return None
        return self._strike(sample, twist_rad, allowed_rad)

    def _strike(self, sample: Sample, twist_rad: float, allowed_rad: float) -> str | None:
        if self._strikes == 0:
            self._strikes, self._new, self._load_new = 1, False, False
            self._first = sample.position_rad, sample.load_position_rad
            return None
        self._new, self._load_new = self._new or sample.motion_new, self._load_new or sample.load_motion_new
        if self._new and self._load_new:
            self._strikes, self._new, self._load_new = self._strikes + 1, False, False
        if self._strikes < STRIKES:
            return None
        turned_rad = sample.position_rad - self._first[0]
        load_turned_rad = sample.load_position_rad - self._first[1]
        return (
            f"coupling: actuator and load have turned {twist_rad:+.3g} rad apart, where {allowed_rad:.2g} rad is the "
            f"most that can be ([limits] twist, and what comes with speed): {_suspicion(turned_rad, load_turned_rad)}"
        )


def _suspicion(turned_rad: float, load_turned_rad: float) -> str:
    if turned_rad == 0.0 != load_turned_rad:
        return "the actuator's encoder stands still while the load's turns; check it, its cable, and the coupling"
    if load_turned_rad == 0.0 != turned_rad:
        return "the load's encoder stands still while the actuator's turns; check it, its cable, and the coupling"
    if turned_rad * load_turned_rad < 0:
        return "they turn opposite ways; check the coupling, both encoders, and [load] direction in the rig file"
    return "the coupling broke or slips, or an encoder jumped; check all three"
