"""Friction that remembers the path: contacts that deflect before they slide."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction.model import (
    COULOMB,
    PRESLIDING,
    PRESLIDING_DAMPING,
    STRIBECK,
    VISCOUS,
    Dimension,
    Term,
    Unknown,
)
from norton_bench.identification.friction.path import Path
from norton_bench.identification.friction.static import STICTION, bump

# Fs/Fc − 1, the excess of stiction over Coulomb friction. Below a tenth it is Dahl's.
EXCESS = Unknown("stiction_excess", Dimension.RATIO, 0.1, 5.0)
BREAKAWAY = Unknown("breakaway_share", Dimension.RATIO, 0.05, 0.98)

# Of maxwell-slip: elements log-spaced around the presliding displacement, finely enough for any smooth curve.
ELEMENTS = 12
AROUND = (0.03, 3.0)


@dataclass(frozen=True)
class Dahl:
    """``dh/dx = (1 − s h)/d``: one contact that yields gradually over the presliding displacement d = Fc/σ0."""

    name: str = "dahl"
    unknowns: tuple[Unknown, ...] = (PRESLIDING,)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, PRESLIDING_DAMPING)
    replaces: tuple[str, ...] = ()

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        return _contact(path, np.ones(path.position.size), shape[0])


@dataclass(frozen=True)
class LuGre:
    """Dahl's contact with Stribeck's strength ``γ(v) = 1 + (Fs/Fc − 1) exp(−(v/vs)²)`` (Canudas de Wit 1995)."""

    name: str = "lugre"
    unknowns: tuple[Unknown, ...] = (PRESLIDING, STRIBECK, EXCESS)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, PRESLIDING_DAMPING)
    replaces: tuple[str, ...] = ()

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        deflection, stribeck_velocity, excess = shape
        return _contact(path, 1.0 + excess * bump(path.velocity_between, stribeck_velocity), deflection)


@dataclass(frozen=True)
class ElastoPlastic:
    """Purely elastic below breakaway, then yielding to Coulomb friction (Dupont 2002): it never drifts under a load."""

    name: str = "elasto-plastic"
    unknowns: tuple[Unknown, ...] = (PRESLIDING, BREAKAWAY)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, PRESLIDING_DAMPING)
    replaces: tuple[str, ...] = ()

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        from norton_bench.identification.friction import operators  # noqa: PLC0415  (compiled: slow to import)

        share, plastic = operators.elasto_plastic(path.position, path.begin, shape[0], shape[1])
        rate = path.velocity * (1.0 - plastic * share * np.sign(path.velocity))
        return np.stack([path.velocity, share, rate])


@dataclass(frozen=True)
class MaxwellSlip:
    """Elastic elements side by side that slip at loads of their own, beside viscous, Coulomb and Stribeck friction.

    Their deflections stand on a logarithmic grid around the presliding displacement and their strengths are
    coefficients, so that the curve of first loading may have any shape that Masing's rule allows (Iwan 1966;
    Al-Bender 2005).
    """

    name: str = "maxwell-slip"
    unknowns: tuple[Unknown, ...] = (PRESLIDING, STRIBECK)
    terms: tuple[Term, ...] = (
        VISCOUS,
        COULOMB,
        STICTION,
        *(Term(f"slip_torque_{element + 1}", Dimension.FRICTION) for element in range(ELEMENTS)),
    )
    replaces: tuple[str, ...] = ()

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        from norton_bench.identification.friction import operators  # noqa: PLC0415  (compiled: slow to import)

        deflections = shape[0] * np.geomspace(*AROUND, ELEMENTS)
        elements = operators.stops(path.position, path.begin, deflections)
        side = np.sign(path.velocity)
        return np.concatenate([np.stack([path.velocity, side, side * bump(path.velocity, shape[1])]), elements])


def _contact(path: Path, strength: FloatArray, deflection: float) -> FloatArray:
    """Velocity, share and the share's rate times the deflection, shape (3, n)."""
    from norton_bench.identification.friction import operators  # noqa: PLC0415  (compiled: slow to import)

    share = operators.bristle(path.position, path.begin * strength, strength, deflection)
    rate = path.velocity * (1.0 - np.sign(path.velocity) * share / strength)
    return np.stack([path.velocity, share, rate])
