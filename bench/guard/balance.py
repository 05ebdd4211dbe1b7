"""Newton's law at both machines: port torque, what the drive was told to give, and how the machine speeds up.

What the three leave of each other is friction, which is known within bounds. All of it is looked at through a low-pass
of a fiftieth of a second, where delays of a few milliseconds, the sensor's resonance and the noise of a differentiated
velocity no longer matter. A torque sensor that lost its zero, its sign or its scale leaves opposite rests at the two
machines; a drive that does not give what it is told, or a shaft that is held, a rest at one.
"""

from bench.guard.commands import Commands
from bench.guard.known import Known, Machine
from bench.sample import Sample

LOW_PASS_S = 0.02
PERIODS = 20  # of torque readings: of a slow sensor the low-pass must see as many
SETTLING = 5  # low-passes: how long nothing is said after a pause
PATIENCE = 2  # low-passes: how long, taken together, a rest may be too great
MENDING = 0.3  # of the time that all is well counts against it: what swings is too great for parts of its swing only
LONGEST_GAP_NS = 20_000_000
# A rest may be so many times the friction, this share of the torques that act, and this share of the limit of torque.
FRICTION = 1.5
SHARE = 0.35
SHARE_OF_LIMIT = 0.02
OPPOSITE = 0.3  # of the one rest: another of at least this, the other way round, is the torque sensor's doing


class _Side:
    """One machine. ``sign`` is that of the port torque in its balance."""

    def __init__(self, machine: Machine, sign: int, least_nm: float) -> None:
        self.rest_nm = 0.0  # what nothing explains
        self.allowed_nm = 0.0
        self._machine = machine
        self._sign = sign
        self._least_nm = least_nm
        self._torque_nm = self._size_nm = self._velocity_rad_s = 0.0  # low-passed

    def begin(self, velocity_rad_s: float) -> None:
        self._torque_nm = self._size_nm = 0.0
        self._velocity_rad_s = velocity_rad_s

    def excess_nm(self, port_nm: float, command: float, velocity_rad_s: float, share: float, lag_s: float) -> float:
        """By how much the rest is more than can be; ``share`` is the low-pass's, over its time and the tick's."""
        machine = self._machine
        driven_nm = machine.torque_gain * command
        self._torque_nm += share * (self._sign * port_nm + driven_nm - self._torque_nm)
        self._size_nm += share * (abs(port_nm) + abs(driven_nm) - self._size_nm)
        ahead_rad_s = velocity_rad_s - self._velocity_rad_s
        self._velocity_rad_s = slow_rad_s = self._velocity_rad_s + share * ahead_rad_s
        inertial_nm = machine.inertia_kgm2 * ahead_rad_s / lag_s
        self.rest_nm = rest_nm = self._torque_nm - inertial_nm
        friction_nm = machine.coulomb_torque_nm + machine.viscous_damping_nms_rad * abs(slow_rad_s)
        self.allowed_nm = FRICTION * friction_nm + SHARE * (self._size_nm + abs(inertial_nm)) + self._least_nm
        return abs(rest_nm) - self.allowed_nm


class TorqueBalance:
    """``torque_nm`` is the rig's limit. Says nothing before the step ``calibrate`` has measured the machines."""

    name = "balance"

    def __init__(self, torque_nm: float) -> None:
        self._least_nm = SHARE_OF_LIMIT * torque_nm
        self._low_pass_s = LOW_PASS_S
        self._load: _Side | None = None
        self._actuator: _Side | None = None
        self._tick_ns = 0
        self._settled_ns = 0  # nothing is said before
        self._ill_s = 0.0

    def begin(self, sample: Sample) -> None:
        self._tick_ns = 0

    def know(self, known: Known) -> None:
        self._load = None if known.load is None else _Side(known.load, 1, self._least_nm)
        self._actuator = None if known.actuator is None else _Side(known.actuator, -1, self._least_nm)
        if known.torque is not None:
            self._low_pass_s = max(LOW_PASS_S, PERIODS * known.torque.period_s)

    def fault(self, sample: Sample, sent: Commands) -> str | None:
        load, actuator = self._load, self._actuator
        if load is None or actuator is None:
            return None
        gap_ns, self._tick_ns = sample.tick_ns - self._tick_ns, sample.tick_ns
        if gap_ns > LONGEST_GAP_NS:
            self._settle(sample, load, actuator)
            return None
        gap_s = gap_ns * 1e-9
        lag_s = self._low_pass_s + gap_s
        share = gap_s / lag_s
        port_nm = sample.torque_nm
        # Both, at every tick: each has its own memory.
        excess_nm = load.excess_nm(port_nm, sent.load_torque_nm, sample.load_velocity_rad_s, share, lag_s)
        other_nm = actuator.excess_nm(port_nm, sent.command, sample.velocity_rad_s, share, lag_s)
        if excess_nm <= 0.0 and other_nm <= 0.0:
            if self._ill_s > 0.0:
                self._ill_s -= MENDING * gap_s
            return None
        if sample.tick_ns < self._settled_ns:
            return None
        self._ill_s += gap_s
        if self._ill_s <= PATIENCE * self._low_pass_s:
            return None
        return _sentence(load, actuator, load_is_worse=excess_nm > other_nm)

    def _settle(self, sample: Sample, load: _Side, actuator: _Side) -> None:
        load.begin(sample.load_velocity_rad_s)
        actuator.begin(sample.velocity_rad_s)
        self._settled_ns = sample.tick_ns + round(SETTLING * self._low_pass_s * 1e9)
        self._ill_s = 0.0


def _sentence(load: _Side, actuator: _Side, *, load_is_worse: bool) -> str:
    worse, other, name = (load, actuator, "load") if load_is_worse else (actuator, load, "actuator")
    if worse.rest_nm * other.rest_nm < 0 and abs(other.rest_nm) > OPPOSITE * abs(worse.rest_nm):
        suspect = "and as much, the other way round, at the other: check the torque sensor's zero, sign and scale"
    else:
        suspect = (
            f"which the other does not miss: check the {name} drive, its direction, and that its shaft turns freely"
        )
    return (
        f"port torque: with the {name}'s command and motion it leaves {worse.rest_nm:+.3g} N m unexplained, where "
        f"{worse.allowed_nm:.2g} N m is the most that can be, {suspect}"
    )
