"""A motor in steady sliding, and the same motor drawn many times as its covariance has it, for derived figures.

The functions take a network with its signs and directions. :class:`Motor` has many draws at once, and means over both
directions and over a turn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, inf

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.models.network import PARAMETER_OF_FIELD, REQUIRED, NortonNetwork
from norton_bench.models.terms import ASYMMETRY, DRAG, LOAD, SATURATION, STRIBECK, STRIBECK_VELOCITY, waves_of

SPEEDS = 1001
BISECTIONS = 60  # halve an interval to the last digit of a number
SHOWN = 3.0


def drive_nm(network: NortonNetwork, command: npt.ArrayLike) -> FloatArray:
    """Torque of the motor itself [N m] under steady commands, of their shape: Km·Ka·c/(1 + κ·c²)."""
    asked = np.asarray(command, dtype=float)
    return np.asarray(network.torque_gain * asked / (1.0 + network.row[SATURATION] * asked**2))


def friction_nm(network: NortonNetwork, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Friction [N m] in steady sliding at velocities, of their shape; 0 at 0, where friction is any."""
    velocity, row = np.asarray(velocity_rad_s, dtype=float), network.row
    side = np.sign(velocity)
    strength = 1.0 + side * row[ASYMMETRY] + row[STRIBECK] * np.exp(-((velocity / row[STRIBECK_VELOCITY]) ** 2))
    return np.asarray(network.coulomb_torque_nm * strength * side)


