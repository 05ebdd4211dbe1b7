"""The ladder of friction models: each fitted on part of the data and judged on the part it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bench.errors import ExperimentError
from bench.identification.friction.equation import Equation, blocked_folds
from bench.identification.friction.fit import FrictionFit, Problem, fit_friction
from bench.identification.friction.model import FrictionModel

__all__ = ["Equation", "FrictionFit", "Rung", "blocked_folds", "fit_friction", "ladder", "selected"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# A richer model has to leave this much less, relative.
LEAST_GAIN = 0.01


@dataclass(frozen=True)
class Rung:
    """One model and how well it predicts.

    ``fit`` is on all rows; ``train_rms`` its residual. ``held_out_rms`` is over all folds, each predicted by a fit that
    has not seen it; ``held_out_std`` its standard error. The relative ones are over the rms of the target.
    """

    model: FrictionModel
    fit: FrictionFit
    train_rms: float
    held_out_rms: float
    held_out_std: float
    target_rms: float
    fold_mean_squares: tuple[float, ...]
    selected: bool = False

    @property
    def name(self) -> str:
        return self.model.name

    @property
    def unknowns(self) -> int:
        """How many numbers the model has."""
        return len(self.model.terms) + len(self.model.unknowns)

    @property
    def train_relative(self) -> float:
        return self.train_rms / self.target_rms

    @property
    def held_out_relative(self) -> float:
        return self.held_out_rms / self.target_rms


def ladder(equation: Equation, models: Sequence[FrictionModel], rows: BoolArray | None = None) -> tuple[Rung, ...]:
    """Every model on the folds of ``rows`` (all by default), in the order given, one of them selected.

    Selected is the simplest model that is not worse than the best on held-out data by more than one standard error
    of the difference between them. Raises ExperimentError for fewer than two folds.
    """
    rows = np.ones(equation.target.size, dtype=bool) if rows is None else rows
    folds = [int(fold) for fold in np.unique(equation.fold[rows]) if fold >= 0]
    if len(folds) < 2:
        raise ExperimentError("models are compared on data held out: the record needs at least two parts")
    rungs = [_rung(equation, model, rows, folds) for model in models]
    return _select(rungs)


def selected(rungs: Sequence[Rung]) -> Rung:
    """The one to be used."""
    return next(rung for rung in rungs if rung.selected)


def _rung(equation: Equation, model: FrictionModel, rows: BoolArray, folds: list[int]) -> Rung:
    # Part 0 is always trained on, -1 never; the folds follow.
    part = np.where(rows, 0, -1)
    for index, fold in enumerate(folds):
        part[rows & (equation.fold == fold)] = index + 1
    problem = Problem.of(equation, model, part)
    best = problem.refine(rows, problem.scan())
    whole = problem.finish(rows, best)
    squares = []
    for index in range(1, len(folds) + 1):
        train = rows & (part != index)
        reached = problem.refine(train, problem.scan(index, best.at))
        held_out = part == index
        residual = equation.target[held_out] - reached.linear @ reached.columns[:, held_out]
        squares.append(float(np.mean(residual**2)))
    mean = float(np.mean(squares))
    return Rung(
        model=model,
        fit=whole,
        train_rms=whole.rms,
        held_out_rms=float(np.sqrt(mean)),
        held_out_std=_standard_error(np.array(squares)) / (2 * float(np.sqrt(mean))) if mean > 0 else 0.0,
        target_rms=float(np.sqrt(np.mean(equation.target[rows] ** 2))),
        fold_mean_squares=tuple(squares),
    )


def _standard_error(values: FloatArray) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(values.size))


def _select(rungs: list[Rung]) -> tuple[Rung, ...]:
    """The one-standard-error rule, on differences fold by fold: folds differ far more than models do.

    A gain too small to matter is none, however sure it is: no model is quite what a machine does.
    """
    best = min(rungs, key=lambda rung: rung.held_out_rms)

    def as_good(rung: Rung) -> bool:
        excess = np.array(rung.fold_mean_squares) - np.array(best.fold_mean_squares)
        matters = (LEAST_GAIN**2 + 2 * LEAST_GAIN) * best.held_out_rms**2
        return float(np.mean(excess)) <= max(_standard_error(excess), matters)

    simplest = min((rung for rung in rungs if as_good(rung)), key=lambda rung: (rung.unknowns, rung.held_out_rms))
    return tuple(replace(rung, selected=rung is simplest) for rung in rungs)
