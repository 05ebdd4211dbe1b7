"""The ladder of friction models: each fitted on part of the data and judged on the part it has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.friction_fit import FrictionFit, Problem, fit_friction, scaled_rms
from norton_bench.identification.friction_laws import Asymmetric, family_for
from norton_bench.identification.friction_model import Equation, FrictionModel, Path, blocked_folds
from norton_bench.identification.regression import Regression
from norton_bench.identification.results import FitResult
from norton_bench.identification.separable import LOW_BAND
from norton_bench.identification.shape import Shape
from norton_bench.identification.signals import FINE, Signals
from norton_bench.identification.statistics import held_out_rms, simplest_as_good

__all__ = ["Equation", "FrictionFit", "Rung", "blocked_folds", "fit_friction", "ladder", "selected"]


# What leaves more than this many times the squared error of another law on held-out parts does not hold beside it.
HELD = 2.0


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
    def at_edge(self) -> bool:
        """Whether an unknown of its shape lies at the edge of what is searched."""
        return any(unknown.name in self.fit.at_bound for unknown in self.model.unknowns)

    @property
    def train_relative(self) -> float:
        return self.train_rms / self.target_rms

    @property
    def held_out_relative(self) -> float:
        return self.held_out_rms / self.target_rms


def ladder(equation: Equation, models: Sequence[FrictionModel], rows: BoolArray | None = None) -> tuple[Rung, ...]:
    """Every model on the folds of ``rows`` (all by default), in the order given, one of them selected.

    ``simplest_as_good`` selects. Raises ExperimentError for fewer than two folds.
    """
    rows = np.ones(equation.target.size, dtype=bool) if rows is None else rows
    folds = [int(fold) for fold in np.unique(equation.fold[rows]) if fold >= 0]
    if len(folds) < 2:
        raise ExperimentError("models are compared on data held out: the record needs at least two parts")
    shapes: dict[str, list[FloatArray]] = {}
    rungs = [_rung(equation, model, rows, folds, shapes) for model in models]
    chosen = chosen_of(rungs)
    return tuple(replace(rung, selected=rung is chosen) for rung in rungs)


def chosen_of(rungs: Sequence[Rung]) -> Rung:
    """The simplest that is as good as the best. What ends at the edge of what is searched is another law, which the
    others may hold, or none of them does."""
    inside = [rung for rung in rungs if not rung.at_edge]
    best = _simplest(rungs)
    return _simplest(inside) if inside and held(_simplest(inside), best) else best


def held(rung: Rung, best: Rung) -> bool:
    """Whether a law does about as well as the best on parts that neither has seen."""
    return rung.held_out_rms**2 < HELD * best.held_out_rms**2


def _simplest(rungs: Sequence[Rung]) -> Rung:
    return rungs[simplest_as_good([rung.fold_mean_squares for rung in rungs], [rung.unknowns for rung in rungs])]


def selected(rungs: Sequence[Rung]) -> Rung:
    """The one to be used."""
    return next(rung for rung in rungs if rung.selected)


def _rung(
    equation: Equation, model: FrictionModel, rows: BoolArray, folds: list[int], shapes: dict[str, list[FloatArray]]
) -> Rung:
    """``shapes`` are those of the models before, on all rows and without each fold; this one's are added."""
    # Part 0 is always trained on, -1 never; the folds follow.
    part = np.where(rows, 0, -1)
    for index, fold in enumerate(folds):
        part[rows & (equation.fold == fold)] = index + 1
    problem = Problem.of(equation, model, part)
    best = problem.search(rows, problem.scan(), _of_part(shapes, 0))
    whole = problem.finish(rows, best)
    squares, own = [], [whole.shape]
    for index in range(1, len(folds) + 1):
        train = rows & (part != index)
        reached = problem.search(train, problem.scan(index, best.at), _of_part(shapes, index))
        held_out = part == index
        if equation.settled is not None:
            held_out &= equation.settled
        residual = problem.target[held_out] - reached.linear @ problem.begun_afresh(reached.at)[:, held_out]
        squares.append(scaled_rms(residual, problem.scale[rows]) ** 2)
        own.append(np.exp(reached.at))
    shapes[model.name] = own
    rms, std = held_out_rms(squares)
    return Rung(
        model=model,
        fit=whole,
        train_rms=whole.rms,
        held_out_rms=rms,
        held_out_std=std,
        target_rms=float(np.sqrt(np.mean(equation.target[rows] ** 2))),
        fold_mean_squares=tuple(squares),
    )


def _of_part(shapes: dict[str, list[FloatArray]], index: int) -> dict[str, FloatArray]:
    return {name: each[index] for name, each in shapes.items()}


# Ticks from row to row: twice the band's edge, and no more, for every model passes through here many times.
STRIDE = 10


# The ladder of friction models on the bench's own recordings: which of them the actuator's friction asks for.
#
# Amplifier and delays are taken from the final fit; inertia, gain and the sensor's zero are fitted anew beside each
# friction. It stands on the low band, in which what is left of the delays is harmless.
def bench_ladder(stretches: tuple[Signals, ...], result: FitResult) -> tuple[Rung, ...]:
    """Every model that needs nothing but the motion, symmetric where it remembers.

    Empty where no torque was measured, or torque does not tell the scale: there is nothing to compare by.
    """
    if result.ratios_only or any(stretch.torque_nm is None for stretch in stretches):
        return ()
    equation = bench_equation(stretches, result)
    # Asymmetric elements by the dozen would take longer than all others together.
    quick = [model for model in family_for(equation.path) if not (isinstance(model, Asymmetric) and model.memory)]
    return ladder(equation, quick)


def bench_equation(stretches: tuple[Signals, ...], result: FitResult) -> Equation:
    """Torque at the port under the measured motion, with friction left open."""
    shape = Shape(
        result.network.amplifier_bandwidth_rad_s,
        result.network.presliding_stiffness_nm_rad / result.network.coulomb_torque_nm,
        result.command_delay_s,
        result.motion_delay_s,
    )
    regression = Regression.of(stretches, LOW_BAND, STRIDE)
    known = regression.chosen([np.stack([rows.lag(shape), -rows.kinematics(shape)[1]]) for rows in regression.rows])
    bias = regression.bias()
    path = _path(stretches)
    ends = [*path.starts, path.position.size]

    def process(rows: FloatArray) -> FloatArray:
        """The low-pass that torque and motion have passed too."""
        spans = zip(regression.rows, pairwise(ends), strict=True)
        parts = [part.of_tick_signals(rows[:, first:end], shape.motion_delay_s) for part, (first, end) in spans]
        return regression.chosen(parts)

    return Equation(
        target=regression.target(),
        others=np.concatenate([known, bias]),
        names=("torque_gain", "inertia", *(f"offset_{knot + 1}" for knot in range(len(bias)))),
        path=path,
        fold=blocked_folds(known.shape[1]),
        time_s=regression.time_s(),
        process=process,
    )


def _path(stretches: tuple[Signals, ...]) -> Path:
    positions = [np.ascontiguousarray(stretch.path_rad[::FINE]) for stretch in stretches]
    lengths = [len(position) for position in positions]
    tick_s = stretches[0].tick_s
    return Path(
        dt_s=tick_s,
        position=np.concatenate(positions),
        velocity=np.concatenate([np.gradient(position, tick_s) for position in positions]),
        starts=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64),
    )
