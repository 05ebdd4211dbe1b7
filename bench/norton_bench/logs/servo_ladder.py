"""The ladder of servos: each is fitted to some of the logs and judged on those that it has not seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import BoolArray
from norton_bench.identification.held_out import held_out_rms, simplest_as_good
from norton_bench.logs.servo import LADDER, ServoModel
from norton_bench.logs.servo_fit import Box, ServoFit, Trial, fit_servo

# Resistance between the supply and the switches that is reckoned with, over the winding's.
SOURCE_SHARE = 0.3
# A box reaches this many times its scale.
REACH = 20.0
LARGEST_COEFFICIENT = 2.0
# A fit that errs more on what it has not seen than this many times what it errs in training, and more than this share
# of the spread, is one of many that the training data allow.
OVERFITTED = 3.0
FORETOLD = 0.1


@dataclass(frozen=True)
class Beginning:
    """What the equation of motion says, in SI: gain per volt (or ampere), damping with back-EMF, and scales."""

    gain: float
    inertia: float
    damping: float
    coulomb: float
    offset: float
    exertion_rms: float
    velocity_rms: float
    on_voltage: bool
    switched: bool


@dataclass(frozen=True)
class ServoRung:
    """One model. Errors are rms, over the spread of the positions; ``fold_mean_squares`` one for each log held out."""

    fit: ServoFit
    train_relative: float
    held_out_relative: float
    held_out_std: float
    fold_mean_squares: tuple[float, ...]
    selected: bool = False

    @property
    def foretells(self) -> bool:
        """Whether what is fitted to one part of the logs holds for another."""
        return self.held_out_relative <= max(OVERFITTED * self.train_relative, FORETOLD)


def servo_ladder(trial: Trial, begin: Beginning, models: Sequence[ServoModel] = LADDER) -> tuple[ServoRung, ...]:
    """Every model, each also started from the one before it; ``simplest_as_good`` selects one."""
    folds = held_out(trial)
    rungs: list[ServoRung] = []
    for model in models:
        boxes = boxes_of(model, begin)
        starts = [start_of(begin), *(rung.fit.values for rung in rungs[-1:])]
        fit = fit_servo(trial, model, boxes, starts)
        rungs.append(_judged(trial, folds, fit, boxes))
    chosen = simplest_as_good([rung.fold_mean_squares for rung in rungs], [len(rung.fit.values) for rung in rungs])
    return tuple(replace(rung, selected=index == chosen) for index, rung in enumerate(rungs))


def boxes_of(model: ServoModel, begin: Beginning) -> dict[str, Box]:
    """What is searched, and where."""
    constant = begin.damping / begin.gain if begin.on_voltage else begin.gain
    wide = {"torque_constant": (constant, 1 / REACH)}
    if begin.on_voltage:
        wide["winding_resistance"] = (constant / begin.gain, 1 / REACH)
        if begin.switched:
            wide["source_resistance"] = (constant / begin.gain, 0.0)
    wide["inertia"] = (begin.inertia, 0.0)
    wide["viscous_damping"] = (begin.damping, 0.0)
    wide["coulomb_torque"] = (0.1 * begin.exertion_rms, 0.0)
    boxes = {name: Box(scale, low * scale, REACH * scale) for name, (scale, low) in wide.items()}
    size = 0.1 * begin.exertion_rms
    boxes["offset"] = Box(size, -REACH * size, REACH * size)
    extra = {
        "stribeck_torque": Box(size, 0.0, REACH * size),
        "stribeck_velocity": Box(begin.velocity_rms, 1e-2 * begin.velocity_rms, REACH * begin.velocity_rms),
        "load_coefficient": Box(0.2, 0.0, LARGEST_COEFFICIENT),
        "load_stiction_coefficient": Box(0.2, 0.0, LARGEST_COEFFICIENT),
    }
    return boxes | {name: extra[name] for name in model.extra}


def start_of(begin: Beginning) -> dict[str, float]:
    """A motor's damping is taken as mostly back-EMF, its resistance as partly the source's."""
    start = {
        "inertia": begin.inertia,
        "coulomb_torque": begin.coulomb,
        "offset": begin.offset,
        "stribeck_velocity": 0.3 * begin.velocity_rms,
        "load_coefficient": 0.2,
        "load_stiction_coefficient": 0.1,
    }
    if not begin.on_voltage:
        return start | {"torque_constant": begin.gain, "viscous_damping": begin.damping}
    constant = begin.damping / begin.gain
    resistance = constant / begin.gain
    share = SOURCE_SHARE if begin.switched else 0.0
    return start | {
        "torque_constant": constant,
        "winding_resistance": (1 - share) * resistance,
        "source_resistance": share * resistance,
        "viscous_damping": 0.1 * begin.damping,
    }


def held_out(trial: Trial) -> tuple[tuple[BoolArray, ...], ...]:
    """The samples of each fold. A loop's gain is held out where there are several: what a servo does at another gain
    is what its model is for. Else each log is, and of a single log each half."""
    gains = [log.loop.proportional for log, rows in zip(trial.logs, trial.chosen, strict=True) if rows.any()]
    if len(set(gains)) > 1:
        groups = [log.loop.proportional for log in trial.logs]
    elif len(gains) > 1:
        groups = [float(index) for index in range(len(trial.logs))]
    else:
        return tuple(zip(*(_halves(rows) for rows in trial.chosen), strict=True))
    used = dict.fromkeys(group for group, rows in zip(groups, trial.chosen, strict=True) if rows.any())
    return tuple(
        tuple(rows & (group == fold) for group, rows in zip(groups, trial.chosen, strict=True)) for fold in used
    )


def _halves(rows: BoolArray) -> tuple[BoolArray, BoolArray]:
    count = np.cumsum(rows)
    first = count <= count[-1] // 2
    return rows & first, rows & ~first


def _judged(trial: Trial, folds: Sequence[tuple[BoolArray, ...]], fit: ServoFit, boxes: Mapping[str, Box]) -> ServoRung:
    squares: list[float] = []
    others: list[ServoFit] = []
    for fold in folds:
        rest = tuple(rows & ~out for rows, out in zip(trial.chosen, fold, strict=True))
        others.append(fit_servo(Trial(trial.logs, rest), fit.model, boxes, [fit.values], scattered=0, hops=0))
        unseen = Trial(trial.logs, fold).each(others[-1].values)
        squares += [float(np.mean(error[out] ** 2)) for error, out in zip(unseen, fold, strict=True) if out.any()]
    fit = replace(fit, deviations=_widened(fit, others))
    train = float(np.sqrt(np.mean(trial.errors(fit.values) ** 2)))
    rms, std = held_out_rms(squares)
    return ServoRung(fit, train / trial.spread, rms / trial.spread, std / trial.spread, tuple(squares))


def _widened(fit: ServoFit, others: Sequence[ServoFit]) -> dict[str, float]:
    """Deviations that hold the disagreement of the folds (a jackknife): what the model lacks shows there."""
    wide = {}
    for name, deviation in fit.deviations.items():
        values = np.array([other.values[name] for other in others])
        jackknife = np.sqrt((len(others) - 1) / len(others) * np.sum((values - np.mean(values)) ** 2))
        wide[name] = max(deviation, float(jackknife))
    return wide
