"""Friction that depends on velocity alone: Coulomb, viscous, Stribeck, and what a load adds to them."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.identification.friction.model import COULOMB, STRIBECK, VISCOUS, Dimension, Term, Unknown
from norton_bench.identification.friction.path import Path

STICTION = Term("stribeck_torque", Dimension.FRICTION)


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
    replaces: tuple[str, ...] = ()

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        return np.stack([path.velocity, np.sign(path.velocity)])


@dataclass(frozen=True)
class Stribeck:
    """``Fv v + [Fc + (Fs − Fc) exp(−(v/vs)²)] sgn v``; the stribeck_torque is Fs − Fc."""

    name: str = "stribeck"
    unknowns: tuple[Unknown, ...] = (STRIBECK,)
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, STICTION)
    replaces: tuple[str, ...] = ()

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        side = np.sign(path.velocity)
        return np.stack([path.velocity, side, side * bump(path.velocity, shape[0])])


@dataclass(frozen=True)
class LoadDependent:
    """``Fv v + (Fc + μ |load|) sgn v``: as gears and screws do."""

    name: str = "load-dependent"
    unknowns: tuple[Unknown, ...] = ()
    terms: tuple[Term, ...] = (VISCOUS, COULOMB, Term("load_coefficient", Dimension.RATIO))
    replaces: tuple[str, ...] = ()

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        """Raises UsageError where the load is not known."""
        if path.load is None:
            raise UsageError('friction "load-dependent" needs the load that is transmitted: map a column to it')
        side = np.sign(path.velocity)
        return np.stack([path.velocity, side, side * np.abs(path.load)])