def damping_nm(network: NortonNetwork, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Damping [N m] at velocities, of their shape."""
    velocity = np.asarray(velocity_rad_s, dtype=float)
    return np.asarray(network.viscous_damping_nms_rad * (1.0 + network.row[DRAG] * np.abs(velocity)) * velocity)


def resistance_nm(network: NortonNetwork, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Friction and damping [N m] in steady sliding at velocities, of their shape."""
    return friction_nm(network, velocity_rad_s) + damping_nm(network, velocity_rad_s)


def port_torque_nm(network: NortonNetwork, command: npt.ArrayLike, velocity_rad_s: npt.ArrayLike) -> FloatArray:
    """Torque at the port [N m] in steady sliding: τ = drive − resistance − μ·|τ|·sgn ω."""
    free = drive_nm(network, command) - resistance_nm(network, velocity_rad_s)
    load = network.coulomb_torque_nm * network.row[LOAD]
    # Solved for τ, which has the sign of ``free`` as long as μ is below 1.
    return np.asarray(free / (1.0 + load * np.sign(velocity_rad_s) * np.sign(free)))


def held_nm(network: NortonNetwork, side: float) -> float:
    """The friction [N m] that sliding towards ``side`` (±1) begins at, with no torque at the port."""
    row = network.row
    return float(network.coulomb_torque_nm * (1.0 + row[STRIBECK] + side * row[ASYMMETRY]))


def thresholds(network: NortonNetwork) -> tuple[float, float]:
    """The commands, lower and upper, that set a shaft at rest in motion; infinite where saturation never lets them."""
    lower, upper = (_breakaway(network, side) for side in (-1.0, 1.0))
    return lower, upper


def _breakaway(network: NortonNetwork, side: float) -> float:
    held = held_nm(network, side if network.torque_gain > 0.0 else -side)
    return float(side * command_for(held / abs(network.torque_gain), network.row[SATURATION]))


def command_for(ratio: npt.ArrayLike, saturation: npt.ArrayLike) -> FloatArray:
    """The smaller root c of ratio = c/(1 + κ·c²), of their shape; infinite where there is none."""
    asked = np.asarray(ratio, dtype=float)
    root = 1.0 - 4.0 * np.asarray(saturation) * asked**2
    return np.where(root < 0.0, inf, 2.0 * asked / (1.0 + np.sqrt(np.maximum(root, 0.0))))


def source_velocity(network: NortonNetwork, command: npt.ArrayLike) -> FloatArray:
    """As NortonNetwork.source_velocity."""
    row, torque = network.row, drive_nm(network, command)
    if network.servo is not None:
        return np.zeros_like(torque)
    side, size = np.sign(torque), np.abs(torque)
    beyond = np.maximum(size - network.coulomb_torque_nm * (1.0 + row[STRIBECK] + side * row[ASYMMETRY]), 0.0)
    if not (row[STRIBECK] or row[DRAG]):
        return np.asarray(side * beyond / network.viscous_damping_nms_rad)
    # Damping that falls with the velocity is greatest half way to where there is none: beyond, nothing is steady.
    fastest = size / network.viscous_damping_nms_rad if row[DRAG] >= 0.0 else -0.5 / row[DRAG]
    low, high = np.zeros_like(torque), np.broadcast_to(fastest, torque.shape)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        faster = size > np.abs(resistance_nm(network, side * middle))
        low, high = np.where(faster, middle, low), np.where(faster, high, middle)
    # Never held up to the last step of the search: nothing holds it.
    steady = np.where((row[DRAG] < 0.0) & (high >= fastest), inf, low)
    return np.asarray(side * np.where(beyond > 0.0, steady, 0.0))


def falling(network: NortonNetwork, fastest_rad_s: float) -> tuple[float, float, float] | None:
    """Where sliding resistance falls with the speed: from, to [rad/s] and the steepest slope there [N m s/rad].

    Of either direction, up to ``fastest_rad_s``; None where it rises everywhere.
    """
    row, speed = network.row, np.linspace(0.0, fastest_rad_s, SPEEDS)
    if row[STRIBECK]:
        speed = np.union1d(speed, np.linspace(0.0, 3.0 * abs(row[STRIBECK_VELOCITY]), SPEEDS))
    over = speed / row[STRIBECK_VELOCITY]
    slope = network.viscous_damping_nms_rad * (1.0 + 2.0 * row[DRAG] * speed)
    slope -= network.coulomb_torque_nm * row[STRIBECK] * 2.0 * over / row[STRIBECK_VELOCITY] * np.exp(-(over**2))
    falls = speed[slope < 0.0]
    return (float(falls[0]), float(falls[-1]), float(slope.min())) if falls.size else None


def greatest_friction_nm(network: NortonNetwork) -> float:
    """The most [N m] that friction and cogging may hold anywhere, in either direction, with no torque at the port."""
    waves = float(np.sum(np.hypot(*waves_of(network.terms)[:, 1:].T)))
    by_place = sum(hypot(*term.values) for term in network.terms if term.name == "friction_by_position")
    held = max(held_nm(network, side) for side in (-1.0, 1.0))
    return max(held, network.coulomb_torque_nm) + network.coulomb_torque_nm * by_place + waves


def command_shown(network: NortonNetwork) -> float:
    """The command that pictures and costs go to: SHOWN times the greater threshold.

    Where saturation never lets the shaft go, a threshold is what it would be without.
    """
    thresholds = [abs(each) for each in network.thresholds if np.isfinite(each)]
    return SHOWN * max(thresholds, default=network.coulomb_torque_nm / abs(network.torque_gain))


# Half of them mirror the others, so that the interval of a linear figure lies evenly about its value. The share of
# draws in one tail, of 2.5 %, is then known to 0.25 % (binomial), far less than any coverage can be measured to.
DRAWS = 4000
# Terms that a mean over positions and directions depends on.
MEAN_TERMS = ("stribeck", "load", "saturation", "drag")


@dataclass(frozen=True)
class Motor:
    """The motor's parameters, all of one shape: many draws at once. The gain is taken without its sign."""

    gain: FloatArray  # N m per unit of command
    bandwidth_rad_s: FloatArray
    inertia_kgm2: FloatArray
    damping_nms_rad: FloatArray
    coulomb_nm: FloatArray
    stiffness_nm_rad: FloatArray
    contact_damping_nms_rad: FloatArray
    terms: Mapping[str, FloatArray] = field(default_factory=dict)  # parameters of terms, by name

    def _term(self, name: str) -> FloatArray:
        return self.terms.get(name, np.zeros(1))

    def drive_nm(self, command: float) -> FloatArray:
        """Torque of the motor itself under a steady command of that magnitude."""
        return self.gain * command / (1.0 + self._term("gain_saturation") * command**2)

    def command_for(self, torque_nm: FloatArray) -> FloatArray:
        """The command that gives this torque; infinite where saturation allows none."""
        return command_for(over(torque_nm, self.gain), self._term("gain_saturation"))

    @property
    def held_nm(self) -> FloatArray:
        """The friction that sliding begins at."""
        return self.coulomb_nm + self._term("stribeck_torque")

    def resistance_nm(self, velocity_rad_s: FloatArray | float) -> FloatArray:
        """Friction and damping in steady sliding at a velocity above 0, with no torque at the port."""
        friction, damping = self.coulomb_nm, self.damping_nms_rad
        if "stribeck_torque" in self.terms:
            fades = np.exp(-((velocity_rad_s / self.terms["stribeck_velocity"]) ** 2))
            friction = friction + self.terms["stribeck_torque"] * fades
        return friction + (damping + self._term("quadratic_drag") * velocity_rad_s) * velocity_rad_s

    @property
    def load_friction(self) -> FloatArray:
        """Friction per torque at the port."""
        return self._term("load_friction")

    def beyond_friction_nm(self, command: float) -> FloatArray:
        """What of the drive is left as the shaft begins to slide; 0 where it does not break away."""
        return np.maximum(self.drive_nm(command) - self.held_nm, 0.0)


def over(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """A ratio of figures that are positive in truth: infinite where the denominator was drawn below zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(denominator <= 0.0, inf, numerator / denominator))


def estimate_of(network: NortonNetwork) -> Motor:
    """The network's own values, shape (1,)."""
    return _motor(_values(network)[None, :], _term_names(network))


def drawn(network: NortonNetwork, seed: int) -> Motor:
    """DRAWS motors as the covariance has them, shape (DRAWS,); all of them NaN where the network has none."""
    names = [*(PARAMETER_OF_FIELD[field] for field in REQUIRED), *_term_names(network)]
    if not has_covariance(network):
        return _motor(np.full((DRAWS, len(names)), np.nan), _term_names(network))
    covariance = np.zeros((len(names), len(names)))
    at = [names.index(name) for name in network.covariance_names if name in names]
    chosen = [place for place, name in enumerate(network.covariance_names) if name in names]
    covariance[np.ix_(at, at)] = np.asarray(network.covariance)[np.ix_(chosen, chosen)]
    half = np.random.default_rng(seed).standard_normal((DRAWS // 2, len(names))) @ _root(covariance).T
    return _motor(_values(network) + np.concatenate([half, -half]), _term_names(network))


def drawn_values(network: NortonNetwork, seed: int) -> FloatArray:
    """Values of ``network.covariance_names`` as they go together, shape (DRAWS, names); terms that have none stay."""
    values = {name: value for name, (value, _) in network.parameters().items()}
    values |= {name: value for term in network.terms for name, value in term.named().items()}
    mean = np.array([values[name] for name in network.covariance_names])
    normal = np.random.default_rng(seed).standard_normal((DRAWS, mean.size))
    return np.asarray(mean + normal @ _root(np.asarray(network.covariance)).T)


def has_covariance(network: NortonNetwork) -> bool:
    """Whether intervals follow from it."""
    return bool(set(network.covariance_names) & {PARAMETER_OF_FIELD[field] for field in REQUIRED})


def _term_names(network: NortonNetwork) -> list[str]:
    """The parameters of its terms that a mean over positions and directions depends on."""
    return [name for term in network.terms if term.name in MEAN_TERMS for name in term.named()]


def _values(network: NortonNetwork) -> FloatArray:
    """Those of REQUIRED and of the terms' parameters."""
    terms = [value for term in network.terms if term.name in MEAN_TERMS for value in term.values]
    return np.array([*(getattr(network, field) for field in REQUIRED), *terms])


def _motor(values: FloatArray, names: Sequence[str]) -> Motor:
    gain, *others = values.T[: len(REQUIRED)]
    motor = Motor(np.abs(gain), *others)
    return replace(motor, terms=dict(zip(names, values.T[len(REQUIRED) :], strict=True)))


def _root(covariance: FloatArray) -> FloatArray:
    """A matrix whose product with its transpose is ``covariance``, which may be singular. Rows of very different size
    are brought to one first."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
