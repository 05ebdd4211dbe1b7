"""The one table of derived figures: each a function of the motor's parameters (paper, section IV.D).

From it follow the data sheet, its JSON, its comparison, its proof, and what the report shows of it. Intervals are those
of the parameters, which are drawn from their covariance and carried through the function (Joint Committee for Guides
in Metrology, Guide 101:2008, "Propagation of distributions using a Monte Carlo method"): a ratio's interval then lies
unevenly about it, as it should.

The formulas are those of the plain motor. A network's terms are in the figures as well: τc is then the friction at the
velocity of which a figure speaks (at rest for breakaway, stall and holding), and so are Km·Ka·c and B. What changes
with the position, or with the direction, is taken at its mean.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite, log

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.models.drawn_motor import Motor, drawn, estimate_of, over
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import MOTOR_PARAMETERS, Status
from norton_bench.models.sliding import BISECTIONS

Interval = tuple[float, float]

TAIL = 0.025
# A slow cycle of torque for the lost motion: to half of what would make the contact slide.
CYCLED_SHARE = 0.5
# Velocities among which the one of greatest power is looked for, as shares of the greatest: to a hundredth of it.
SHARES = np.linspace(0.01, 1.0, 100)
RISE = log(9.0)  # time constants of a first-order lag from 10 to 90 %
# The worse comes later: a figure is as good as the worst parameter that it is made of.
WORSE = (
    Status.VALID,
    Status.LEARNING,
    Status.RATIO_ONLY,
    Status.INADEQUATE,
    Status.AT_BOUND,
    Status.DOUBTFUL,
    Status.NOT_CONVERGED,
    Status.UNEXCITED,
)


@dataclass(frozen=True)
class OperatingPoint:
    """How far a figure goes: magnitudes of command [its unit] and velocity [rad/s]; ``name`` says whose they are."""

    name: str
    command: float
    velocity_rad_s: float = inf


@dataclass(frozen=True)
class Derived:
    """A row of the table. ``unit`` may hold ``{command}``; ``needs`` are parameters by name.

    ``of`` gives the figure for every draw; what has no value there is infinite. ``at_command`` says that it depends on
    the operating point, ``velocity`` which velocity it speaks of. ``absolute``: it needs a torque scale.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    formula: str
    needs: tuple[str, ...]
    of: Callable[[Motor, OperatingPoint], FloatArray]
    at_command: bool = False
    absolute: bool = True
    velocity: Callable[[Motor, OperatingPoint], FloatArray] | None = None


@dataclass(frozen=True)
class Figure:
    """A derived figure of one network. ``draws`` (DRAWS,) are what its interval of 95 % comes from.

    ``status`` is that of the worst parameter in it, None where the network alone is known. ``extrapolated``: it lies
    where the network was not seen to hold.
    """

    row: Derived
    unit: str
    value: float
    draws: FloatArray
    status: Status | None = None
    at: OperatingPoint | None = None
    extrapolated: bool = False

    @property
    def key(self) -> str:
        """The row's name, and whose operating point it is where it has one."""
        return self.row.name if self.at is None else f"{self.row.name} ({self.at.name})"

    @property
    def words(self) -> str:
        """The row's name in words."""
        return self.row.name.replace("_", " ")

    @property
    def interval(self) -> Interval:
        return interval_of(self.draws)

    @property
    def shown(self) -> float:
        """NaN for what the data say nothing of."""
        return float("nan") if self.status is Status.UNEXCITED else self.value

    @property
    def settled(self) -> bool:
        """Whether the interval may be believed."""
        return self.status in (None, Status.VALID, Status.LEARNING)


def no_load_rad_s(motor: Motor, at: OperatingPoint) -> FloatArray:
    """Steady free velocity: the motion source (section IV.D)."""
    beyond = motor.beyond_friction_nm(at.command)
    straight = over(beyond, motor.damping_nms_rad)
    if not {"stribeck_torque", "quadratic_drag"} & set(motor.terms):
        return straight
    # Resistance is at least the damping's, so the motor's whole torque over that is too fast.
    drive = motor.drive_nm(at.command)
    low, high = np.zeros_like(drive), over(drive, motor.damping_nms_rad)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        with np.errstate(invalid="ignore"):
            slower = motor.resistance_nm(middle) < drive
        low, high = np.where(slower, middle, low), np.where(slower, high, middle)
    return np.where(np.isinf(straight), inf, np.where(beyond > 0.0, low, 0.0))


def strongest_rad_s(motor: Motor, at: OperatingPoint) -> FloatArray:
    """The velocity of greatest power at the port, half of that without load, or the greatest that is allowed."""
    free = no_load_rad_s(motor, at)
    if not {"stribeck_torque", "quadratic_drag"} & set(motor.terms):
        return np.minimum(0.5 * free, at.velocity_rad_s)
    reach = np.minimum(free, at.velocity_rad_s)
    best, most = np.zeros_like(reach), np.full(reach.shape, -inf)
    for share in SHARES:
        power = torque_at(motor, at.command, share * reach) * share * reach
        best, most = np.where(power > most, share * reach, best), np.maximum(power, most)
    return best


