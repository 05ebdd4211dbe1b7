"""Newton's law at both machines: port torque, what the drive was told to give, and how the machine speeds up.

What the three leave of each other is friction, which is known within bounds. All of it is looked at through a low-pass
of a fiftieth of a second, where the sensor's resonance and the noise of a differentiated velocity no longer matter. A
command counts from when it shows in the readings: at 20 Hz, of which the low-pass leaves a third, 3 ms are 0.4 rad, an
eighth of what swings. A torque sensor that lost its zero, its sign or its scale leaves opposite rests at the two
machines; a drive that does not give what it is told, or a shaft that is held, a rest at one. Where no law of the
actuator is known, the load's balance stands alone: it needs none.
"""

from norton_bench.guard.commands import Commands
from norton_bench.guard.known import Known, Machine
from norton_bench.sample import Sample

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
    """``torque_nm`` is the rig's limit. Says nothing before the step ``calibrate`` has measured the load."""

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

    def know(self, known: Known) -> None:
        self._load = self._actuator = None
        if known.load is not None:
            share = SHARE_ALONE if known.actuator is None else SHARE
            self._load = _Side(known.load, 1, FRICTION, share, self._least_nm)
        if known.actuator is not None:
            self._actuator = _Side(known.actuator, -1, FRICTION_OF_ACTUATOR, SHARE_OF_ACTUATOR, self._least_nm)
        if known.torque is not None:
            self._low_pass_s = max(LOW_PASS_S, PERIODS * known.torque.period_s)
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
