"""What a torque sensor must do: change, but not at once, stay within its range, and keep Newton's law."""

from math import exp, inf

from norton_bench.guard.check import NOTHING, STRIKES, Commands, GuardModel, Machine
from norton_bench.sample import Sample

REPEATS = 10  # the longest run of equal readings that was seen at rest
LEAST_REPEAT_S = 0.05
# At the end of its range a sensor repeats itself for a while, again and again. Twice the longest run at rest is such a
# while: those runs are added up, and each reading between them takes one off.
LONG_RUN = 2 / REPEATS  # of what is allowed


class FrozenTorque:
    """A torque sensor that lives shows noise: readings that stay the same bit for bit, longer than they ever did, are
    none.

    How long they do at rest is seen by the step ``tare``; of a sensor so coarse that they always do, nothing can be
    said.

    Counts equal readings in a row, of which a tick sees the last, and those of the long runs just before.
    """

    name = "frozen torque"

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        self._most = inf
        self._last_nm = 0.0
        self._equal = 0
        self._before = 0  # equal readings in long runs before this one

    def begin(self, sample: Sample) -> None:
        self._equal = self._before = 0

    def learn(self, model: GuardModel) -> None:
        habits = model.torque
        if habits is None or habits.longest_repeat is None:
            self._most = inf
        else:
            self._most = max(REPEATS * habits.longest_repeat, LEAST_REPEAT_S / max(habits.period_s, self._tick_s))

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        if not sample.torque_new:
            return None
        torque_nm = sample.torque_nm
        if torque_nm != self._last_nm:
            long = self._equal > LONG_RUN * self._most
            self._before = self._before + self._equal if long else max(self._before - 1, 0)
            self._last_nm, self._equal = torque_nm, 1
            return None
        self._equal += 1
        if self._equal + self._before <= self._most:
            return None
        before = f", after {self._before} in such rows" if self._before else ""
        return (
            f"torque sensor: gives {torque_nm:.6g} N m in {self._equal} readings in a row{before}, as no living sensor "
            "does: it is frozen or at the end of its range; switch it off and on again, and check its supply"
        )


JUMP_TIMES = 3.0  # the greatest step seen
LEAST_JUMP = 0.5  # of the limit of torque
RINGING_S = 0.02  # how long a change of the commands is remembered
# A tick may see two readings at once, and the next none. Readings further apart are no neighbours, nor are those of a
# heap that was held up on its way, and the first after it: where there was no room for more, some are missing.
LATE = 2.5  # periods
JUMP_HEAP = 2


class TorqueJump:
    """The port torque from one reading to the next: it changes by no more than was seen while the bench was shaken.

    A spike that is gone with the next readings is a glitch. A step that stays is a sensor that lost its zero, its
    amplifier or its sign, or a shaft that hit something. What the drives were told to change, the port torque may
    change by.

    ``torque_nm`` is the rig's limit. Knows from the step ``calibrate`` on how the torque can change.
    """

    name = "torque jump"

    def __init__(self, torque_nm: float, tick_s: float) -> None:
        self._least_nm = LEAST_JUMP * torque_nm
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

    def learn(self, model: GuardModel) -> None:
        habits, actuator, load = model.torque, model.actuator, model.load
        self._limit_nm = inf
        if habits is None or habits.greatest_step_nm is None or actuator is None or load is None:
            return
        self._limit_nm = max(JUMP_TIMES * habits.greatest_step_nm, self._least_nm)
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
        heap = sample.torque_count > JUMP_HEAP
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


END = 0.99  # of the range


class SaturationCheck:
    """A torque sensor at the end of its range says nothing of what lies beyond it.

    ``range_nm`` is what the sensor states; readings come with their bias taken away, its ends do not.
    """

    name = "saturation"

    def __init__(self, range_nm: float) -> None:
        self._range_nm = range_nm
        self._bias_nm = 0.0
        self._strikes = 0

    def begin(self, sample: Sample) -> None:
        self._strikes = 0

    def learn(self, model: GuardModel) -> None:
        if model.torque is not None:
            self._bias_nm = model.torque.bias_nm

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


