"""A model of friction with coefficients of its own in each direction."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction.model import COULOMB, FrictionModel, Path, Term, Unknown

# The equation's constant exertion, or the first knot of one that drifts: what is left is then a drift from there.
CONSTANT = ("offset", "offset_1")


@dataclass(frozen=True)
class Asymmetric:
    """``of`` with every column split by its sign: what opposes positive motion, then what opposes negative.

    In friction of velocity alone (``memory`` False) a constant exertion cannot be told from a difference between the
    two directions' Coulomb friction: it is held by these, which may then have either sign.
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
        return tuple(
            Term(f"{term.name}_{side}", term.dimension, term.nonnegative and (self.memory or term is not COULOMB))
            for side in ("positive", "negative")
            for term in self.of.terms
        )

    @property
    def replaces(self) -> tuple[str, ...]:
        return () if self.memory else CONSTANT

    def columns(self, path: Path, shape: FloatArray) -> FloatArray:
        both = self.of.columns(path, shape)
        return np.concatenate([np.maximum(both, 0.0), np.minimum(both, 0.0)])