def torque_at(motor: Motor, command: float, velocity_rad_s: FloatArray | float) -> FloatArray:
    """Steady torque at the port while the shaft turns as the command drives it, at a velocity above 0."""
    left = motor.drive_nm(command) - motor.resistance_nm(velocity_rad_s)
    return left / (1.0 + motor.load_friction * np.sign(left))


def backdriving_nm(motor: Motor, velocity_rad_s: FloatArray | float) -> FloatArray:
    """Torque that turns the shaft steadily from outside, without a command."""
    return over(motor.resistance_nm(velocity_rad_s), 1.0 - motor.load_friction)


def _power_w(motor: Motor, at: OperatingPoint) -> FloatArray:
    velocity_rad_s = strongest_rad_s(motor, at)
    return np.where(velocity_rad_s > 0.0, torque_at(motor, at.command, velocity_rad_s) * velocity_rad_s, 0.0)


def _efficiency(motor: Motor, at: OperatingPoint) -> FloatArray:
    velocity_rad_s = strongest_rad_s(motor, at)
    moving = np.isfinite(velocity_rad_s) & (velocity_rad_s > 0.0)
    useful = torque_at(motor, at.command, np.where(moving, velocity_rad_s, 0.0))
    return np.where(moving, over(useful, motor.drive_nm(at.command)), 0.0)


def presliding_rad(motor: Motor) -> FloatArray:
    """The deflection at which the contact slides."""
    return over(motor.held_nm, motor.stiffness_nm_rad)


def _lost_motion_rad(motor: Motor) -> FloatArray:
    """Dahl's dF/dx = σ0 (1 − (F/τc) sgn v), integrated up and down between ± q·τc: the branches' distance at F = 0."""
    return -log(1.0 - CYCLED_SHARE**2) * presliding_rad(motor)


def _contact_rad_s(motor: Motor) -> FloatArray:
    return np.sqrt(np.maximum(over(motor.stiffness_nm_rad, motor.inertia_kgm2), 0.0))


def _contact_ratio(motor: Motor) -> FloatArray:
    critical = 2.0 * np.sqrt(np.maximum(motor.stiffness_nm_rad * motor.inertia_kgm2, 0.0))
    return over(motor.damping_nms_rad + motor.contact_damping_nms_rad, critical)


GAIN, BANDWIDTH, INERTIA, DAMPING, COULOMB, STIFFNESS, CONTACT = (each.name for each in MOTOR_PARAMETERS)
DERIVED = (
    Derived(
        "stall_torque", "τs", "N*m",
        "torque at the blocked port, where the shaft came to rest while it turned as commanded",
        "Km·Ka·c − τc", (GAIN, COULOMB),
        lambda motor, at: motor.beyond_friction_nm(at.command) / (1.0 + motor.load_friction), at_command=True,
    ),
    Derived(
        "holding_torque", "τh", "N*m", "torque that turns the shaft back against the command",
        "Km·Ka·c + τc", (GAIN, COULOMB),
        lambda motor, at: over(motor.drive_nm(at.command) + motor.held_nm, 1.0 - motor.load_friction), at_command=True,
    ),
    Derived(
        "no_load_speed", "ω0", "rad/s", "steady velocity with nothing at the port", "(Km·Ka·c − τc)/B",
        (GAIN, COULOMB, DAMPING), no_load_rad_s, at_command=True, absolute=False, velocity=no_load_rad_s,
    ),
    Derived(
        "greatest_power", "P", "W", "greatest steady power at the port", "(Km·Ka·c − τc − B·ω)·ω, ω = ω0/2 at most",
        (GAIN, COULOMB, DAMPING), _power_w, at_command=True, velocity=strongest_rad_s,
    ),
    Derived(
        "mechanical_efficiency", "η", "", "that power over the power of the motor's torque: friction's losses alone",
        "1 − (τc + B·ω)/(Km·Ka·c)", (GAIN, COULOMB, DAMPING), _efficiency, at_command=True, absolute=False,
        velocity=strongest_rad_s,
    ),
    Derived(
        "free_speed_per_command", "kω", "rad/s/({command})", "slope of the steady free velocity beyond breakaway",
        "Km·Ka/B", (GAIN, DAMPING), lambda motor, _: over(motor.gain, motor.damping_nms_rad), absolute=False,
    ),
    Derived(
        "starting_acceleration", "α", "rad/s^2", "acceleration of the free shaft as it starts to slide",
        "(Km·Ka·c − τc)/Im", (GAIN, COULOMB, INERTIA),
        lambda motor, at: over(motor.beyond_friction_nm(at.command), motor.inertia_kgm2), at_command=True,
        absolute=False,
    ),
    Derived(
        "backdriving_torque", "τb", "N*m", "torque that turns the shaft from outside, without a command",
        "τc + B·ω", (COULOMB, DAMPING), lambda motor, at: backdriving_nm(motor, at.velocity_rad_s), at_command=True,
        velocity=lambda motor, at: np.full(motor.gain.shape, at.velocity_rad_s),
    ),
    Derived(
        "breakaway_torque", "τ0", "N*m", "torque that makes the shaft slide from outside, without a command", "τc",
        (COULOMB,),
        lambda motor, _: over(motor.held_nm, 1.0 - motor.load_friction),
    ),
    Derived(
        "breakaway_command", "c0", "{command}", "command at which the free shaft begins to slide", "τc/(Km·Ka)",
        (GAIN, COULOMB), lambda motor, _: motor.command_for(motor.held_nm), absolute=False,
    ),
    Derived(
        "hysteresis", "Δτ", "N*m", "of the torque at one position, approached slowly from either side", "2·τc",
        (COULOMB,), lambda motor, _: 2.0 * motor.held_nm,
    ),
    Derived(
        "presliding_displacement", "x0", "rad", "deflection of the friction contact as it slides", "τc/σ0",
        (COULOMB, STIFFNESS), lambda motor, _: presliding_rad(motor), absolute=False,
    ),
    Derived(
        "lost_motion", "Δx", "rad", "at zero torque, after slow torques of ± τc/2 at the port", "ln(4/3)·τc/σ0",
        (COULOMB, STIFFNESS), lambda motor, _: _lost_motion_rad(motor), absolute=False,
    ),
    Derived(
        "contact_resonance", "f0", "Hz", "natural frequency of the free rotor on its friction contact",
        "√(σ0/Im)/2π", (STIFFNESS, INERTIA), lambda motor, _: _contact_rad_s(motor) / (2 * np.pi), absolute=False,
    ),
    Derived(
        "contact_damping_ratio", "ζ", "", "damping ratio of that resonance", "(σ1 + B)/(2·√(σ0·Im))",
        (STIFFNESS, INERTIA, DAMPING, CONTACT), lambda motor, _: _contact_ratio(motor), absolute=False,
    ),
    Derived(
        "mechanical_time_constant", "Tm", "s", "of the free shaft's velocity once it slides", "Im/B",
        (INERTIA, DAMPING), lambda motor, _: over(motor.inertia_kgm2, motor.damping_nms_rad), absolute=False,
    ),
    Derived(
        "torque_bandwidth", "fβ", "Hz", "where the motor's torque is down by 3 dB", "β/2π", (BANDWIDTH,),
        lambda motor, _: motor.bandwidth_rad_s / (2 * np.pi), absolute=False,
    ),
    Derived(
        "torque_rise_time", "tr", "s", "of the motor's torque, from 10 to 90 % of a step", "ln(9)/β", (BANDWIDTH,),
        lambda motor, _: over(np.full(motor.gain.shape, RISE), motor.bandwidth_rad_s), absolute=False,
    ),
)  # fmt: skip


