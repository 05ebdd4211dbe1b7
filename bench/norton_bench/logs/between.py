"""Parts of the training data compared: what differs between them more than they should enters the intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import chi2_tail, t_quantile
from norton_bench.identification.friction_fit import QUARTERS, FrictionFit, moved_by_quarters
from norton_bench.identification.statistics import NORMAL_95, combine
from norton_bench.logs.delays import with_delays
from norton_bench.logs.equation import Problem

# So many rows a quarter must have for each number that is fitted.
ROWS_A_NUMBER = 10
# Chance alone seldom gives such a difference.
SELDOM = 0.05
# One of several parts stands out if it alone is so many deviations from the others, which agree.
STANDS_OUT = 3.0
# Knots of a line and elements of a contact are those of their own time and displacement.
OF_A_PART = ("offset_", "slip_torque")


@dataclass(frozen=True)
class Part:
    """A fit of one part: ``values`` and their deviations by name; delays are whole ones. What lies at a bound is none:
    a direction in which the part never moves has no friction there."""

    label: str
    values: Mapping[str, tuple[float, float]]

    @classmethod
    def of(cls, label: str, problem: Problem, fit: FrictionFit) -> "Part":
        values = with_delays(problem, fit)
        return cls(label, {name: value for name, value in values.items() if name not in fit.at_bound})


@dataclass(frozen=True)
class Between:
    """One value in each part: shapes (parts,), and in all of them ``together``. ``p`` is how often chance alone gives
    such differences, ``scatter_std`` the deviation that they mean, 0 where there are none; ``odd`` the part that stands
    out, if one does."""

    name: str
    values: FloatArray
    stds: FloatArray
    together: float
    p: float
    scatter_std: float
    odd: str = ""

    @property
    def differs(self) -> bool:
        return self.p < SELDOM

    @property
    def told(self) -> str:
        """The values, and whose stands out."""
        values = ", ".join("none" if np.isnan(value) else f"{value:.4g}" for value in self.values)
        return f"{self.name.replace('_', ' ')} {values}{f' ({self.odd} stands out)' if self.odd else ''}"

    @property
    def of_none(self) -> bool:
        """Whether the value of all parts together lies beyond that of every part."""
        low, high = (self.values + side * STANDS_OUT * self.stds for side in (-1, 1))
        return bool(self.together < np.nanmin(low) or self.together > np.nanmax(high))


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
            return f"{self.what} agree: no value differs between them by more than its deviations allow."
        told = "; ".join(one.told for one in apart)
        sentence = f"{self.what} differ by more than their deviations allow, and intervals are widened by that: {told}."
        odd = sorted({one.odd for one in apart if one.odd})
        if len(odd) == 1:
            sentence += f" Leave {odd[0]} out, or fit it apart: it seems to be of another machine, load or sensor."
        drifts = any(one.name == "offset" and _goes_one_way(one.values) for one in apart)
        return f'{sentence} The offset drifts: try [model] drift = "30 s".' if drifts else sentence

    @property
    def of_none(self) -> frozenset[str]:
        """The names of values that are together what none of the parts has, nor lies between."""
        return frozenset(one.name for one in self.each if one.of_none)


def _goes_one_way(values: FloatArray) -> bool:
    steps = np.diff(values)
    return bool(steps.size > 1 and (np.all(steps > 0) or np.all(steps < 0)))


def of_logs(problem: Problem, fit: FrictionFit, parts: Sequence[Part]) -> Compared:
    """Of all training logs together, and each fitted apart, with delays of its own."""
    names = ", ".join(part.label for part in parts)
    return Compared(f"The logs ({names})", tuple(_between(problem, fit, parts)))


def of_quarters(problem: Problem, fit: FrictionFit) -> Compared:
    """What each quarter of one training log makes of the values.

    The quarters are not fitted: what one of them does not excite has no value there. Each moves the values of the whole
    by its own residuals, and by chance no further than the noise within it does.
    """
    if np.count_nonzero(fit.rows) < QUARTERS * ROWS_A_NUMBER * len(fit.names):
        return Compared("", ())
    moved = moved_by_quarters(problem.equation, fit)
    each = zip(with_delays(problem, fit).items(), moved.values.T, moved.stds.T, strict=True)
    told = [_of_quarters(name, value, *by) for (name, (value, _)), *by in each if not _own(name, fit)]
    return Compared("Quarters of the record", tuple(told))


def _of_quarters(name: str, value: float, moved: FloatArray, stds: FloatArray) -> Between:
    squares = float(np.sum(moved**2))
    p = chi2_tail(squares / max(float(np.mean(stds**2)), 1e-300), QUARTERS - 1)
    # As a sandwich estimate with a block for each quarter, which knows few blocks.
    std = t_quantile(0.975, QUARTERS - 1) / NORMAL_95 * np.sqrt(QUARTERS / (QUARTERS - 1) * squares)
    return Between(name, value + QUARTERS * moved, QUARTERS * stds, value, p, float(std) if p < SELDOM else 0.0)


def _own(name: str, fit: FrictionFit) -> bool:
    """Whether a value cannot be compared: it is of a part's own time or displacement, or lies at a bound."""
    return name.startswith(OF_A_PART) or name in fit.at_bound


def trained_places(problem: Problem) -> list[str]:
    """The logs that are trained on."""
    lengths = [len(term.sound) for term in problem.terms]
    place = np.repeat([part.log.place for part in problem.stretches], lengths)[problem.pick]
    return list(dict.fromkeys(place[problem.train]))


def _between(problem: Problem, fit: FrictionFit, parts: Sequence[Part]) -> list[Between]:
    result = []
    for name, (value, _) in with_delays(problem, fit).items():
        pairs = [part.values.get(name, (np.nan, np.nan)) for part in parts]
        values, stds = (np.array(each) for each in zip(*pairs, strict=True))
        known = np.isfinite(stds) & (stds > 0)
        if _own(name, fit) or np.count_nonzero(known) < 2:
            continue
        both = combine(values[known], stds[known])
        differs = both.p < SELDOM
        odd = _odd(values, stds, [part.label for part in parts]) if known.all() and differs else ""
        result.append(Between(name, values, stds, value, both.p, both.std if differs else 0.0, odd))
    return result


def _odd(values: FloatArray, stds: FloatArray, labels: Sequence[str]) -> str:
    """Whose value stands out from the others, which agree: empty where there are too few, or none or several do."""
    result = []
    for index, label in enumerate(labels):
        others = np.arange(values.size) != index
        if label and np.count_nonzero(others) > 1:
            rest = combine(values[others], stds[others])
            away = abs(values[index] - rest.value) / np.hypot(stds[index], rest.std)
            result += [label] if rest.p >= SELDOM and away > STANDS_OUT else []
    return result[0] if len(result) == 1 else ""


def widened(fit: FrictionFit, result: Compared) -> FrictionFit:
    """The fit with deviations that hold what differs between the parts."""
    stds = {one.name: one.scatter_std for one in result.each}
    deviations = fit.deviations
    factors = np.array(
        [
            max(stds.get(name, 0.0) / std, 1.0) if std > 0 else 1.0
            for name, std in zip(fit.names, deviations, strict=True)
        ]
    )
    return replace(fit, covariance=fit.covariance * np.outer(factors, factors))