LOW_PASS_S = 0.02
PERIODS = 20  # of torque readings: of a slow sensor the low-pass must see as many
SETTLING = 5  # low-passes: how long nothing is said after a pause
PATIENCE = 2  # low-passes: how long, taken together, a rest may be too great
MENDING = 0.3  # of the time that all is well counts against it: what swings is too great for parts of its swing only
# A rest may be so many times the friction, this share of the torques that act, and this share of the limit of torque.
# The load is the bench's own machine; an actuator is there to be found out, and may obey another law than was fitted.
FRICTION, SHARE = 1.5, 0.35
FRICTION_OF_ACTUATOR, SHARE_OF_ACTUATOR = 3.0, 0.6
# Where the load stands alone it has to tell all by itself: over whole sessions healthy benches needed no share at all.
SHARE_ALONE = 0.1
SHARE_OF_LIMIT = 0.02
OPPOSITE = 0.3  # of the one rest: another of at least this, the other way round, is the torque sensor's doing


class _Side:
    """One machine. ``sign`` is that of the port torque in its balance."""

    def __init__(self, machine: Machine, sign: int, frictions: float, share: float, least_nm: float) -> None:
        self.rest_nm = 0.0  # what nothing explains
        self.allowed_nm = 0.0
        self._machine = machine
        self._sign = sign
        self._share = share
        self._least_nm = frictions * machine.coulomb_torque_nm + machine.weight_nm + least_nm
        self._damping_nms_rad = frictions * machine.viscous_damping_nms_rad
        self._driven_nm = 0.0  # what of the commands shows in the readings
        self._torque_nm = self._size_nm = self._velocity_rad_s = 0.0  # low-passed

    def begin(self, velocity_rad_s: float) -> None:
        self._driven_nm = self._torque_nm = self._size_nm = 0.0
        self._velocity_rad_s = velocity_rad_s

    def excess_nm(self, port_nm: float, command: float, velocity_rad_s: float, gap_s: float, lag_s: float) -> float:
        """By how much the rest is more than can be; ``lag_s`` is the low-pass's time and the tick's, ``gap_s``."""
        machine, passed = self._machine, gap_s / lag_s
        # A delay for a lag of its length: they differ by the square of their phase.
        self._driven_nm += gap_s / (machine.lag_s + gap_s) * (machine.torque_gain * command - self._driven_nm)
        driven_nm = self._driven_nm
        self._torque_nm += passed * (self._sign * port_nm + driven_nm - self._torque_nm)
        self._size_nm += passed * (abs(port_nm) + abs(driven_nm) - self._size_nm)
        ahead_rad_s = velocity_rad_s - self._velocity_rad_s
        self._velocity_rad_s = slow_rad_s = self._velocity_rad_s + passed * ahead_rad_s
        inertial_nm = machine.inertia_kgm2 * ahead_rad_s / lag_s
        self.rest_nm = rest_nm = self._torque_nm - inertial_nm
        acting_nm = self._size_nm + abs(inertial_nm)
        self.allowed_nm = self._least_nm + self._damping_nms_rad * abs(slow_rad_s) + self._share * acting_nm
        return abs(rest_nm) - self.allowed_nm


