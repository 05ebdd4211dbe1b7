"""From the equation of motion to the motion itself: the fit of a log, refined until its simulation follows the log.

The equation of motion needs derivatives of a quantised position, and a servo that sticks, brakes and saturates strains
it. Where the map asks for it (``refine = "motion"``), its answer is only where the search begins.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import BoolArray
from norton_bench.errors import ExperimentError, UsageError
from norton_bench.identification.friction.fit import FrictionFit
from norton_bench.logs.column_map import ColumnMap, Units
from norton_bench.logs.equation import Problem
from norton_bench.logs.estimates import UNEXCITED_BEYOND
from norton_bench.logs.results import ErrorFigures, Step
from norton_bench.logs.servo import LADDER, UNITS, ServoLog, ServoModel
from norton_bench.logs.servo_fit import ServoFit, Trial
from norton_bench.logs.servo_ladder import Beginning, ServoRung, boxes_of, servo_ladder
from norton_bench.models.parameters import Estimate, Status
from norton_bench.rig.mistakes import nearest

Splits = Sequence[tuple[BoolArray, BoolArray]]

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


def refine(
    column_map: ColumnMap, problem: Problem, fit: FrictionFit, splits: Splits, asked: str | None, *, doubtful: bool
) -> Refined:
    """``fit`` is of the equation of motion; ``asked`` names one model, None the best of those of the map.

    Raises UsageError for a model that there is not, ExperimentError where the fit gives nothing to begin with.
    """
    models = _models(column_map, asked)
    begin = beginning(column_map, problem, fit)
    logs = tuple(ServoLog.of(stretch, translation=column_map.translation) for stretch in problem.stretches)
    train, test = (Trial(logs, tuple(split[side] for split in splits)) for side in (0, 1))
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
        verdict=_verdict(chosen),
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
    load = problem.stretches[0].log.given("load", "inertia") or 0.0
    return Beginning(
        gain=gain,
        inertia=max(known.get("inertia", 0.0), SMALL * load),
        damping=damping,
        coulomb=max(known.get("coulomb_torque", 0.0), 0.0),
        offset=known.get("offset", 0.0),
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
    return Status.VALID if sure and rung.foretells else Status.UNEXCITED


def _figures(trial: Trial, fit: ServoFit, unit: str) -> ErrorFigures | None:
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


def _verdict(rung: ServoRung) -> tuple[str, ...]:
    sentences = ["The parameters are those whose simulated motion is nearest to the logged one."]
    fit = rung.fit
    if not rung.foretells:
        sentences.append(
            "They do not foretell what was held out: many others would follow these logs as well; use more logs, and "
            "several gains of the loop."
        )
    if "source_resistance" in fit.values:
        sentences.append(
            "The source's resistance acts for the share of time that the supply is connected; it stands for all that "
            "weakens the drive as that share grows."
        )
    if not fit.converged:
        sentences.append("The search did not settle: treat every number as provisional, and use a longer log.")
    return tuple(sentences)
