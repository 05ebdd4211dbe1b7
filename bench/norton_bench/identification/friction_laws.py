"""The laws of friction: of velocity alone, and of the path that the shaft went."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError, nearest
from norton_bench.identification.friction_model import (
    COULOMB,
    LONGEST_TRAVEL,
    PRESLIDING,
    PRESLIDING_DAMPING,
    STRIBECK,
    VISCOUS,
    Dimension,
    FrictionModel,
    Path,
    Term,
    Unknown,
)

STICTION = Term("stribeck_torque", Dimension.FRICTION)
FILM = Unknown("film_velocity", Dimension.VELOCITY, 1e-3, 3.0)
# Fs/Fc − 1, the excess of stiction over Coulomb friction. Below a tenth it is Dahl's.
EXCESS = Unknown("stiction_excess", Dimension.RATIO, 0.1, 5.0)
BREAKAWAY = Unknown("breakaway_share", Dimension.RATIO, 0.05, 0.98)

# Of maxwell-slip: elements log-spaced around the presliding displacement, finely enough for any smooth curve.
ELEMENTS = 12
AROUND = (0.03, 3.0)


def bump(velocity: FloatArray, stribeck_velocity: float) -> FloatArray:
    """The share of stiction left at ``velocity`` (Stribeck's curve, exponent 2)."""
    # Not less than e⁻⁶⁰: numbers near the smallest there are make everything slow.
    return np.asarray(np.exp(-np.minimum(np.square(velocity / stribeck_velocity), 60.0)))


@dataclass(frozen=True)
class CoulombViscous:
    """``Fv v + Fc sgn v``."""

    name: str = "coulomb-viscous"
    unknowns: tuple[Unknown, ...] = ()
    terms: tuple[Term, ...] = (VISCOUS, COULOMB)

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        return np.stack([path.velocity, np.sign(path.velocity)])


@dataclass(frozen=True)
class Stribeck:
    """``Fv v + [Fc + (Fs − Fc) exp(−(v/vs)²)] sgn v``; the stribeck_torque is Fs − Fc."""

    name: str = "stribeck"
    unknowns: tuple[Unknown, ...] = (STRIBECK,)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, STICTION)

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        side = np.sign(path.velocity)
        return np.stack([path.velocity, side, side * bump(path.velocity, shape[0])])


@dataclass(frozen=True)
class Film:
    """``Fv v + [Fc + Fl (1 − exp(−|v|/vl))] sgn v``: a lubricant film whose drag rises at once and then less and less,
    because it thins under shear; the film_torque is Fl."""

    name: str = "film"
    unknowns: tuple[Unknown, ...] = (FILM,)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, Term("film_torque", Dimension.FRICTION))

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        side, speed = np.sign(path.velocity), np.abs(path.velocity)
        return np.stack([path.velocity, side, -side * np.expm1(-speed / shape[0])])


@dataclass(frozen=True)
class LoadDependent:
    """``Fv v + (Fc + μ |load|) sgn v``: as gears and screws do."""

    name: str = "load-dependent"
    unknowns: tuple[Unknown, ...] = ()
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, Term("load_coefficient", Dimension.RATIO))

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        """Raises UsageError where the load is not known."""
        if path.load is None:
            raise UsageError(
                'friction "load-dependent" needs the load: map a column to normal, load or exertion, or give [load]'
            )
        side = np.sign(path.velocity)
        return np.stack([path.velocity, side, side * np.abs(path.load)])


# Friction that remembers the path: contacts that deflect before they slide.
@dataclass(frozen=True)
class Dahl:
    """``dh/dx = (1 − s h)/d``: one contact that yields gradually over the presliding displacement d = Fc/σ0."""

    name: str = "dahl"
    unknowns: tuple[Unknown, ...] = (PRESLIDING,)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, PRESLIDING_DAMPING)

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        return _contact(path, np.ones(path.position.size), shape[0])


@dataclass(frozen=True)
class LuGre:
    """Dahl's contact with Stribeck's strength ``γ(v) = 1 + (Fs/Fc − 1) exp(−(v/vs)²)`` (Canudas de Wit 1995)."""

    name: str = "lugre"
    unknowns: tuple[Unknown, ...] = (PRESLIDING, STRIBECK, EXCESS)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, PRESLIDING_DAMPING)

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        deflection, stribeck_velocity, excess = shape
        return _contact(path, 1.0 + excess * bump(path.velocity_between, stribeck_velocity), deflection)


@dataclass(frozen=True)
class ElastoPlastic:
    """Purely elastic below breakaway, then yielding to Coulomb friction (Dupont 2002): it never drifts under a load."""

    name: str = "elasto-plastic"
    unknowns: tuple[Unknown, ...] = (PRESLIDING, BREAKAWAY)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, PRESLIDING_DAMPING)

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        from norton_bench.identification import friction_operators as operators  # noqa: PLC0415  (compiled: slow to import)

        share, plastic = operators.elasto_plastic(path.position, path.begin, shape[0], shape[1])
        rate = path.velocity * (1.0 - plastic * share * np.sign(path.velocity))
        return np.stack([path.velocity, share, rate])