class TorqueBalance:
    """Newton's law at both machines: port torque, what the drive was told to give, and how the machine speeds up.

    What the three leave of each other is friction, which is known within bounds. All of it is looked at through a
    low-pass of a fiftieth of a second, where the sensor's resonance and the noise of a differentiated velocity no
    longer matter. A command counts from when it shows in the readings: at 20 Hz, of which the low-pass leaves a
    third, 3 ms are 0.4 rad, an eighth of what swings. A torque sensor that lost its zero, its sign or its scale
    leaves opposite rests at the two machines; a drive that does not give what it is told, or a shaft that is held,
    a rest at one. Where no law of the actuator is known, the load's balance stands alone: it needs none.

    ``torque_nm`` is the rig's limit. Says nothing before the step ``calibrate`` has measured the load.
    """

    name = "balance"

    def __init__(self, torque_nm: float) -> None:
        self._least_nm = SHARE_OF_LIMIT * torque_nm
        self._low_pass_s = LOW_PASS_S
        self._old_ns = round(LOW_PASS_S * 1e9)  # readings, or a tick, as old as the low-pass are a pause
        self._load: _Side | None = None
        self._actuator: _Side | None = None
        self._tick_ns = 0
        self._settled_ns = 0  # nothing is said before
        self._ill_s = 0.0

    def begin(self, sample: Sample) -> None:
        self._tick_ns = 0

    def learn(self, model: GuardModel) -> None:
        self._load = self._actuator = None
        if model.load is not None:
            share = SHARE_ALONE if model.actuator is None else SHARE
            self._load = _Side(model.load, 1, FRICTION, share, self._least_nm)
        if model.actuator is not None:
            self._actuator = _Side(model.actuator, -1, FRICTION_OF_ACTUATOR, SHARE_OF_ACTUATOR, self._least_nm)
        if model.torque is not None:
            self._low_pass_s = max(LOW_PASS_S, PERIODS * model.torque.period_s)
            self._old_ns = round(self._low_pass_s * 1e9)

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        load, actuator = self._load, self._actuator
        if load is None:
            return None
        gap_ns, self._tick_ns = sample.tick_ns - self._tick_ns, sample.tick_ns
        if max(gap_ns, sample.torque_age_ns, sample.motion_age_ns, sample.load_motion_age_ns) > self._old_ns:
            self._settle(sample, load, actuator)
            return None
        gap_s = gap_ns * 1e-9
        lag_s = self._low_pass_s + gap_s
        port_nm = sample.torque_nm
        # Both, at every tick: each has its own memory.
        excess_nm = load.excess_nm(port_nm, sent.load_torque_nm, sample.load_velocity_rad_s, gap_s, lag_s)
        other_nm = 0.0
        if actuator is not None:
            other_nm = actuator.excess_nm(port_nm, sent.command, sample.velocity_rad_s, gap_s, lag_s)
        if excess_nm <= 0.0 and other_nm <= 0.0:
            if self._ill_s > 0.0:
                self._ill_s -= MENDING * gap_s
            return None
        if sample.tick_ns < self._settled_ns:
            return None
        self._ill_s += gap_s
        if self._ill_s <= PATIENCE * self._low_pass_s:
            return None
        return _of_both(load, actuator, other_nm > excess_nm) if actuator is not None else _of_load(load)

    def _settle(self, sample: Sample, load: _Side, actuator: _Side | None) -> None:
        load.begin(sample.load_velocity_rad_s)
        if actuator is not None:
            actuator.begin(sample.velocity_rad_s)
        self._settled_ns = sample.tick_ns + round(SETTLING * self._low_pass_s * 1e9)
        self._ill_s = 0.0


def _of_both(load: _Side, actuator: _Side, actuator_is_worse: bool) -> str:
    worse, other, name = (actuator, load, "actuator") if actuator_is_worse else (load, actuator, "load")
    if worse.rest_nm * other.rest_nm < 0 and abs(other.rest_nm) > OPPOSITE * abs(worse.rest_nm):
        suspect = "and as much, the other way round, at the other: check the torque sensor's zero, sign and scale"
    else:
        suspect = (
            f"which the other does not miss: check the {name} drive, its direction, and that its shaft turns freely"
        )
    return f"{_unexplained(worse, name)}, {suspect}"


def _of_load(load: _Side) -> str:
    return (
        f"{_unexplained(load, 'load')}: check the torque sensor's zero, sign and scale, the load drive, its direction, "
        "and that its shaft turns freely"
    )


def _unexplained(side: _Side, name: str) -> str:
    return (
        f"port torque: with the {name}'s command and motion it leaves {side.rest_nm:+.3g} N m unexplained, where "
        f"{side.allowed_nm:.2g} N m is the most that can be"
    )
