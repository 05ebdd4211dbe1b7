"""What encoders must do: agree with themselves and with each other, and move under a command or a torque."""

from math import exp, inf, isinf
from operator import attrgetter

from norton_bench.guard.check import FRESH_NS, LEAST_RAD, PATIENCE_NS, STEPS, STRIKES, Commands, GuardModel
from norton_bench.sample import Sample

FORGET_S = 0.1
# A velocity may be as late as this, or a fifth of it wrong.
SLACK_S = 0.02
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
    """An encoder against itself: the position must go where the velocity says.

    Both come in one reading, but not from one sum: drives filter the velocity, and a count that jumps, sticks or is
    counted backwards shows in the position alone. What the two differ by is added up and forgotten again within a
    tenth of a second, so that a velocity that is a little off, or a little late, stays within what is allowed.

    One encoder, ``"actuator encoder"`` or ``"load encoder"``.
    """

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

    def learn(self, model: GuardModel) -> None:
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
        retained = 1 - gap_s / FORGET_S
        self._apart_rad = apart_rad = retained * self._apart_rad + turned_rad - expected_rad_s * gap_s
        self._peak_rad_s = peak_rad_s = max(abs(velocity_rad_s), retained * self._peak_rad_s)
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


SKEW_S = 3e-3  # the times of travel of the two encoders' readings may differ by this
# Once the stiffness is measured: the limit of torque may twist the shaft by so many times what it should.
TWISTS = 4.0


class CouplingCheck:
    """Two encoders on one shaft: apart from its twist, what one turns the other turns.

    A coupling that breaks or slips shows here, and an encoder that jumps, sticks or counts backwards. Positions are
    taken to the tick's instant with their velocities. What may still differ is the twist, and, at speed, what the
    two readings' times of travel differ by.

    ``twist_rad`` is the rig's limit, ``torque_nm`` the greatest torque, ``resolution_rad`` that of both encoders.
    """

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

    def learn(self, model: GuardModel) -> None:
        stiffness_nm_rad = model.sensor_stiffness_nm_rad
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


HELD_TIMES = 3.0  # the greatest swing of the port torque that was seen to leave the shaft where it stood
HELD_LEAST = 0.1  # of the limit of torque


class HeldShaft:
    """The actuator on its bench: whatever torque comes and goes at the port, a shaft that can turn gives a little.

    A shaft that is held looks like an actuator without any give: within every limit, and in balance with the load.
    That it has some was seen while the bench was shaken.

    ``torque_nm`` is the rig's limit, ``resolution_rad`` the actuator's encoder's.

    Knows from the step ``calibrate`` on how the shaft gives.
    """

    name = "standstill"

    def __init__(self, torque_nm: float, resolution_rad: float) -> None:
        self._least_nm = HELD_LEAST * torque_nm
        self._steps_rad = STEPS * resolution_rad
        self._swing_nm = inf
        self._position_rad = 0.0
        self._since_ns = 0  # when the encoder last moved
        self._low_nm = self._high_nm = 0.0  # the port torque since then

    def begin(self, sample: Sample) -> None:
        self._moved(sample)

    def learn(self, model: GuardModel) -> None:
        seen_nm, stiffness_nm_rad = model.still_swing_nm, model.sensor_stiffness_nm_rad
        if seen_nm is None or stiffness_nm_rad is None:
            self._swing_nm = inf
        else:
            self._swing_nm = max(HELD_TIMES * seen_nm, self._least_nm, self._steps_rad * stiffness_nm_rad)

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


MOVING_TIMES = 2.0  # the command at which the shaft began to turn


class Standstill:
    """One machine with its shaft free: well beyond the command at which it began to turn, it must turn.

    An encoder that is stuck on a free shaft shows nowhere else, and the velocity's limit would be blind.

    Knows from the step ``tare`` on at which command the shaft turns.
    """

    name = "standstill"

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._beyond = inf
        self._position_rad = 0.0
        self._since_ns = 0  # when position or command last did what they should

    def begin(self, sample: Sample) -> None:
        self._since_ns = sample.tick_ns

    def learn(self, model: GuardModel) -> None:
        self._beyond = inf if model.moving_command is None else MOVING_TIMES * abs(model.moving_command)

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        # Bit for bit: any encoder that lives moves by a count within the patience.
        stands = sample.position_rad == self._position_rad and sample.motion_age_ns <= FRESH_NS
        if abs(sent.command) <= self._beyond or not stands:
            self._since_ns, self._position_rad = sample.tick_ns, sample.position_rad
            return None
        if sample.tick_ns - self._since_ns <= PATIENCE_NS:
            return None
        return (
            f"actuator encoder: stands still at {sample.position_rad:.6g} rad for {PATIENCE_NS / 1e6:g} ms under "
            f"{sent.command:.3g} {self._unit}, {MOVING_TIMES:g} times what set the shaft in motion: the encoder is "
            "stuck, or the shaft is held; check both"
        )
