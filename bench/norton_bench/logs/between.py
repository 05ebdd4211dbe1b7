"""Parts of the training data fitted apart: what differs between them more than they should enters the intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.ladder import fit_friction
from norton_bench.identification.statistics import combine
from norton_bench.logs.equation import Problem

# Parts that one record is cut into, and how many rows a part must have for each number that is fitted to it.
PARTS = 4
ROWS_A_NUMBER = 10
# Chance alone seldom gives such a difference.
SELDOM = 0.05
# Knots of a line and elements of a contact are those of their own time and displacement.
OF_A_PART = ("offset_", "slip_torque")


@dataclass(frozen=True)
class Between:
    """One value in each part: shapes (parts,). ``p`` is how often chance alone gives such differences."""

    name: str
    values: FloatArray
    stds: FloatArray
    p: float
    widened_std: float

    @property
    def differs(self) -> bool:
        return self.p < SELDOM


@dataclass(frozen=True)
class Compared:
    """``what`` the parts are; empty ``each`` where the data are too few to be cut."""

    what: str
    each: tuple[Between, ...]

    @property
    def sentence(self) -> str:
        """How the parts agree."""
        if not self.each:
            return "The data are too few to compare parts of them: intervals are of this record alone."
        apart = [one for one in self.each if one.differs]
        if not apart:
            return f"{self.what} agree: each fitted apart, no value differs by more than its deviations allow."
        told = "; ".join(
            f"{one.name.replace('_', ' ')} {', '.join(f'{value:.4g}' for value in one.values)}" for one in apart
        )
        sentence = f"{self.what} differ by more than their deviations allow, and intervals are widened by that: {told}."
        drifts = any(one.name == "offset" and _goes_one_way(one.values) for one in apart)
        return f'{sentence} The offset drifts: try [model] drift = "30 s".' if drifts else sentence


def _goes_one_way(values: FloatArray) -> bool:
    steps = np.diff(values)
    return bool(steps.size > 1 and (np.all(steps > 0) or np.all(steps < 0)))


def compared(problem: Problem, fit: FrictionFit) -> Compared:
    """The model fitted to each training log or, where there is one, to each quarter of it."""
    what, groups = _groups(problem)
    least = ROWS_A_NUMBER * len(fit.names)
    if len(groups) < 2 or min(np.count_nonzero(rows) for rows in groups) < least:
        return Compared(what, ())
    near = fit.shape if fit.shape.size else None
    fits = [fit_friction(problem.equation, fit.model, rows, near=near) for rows in groups]
    return Compared(what, tuple(_between(fit, fits)))


def _groups(problem: Problem) -> tuple[str, list[BoolArray]]:
    lengths = [len(term.sound) for term in problem.terms]
    place = np.repeat([part.log.place for part in problem.stretches], lengths)[problem.pick]
    places = list(dict.fromkeys(place[problem.train]))
    if len(places) > 1:
        names = ", ".join(Path(each).name for each in places)
        return f"The logs ({names})", [problem.train & (place == each) for each in places]
    count = np.cumsum(problem.train)
    part = np.minimum((count - 1) * PARTS // max(int(count[-1]), 1), PARTS - 1)
    return "Quarters of the record", [problem.train & (part == each) for each in range(PARTS)]


def _between(fit: FrictionFit, fits: Sequence[FrictionFit]) -> list[Between]:
    result = []
    for index, name in enumerate(fit.names):
        values = np.array([each.values[index] for each in fits])
        stds = np.array([each.deviations[index] for each in fits])
        known = np.isfinite(stds) & (stds > 0)
        if name.startswith(OF_A_PART) or name in fit.at_bound or np.count_nonzero(known) < 2:
            continue
        both = combine(values[known], stds[known])
        std = float(fit.deviations[index])
        wide = max(std, both.std) if both.p < SELDOM else std
        result.append(Between(name, values, stds, both.p, wide))
    return result


def widened(fit: FrictionFit, result: Compared) -> FrictionFit:
    """The fit with deviations that hold what differs between the parts."""
    stds = {one.name: one.widened_std for one in result.each}
    deviations = fit.deviations
    factors = np.array(
        [stds.get(name, std) / std if std > 0 else 1.0 for name, std in zip(fit.names, deviations, strict=True)]
    )
    return replace(fit, covariance=fit.covariance * np.outer(factors, factors))