@dataclass(frozen=True)
class MaxwellSlip:
    """Elastic elements side by side that slip at loads of their own, beside viscous, Coulomb and Stribeck friction.

    Their deflections stand on a logarithmic grid around the presliding displacement and their strengths are
    coefficients, so that the curve of first loading may have any shape that Masing's rule allows (Iwan 1966;
    Al-Bender 2005). Elements that the path is too short to turn over, or passes too quickly to show, have no strength.
    """

    name: str = "maxwell-slip"
    unknowns: tuple[Unknown, ...] = (PRESLIDING, STRIBECK)
    terms: tuple[Term, ...] = (
        VISCOUS,
        COULOMB,
        STICTION,
        *(Term(f"slip_torque_{element + 1}", Dimension.FRICTION) for element in range(ELEMENTS)),
    )

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        from norton_bench.identification import friction_operators as operators  # noqa: PLC0415  (compiled: slow to import)

        deflections = shape[0] * np.geomspace(*AROUND, ELEMENTS)
        elements = operators.stops(path.position, path.begin, deflections)
        elements[(deflections < path.shortest) | (deflections > LONGEST_TRAVEL * path.displacement_scale)] = 0.0
        side = np.sign(path.velocity)
        return np.concatenate([np.stack([path.velocity, side, side * bump(path.velocity, shape[1])]), elements])


def _contact(path: Path, strength: FloatArray, deflection: float) -> FloatArray:
    """Velocity, share and the share's rate times the deflection, shape (3, n)."""
    from norton_bench.identification import friction_operators as operators  # noqa: PLC0415  (compiled: slow to import)

    share = operators.bristle(path.position, path.begin * strength, strength, deflection)
    rate = path.velocity * (1.0 - np.sign(path.velocity) * share / strength)
    return np.stack([path.velocity, share, rate])


@dataclass(frozen=True)
class Asymmetric:
    """A model of friction with coefficients of its own in each direction.

    ``of`` with every column split by its sign: what opposes positive motion, then what opposes negative.

    In friction of velocity alone (``memory`` False) a difference between the two directions' Coulomb friction cannot
    be told from a constant exertion: that holds it, and Coulomb friction is the mean of both directions.
    """

    of: FrictionModel
    memory: bool

    @property
    def name(self) -> str:
        return f"{self.of.name}-asymmetric"

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        return self.of.unknowns

    @property
    def terms(self) -> tuple[Term, ...]:
        shared = () if self.memory else (COULOMB,)
        split = [term for term in self.of.terms if term not in shared]
        return (*shared, *(Term(f"{t.name}_{side}", t.dimension) for side in ("positive", "negative") for t in split))

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        both = self.of.columns(path, shape)
        at = [index for index, term in enumerate(self.of.terms) if self.memory or term is not COULOMB]
        shared = np.delete(both, at, axis=0)
        return np.concatenate([shared, np.maximum(both[at], 0.0), np.minimum(both[at], 0.0)])


FAMILY: tuple[FrictionModel, ...] = (
    CoulombViscous(),
    Asymmetric(CoulombViscous(), memory=False),
    LoadDependent(),
    Stribeck(),
    Asymmetric(Stribeck(), memory=False),
    Dahl(),
    ElastoPlastic(),
    LuGre(),
    MaxwellSlip(),
    Asymmetric(ElastoPlastic(), memory=True),
    Asymmetric(MaxwellSlip(), memory=True),
)

# Further laws for logs of machines that nobody here has seen; a session of the bench compares those above.
FILMS: tuple[FrictionModel, ...] = (Film(), Asymmetric(Film(), memory=False))

# Models that a model becomes for some of its values. All others are friction laws of their own.
CONTAINS = {
    "coulomb-viscous-asymmetric": ("coulomb-viscous",),
    "load-dependent": ("coulomb-viscous",),
    "stribeck": ("coulomb-viscous",),
    "film": ("coulomb-viscous",),
    "film-asymmetric": ("film", "coulomb-viscous-asymmetric", "coulomb-viscous"),
    "stribeck-asymmetric": ("stribeck", "coulomb-viscous-asymmetric", "coulomb-viscous"),
    # With the least Stribeck velocity its stiction is gone as soon as the shaft moves.
    "lugre": ("dahl",),
    "maxwell-slip": ("stribeck", "coulomb-viscous"),
    "elasto-plastic-asymmetric": ("elasto-plastic",),
    "maxwell-slip-asymmetric": ("maxwell-slip", "stribeck", "coulomb-viscous"),
}


# All models of friction, from the simplest on, by their names.
def model(name: str) -> FrictionModel:
    """The member called ``name``. Raises UsageError, with the nearest name, where there is none."""
    by_name = {member.name: member for member in (*FAMILY, *FILMS)}
    if name not in by_name:
        raise UsageError(f'there is no friction model "{name}"; {nearest(name, by_name)}')
    return by_name[name]


def family_for(path: Path) -> tuple[FrictionModel, ...]:
    """Those that can be computed on ``path``: a model that asks for the load only where the load is known."""
    return tuple(member for member in FAMILY if path.load is not None or not isinstance(member, LoadDependent))
