"""A motor of many draws: its parameters and those of its terms as their covariance has them, for derived figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.models.network import PARAMETER_OF_FIELD, REQUIRED, NortonNetwork, impossible
from norton_bench.models.parameters import BY_NAME
from norton_bench.models.sliding import command_for
from norton_bench.models.terms import TERM_PARAMETERS

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
    values = network.values()
    mean = np.array([values[name] for name in network.covariance_names])
    normal = np.random.default_rng(seed).standard_normal((DRAWS, mean.size))
    return np.asarray(mean + normal @ _root(np.asarray(network.covariance)).T)


def possible(names: Sequence[str], values: Sequence[float]) -> bool:
    """Whether a machine may have these values of parameters with these names."""
    return not any(_impossible(name, value) for name, value in zip(names, values, strict=True))


def _impossible(name: str, value: float) -> bool:
    if name in BY_NAME:
        return impossible(name, value)
    term = TERM_PARAMETERS[name]
    return value < 0.0 if term.low == 0.0 else term.logarithmic and value <= 0.0


def drawn_networks(network: NortonNetwork, count: int, seed: int) -> tuple[NortonNetwork, ...]:
    """As many networks as ``count`` or fewer, whose values go together as the covariance has them; none where there is
    none. What no machine has is left out."""
    names = network.covariance_names
    if not has_covariance(network):
        return ()
    chosen = [each for each in drawn_values(network, seed).tolist() if possible(names, each)][:count]
    return tuple(network.with_values(dict(zip(names, each, strict=True))) for each in chosen)


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
