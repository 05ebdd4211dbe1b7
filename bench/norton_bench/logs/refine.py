"""From the equation of motion to the motion itself: the fit of a log, refined until its simulation follows the log.

The equation of motion needs derivatives of a quantised position, and a servo that sticks, brakes and saturates strains
it. Where the map asks for it (``refine = "motion"``), its answer is only where the search begins.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import BoolArray
from norton_bench.errors import ExperimentError, UsageError, nearest
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.statistics import LEAST_GAIN, held_out_rms
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.equation import Problem
from norton_bench.logs.log_units import Units
from norton_bench.logs.results import UNEXCITED_BEYOND, ErrorFigures, Step
from norton_bench.logs.servo import LADDER, UNITS, Box, FittedLogs, ServoFit, ServoLog, ServoModel, fit_servo
from norton_bench.models.parameters import Estimate, Status

# Resistance between the supply and the switches that is reckoned with, over the winding's.
SOURCE_SHARE = 0.3
# A box reaches this many times its scale.
REACH = 20.0
LARGEST_COEFFICIENT = 2.0
# Beyond it the map has the wrong zero, and has to name it.
LARGEST_ZERO_RAD = 0.5
# A fit that errs more on what it has not seen than this many times what it errs in training, and more than this share
# of the spread, is one of many that the training data allow.
OVERFITTED = 3.0
FORETOLD = 0.1
# Of the squared error in training: where another law leaves less than this share, these logs do not say which is right.
RIVAL = 0.5


# The ladder of servos: each is fitted to some of the logs and judged on those that it has not seen.
@dataclass(frozen=True)
class Beginning:
    """What the equation of motion says, in SI: gain per volt (or ampere), damping with back-EMF, and scales.

    ``gravity`` is that of a load whose angle at rest the map does not give; 0 if there is none.
    """

    gain: float
    inertia: float
    damping: float
    coulomb: float
    offset: float
    gravity: float
    exertion_rms: float
    velocity_rms: float
    on_voltage: bool
    switched: bool


@dataclass(frozen=True)
class ServoRung:
    """One model. Errors are rms of whole logs, over the spread of the positions.

    ``rivals`` are models that leave far less in training.
    """

    fit: ServoFit
    train_relative: float
    held_out_relative: float
    held_out_std: float
    selected: bool = False
    rivals: tuple[str, ...] = ()

    @property
    def predicts(self) -> bool:
        """Whether what is fitted to one part of the logs holds for another."""
        return self.held_out_relative <= max(OVERFITTED * self.train_relative, FORETOLD)


def servo_ladder(trial: FittedLogs, begin: Beginning, models: Sequence[ServoModel] = LADDER) -> tuple[ServoRung, ...]:
    """Every model, each also started from the one before it.

    Selected is the one that errs least on what was held out, where every number costs ``LEAST_GAIN`` of the error.
    Folds are too few, and what sticks in one of them too rough, for a standard error between models to mean much.
    """
    lengths_s = piece_lengths_s(trial, begin)
    rungs: list[ServoRung] = []
    for model in models:
        starts = [start_of(begin), *(rung.fit.values for rung in rungs[-1:])]
        rungs.append(_in_pieces(trial, model, boxes_of(model, begin), starts, lengths_s))
    costs = [rung.held_out_relative * (1 + LEAST_GAIN) ** len(rung.fit.values) for rung in rungs]
    chosen = int(np.argmin(costs))
    return tuple(
        replace(rung, selected=index == chosen, rivals=_rivals(rung, rungs)) for index, rung in enumerate(rungs)
    )


def _rivals(rung: ServoRung, rungs: Sequence[ServoRung]) -> tuple[str, ...]:
    return tuple(each.fit.model.name for each in rungs if each.train_relative**2 < RIVAL * rung.train_relative**2)


def piece_lengths_s(trial: FittedLogs, begin: Beginning) -> tuple[float, ...]:
    """One swing of the motion, two, four, and so on to the longest log as a whole."""
    swing_s = 2 * np.pi * trial.spread / begin.velocity_rms
    longest_s = max(
        float(np.ptp(log.inputs.time_s[rows])) for log, rows in zip(trial.logs, trial.chosen, strict=True) if rows.any()
    )
    doublings = max(int(np.ceil(np.log2(longest_s / swing_s))), 0)
    return tuple(swing_s * 2.0**power for power in range(doublings + 1))


def _in_pieces(
    trial: FittedLogs,
    model: ServoModel,
    boxes: Mapping[str, Box],
    starts: Sequence[Mapping[str, float]],
    lengths_s: Sequence[float],
) -> ServoRung:
    """Fitted to pieces that each begin as measured (multiple shooting; Bock 1983), of the length that foretells best.

    A short piece stays near the log, so that its error is smooth in the parameters; a long one shows what adds up. Each
    length is searched from where the one before it led, too. Of lengths that foretell as well as the best, but for
    ``LEAST_GAIN``, the longest is used.
    """
    folds = held_out(trial)
    rungs: list[ServoRung] = []
    for longest_s in lengths_s:
        so_far = [rung.fit.values for rung in rungs[-1:]]
        fit = fit_servo(trial.pieces(longest_s), model, boxes, [*starts, *so_far])
        rungs.append(_judged(trial, folds, fit, boxes, longest_s))
    least = min(rung.held_out_relative for rung in rungs)
    return next(rung for rung in reversed(rungs) if rung.held_out_relative <= (1 + LEAST_GAIN) * least)


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
    if begin.gravity:
        # A pendulum does not hang exactly at the encoder's zero; a constant torque differs from that at larger angles.
        boxes["gravity_zero"] = Box(size / abs(begin.gravity), -LARGEST_ZERO_RAD, LARGEST_ZERO_RAD)
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
        "gravity_zero": 0.0,
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


def held_out(trial: FittedLogs) -> tuple[tuple[BoolArray, ...], ...]:
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


def _judged(
    trial: FittedLogs,
    folds: Sequence[tuple[BoolArray, ...]],
    fit: ServoFit,
    boxes: Mapping[str, Box],
    longest_s: float,
) -> ServoRung:
    squares: list[float] = []
    others: list[ServoFit] = []
    for fold in folds:
        rest = tuple(rows & ~out for rows, out in zip(trial.chosen, fold, strict=True))
        pieces = FittedLogs(trial.logs, rest).pieces(longest_s)
        others.append(fit_servo(pieces, fit.model, boxes, [fit.values], scattered=0, hops=0))
        unseen = FittedLogs(trial.logs, fold).each(others[-1].values)
        squares += [float(np.mean(error[out] ** 2)) for error, out in zip(unseen, fold, strict=True) if out.any()]
    fit = replace(fit, deviations=_widened(fit, others))
    train = float(np.sqrt(np.mean(trial.errors(fit.values) ** 2)))
    rms, std = held_out_rms(squares)
    return ServoRung(fit, train / trial.spread, rms / trial.spread, std / trial.spread)


def _widened(fit: ServoFit, others: Sequence[ServoFit]) -> dict[str, float]:
    """Deviations that hold the disagreement of the folds (a jackknife): what the model lacks shows there."""
    wide = {}
    for name, deviation in fit.deviations.items():
        values = np.array([other.values[name] for other in others])
        jackknife = np.sqrt((len(others) - 1) / len(others) * np.sum((values - np.mean(values)) ** 2))
        wide[name] = max(deviation, float(jackknife))
    return wide


# Of its usual size: a parameter known to be smaller is known to be next to nothing.
SMALL = 0.1


@dataclass(frozen=True)
class Refined:
    """What the search came to; ``train`` and ``test`` are errors of the simulated position."""

    model: str
    estimates: tuple[Estimate, ...]
    converged: bool
    train: ErrorFigures | None
    test: ErrorFigures | None
    ladder: tuple[Step, ...]
    verdict: tuple[str, ...]


def refine(column_map: ColumnMap, problem: Problem, fit: FrictionFit, asked: str | None, *, doubtful: bool) -> Refined:
    """``fit`` is of the equation of motion; ``asked`` names one model, None the best of those of the map.

    Raises UsageError for a model that there is not, ExperimentError where the fit gives nothing to begin with.
    """
    models = _models(column_map, asked)
    begin = beginning(column_map, problem, fit)
    logs = tuple(ServoLog.of(stretch, translation=column_map.translation) for stretch in problem.stretches)
    train, test = (FittedLogs(logs, tuple(split[side] for split in problem.readings.splits)) for side in (0, 1))
    rungs = servo_ladder(train, begin, models)
    chosen = next(rung for rung in rungs if (rung.selected if asked is None else rung.fit.model.name == asked))
    units = column_map.units
    steps = tuple(_step(rung, begin, units, doubtful=doubtful) for rung in rungs)
    return Refined(
        model=chosen.fit.model.name,
        estimates=_estimates(chosen, begin, units, doubtful=doubtful),
        converged=chosen.fit.converged,
        train=_figures(train, chosen.fit, units.motion),
        test=_figures(test, chosen.fit, units.motion),
        ladder=steps,
        verdict=(*_verdict(chosen), *_begun(problem)),
    )


def _models(column_map: ColumnMap, asked: str | None) -> tuple[ServoModel, ...]:
    by_name = {model.name: model for model in LADDER}
    for name in (*column_map.model.candidates, *((asked,) if asked is not None else ())):
        if name not in by_name:
            raise UsageError(f'a servo\'s motion is not simulated with friction "{name}"; {nearest(name, by_name)}')
    candidates = column_map.model.candidates or tuple(by_name)
    return tuple(model for model in LADDER if model.name in (*candidates, asked))


def beginning(column_map: ColumnMap, problem: Problem, fit: FrictionFit) -> Beginning:
    """Raises ExperimentError where the drive is found to push backwards, or not at all."""
    known = dict(zip(fit.names, fit.values.tolist(), strict=True))
    gain = problem.stretches[0].log.given("actuator", "torque_gain") or known["torque_gain"]
    velocity_rms = problem.equation.path.velocity_scale
    exertion_rms = float(np.sqrt(np.mean(problem.exertion[problem.train] ** 2)))
    if not gain > 0:
        raise ExperimentError(
            f"{problem.stretches[0].log.place}: the drive seems to push against its command; check the signs of "
            "command and position, and bits of a number that is written unsigned"
        )
    # A scale is never nothing: an estimate may be, or below.
    damping = max(known.get("viscous_damping", 0.0), SMALL * exertion_rms / velocity_rms)
    given = problem.stretches[0].log.given
    load = given("load", "inertia") or 0.0
    hangs = not column_map.translation and given("load", "gravity_zero") is None
    return Beginning(
        gain=gain,
        inertia=max(known.get("inertia", 0.0), SMALL * load),
        damping=damping,
        coulomb=max(known.get("coulomb_torque", 0.0), 0.0),
        offset=known.get("offset", 0.0),
        gravity=(given("load", "gravity") or 0.0) if hangs else 0.0,
        exertion_rms=exertion_rms,
        velocity_rms=velocity_rms,
        on_voltage=column_map.actuator.voltage_driven,
        switched=column_map.columns.supply is not None,
    )


def _estimates(rung: ServoRung, begin: Beginning, units: Units, *, doubtful: bool) -> tuple[Estimate, ...]:
    fit, boxes = rung.fit, boxes_of(rung.fit.model, begin)
    return tuple(
        Estimate(
            _public_name(name, begin),
            value,
            fit.deviations[name],
            _unit(name, begin, units),
            _status(name, rung, boxes[name].scale, doubtful=doubtful),
        )
        for name, value in fit.values.items()
    )


def _public_name(name: str, begin: Beginning) -> str:
    return "torque_gain" if name == "torque_constant" and not begin.on_voltage else name


def _unit(name: str, begin: Beginning, units: Units) -> str:
    if name == "torque_constant" and not begin.on_voltage:
        return units.gain
    return UNITS[name][0 if units.motion == "rad" else 1]


def _status(name: str, rung: ServoRung, scale: float, *, doubtful: bool) -> Status:
    fit = rung.fit
    if doubtful:
        return Status.DOUBTFUL
    if not fit.converged:
        return Status.NOT_CONVERGED
    if name in fit.at_bound:
        return Status.AT_BOUND
    sure = fit.deviations[name] <= UNEXCITED_BEYOND * max(abs(fit.values[name]), SMALL * scale)
    return Status.VALID if sure and rung.predicts and not rung.rivals else Status.UNEXCITED


def _figures(trial: FittedLogs, fit: ServoFit, unit: str) -> ErrorFigures | None:
    if not any(rows.any() for rows in trial.chosen):
        return None
    return ErrorFigures.of(trial.errors(fit.values), trial.spread, unit)


def _step(rung: ServoRung, begin: Beginning, units: Units, *, doubtful: bool) -> Step:
    return Step(
        model=rung.fit.model.name,
        train_relative=rung.train_relative,
        held_out_relative=rung.held_out_relative,
        held_out_std=rung.held_out_std,
        selected=rung.selected,
        estimates=_estimates(rung, begin, units, doubtful=doubtful),
    )


def _begun(problem: Problem) -> tuple[str, ...]:
    """What becomes of a gain that the map gives."""
    if problem.terms[0].gain is None:
        return ()
    return (
        "[actuator] torque_gain is only where the search begins: the known load gives the scale, and the gain too.",
    )


def _verdict(rung: ServoRung) -> tuple[str, ...]:
    sentences = ["The parameters are those whose simulated motion is nearest to the logged one."]
    fit = rung.fit
    if not rung.predicts:
        sentences.append(
            "They do not predict what was held out: many others would follow these logs as well; use more logs, and "
            "several gains of the loop."
        )
    elif rung.rivals:
        sentences.append(
            f"With {', '.join(rung.rivals)} less than half of the squared error is left in training: these logs do not "
            "say which friction is right, and no number is sure; use more and longer logs."
        )
    if "source_resistance" in fit.values:
        sentences.append(
            "The source's resistance acts for the share of time that the supply is connected; it stands for all that "
            "weakens the drive as that share grows."
        )
    if not fit.converged:
        sentences.append("The search did not settle: treat every number as provisional, and use a longer log.")
    return tuple(sentences)