def derived(
    network: NortonNetwork,
    points: tuple[OperatingPoint, ...],
    *,
    statuses: dict[str, Status] | None = None,
    seed: int = 1,
) -> tuple[Figure, ...]:
    """Every figure that the network has, those that depend on the command at each of ``points``.

    ``statuses`` are of the parameters, by name. Figures that need a torque scale are left out where there is none.
    """
    value, draws = estimate_of(network), drawn(network, seed)
    scaled = "scale" not in network.provenance
    anywhere = OperatingPoint("", 0.0)
    return tuple(
        Figure(
            row,
            row.unit.replace("{command}", network.command_unit),
            float(row.of(value, at)[0]),
            row.of(draws, at),
            _status(row, statuses),
            at if row.at_command else None,
            row.at_command and _beyond(network, row, value, at),
        )
        for row in DERIVED
        if scaled or not row.absolute
        for at in (points if row.at_command else (anywhere,))
        if isfinite(float(row.of(value, at)[0]))
    )


def interval_of(draws: FloatArray, tail: float = TAIL) -> Interval:
    """Of 95 %, or with ``tail`` on either side; an end is infinite where the draws do not tell it."""
    low, high = np.quantile(draws, tail, method="lower"), np.quantile(draws, 1.0 - tail, method="higher")
    return float(low), float(high)


def seen_to(network: NortonNetwork, name: str) -> float:
    """The greatest magnitude of "command" or "velocity" that the network was seen to hold with; NaN if not known."""
    span = None if network.prediction is None else network.prediction.ranges.get(name)
    return float("nan") if span is None else max(abs(span[0]), abs(span[1]))


def _status(row: Derived, statuses: dict[str, Status] | None) -> Status | None:
    """Of the worst parameter. What needs no torque scale is as good where all of them lack the same factor."""
    if statuses is None:
        return None
    worst = max((statuses[name] for name in row.needs if name in statuses), key=WORSE.index, default=None)
    return Status.VALID if worst is Status.RATIO_ONLY and not row.absolute else worst


def _beyond(network: NortonNetwork, row: Derived, value: Motor, at: OperatingPoint) -> bool:
    """Whether command or velocity lie outside what the network was seen with. What is not known is not within."""
    velocity_rad_s = 0.0 if row.velocity is None else float(row.velocity(value, at)[0])
    commanded = GAIN in row.needs and not at.command <= seen_to(network, "command")
    return commanded or not (velocity_rad_s <= seen_to(network, "velocity") or velocity_rad_s == 0.0)
