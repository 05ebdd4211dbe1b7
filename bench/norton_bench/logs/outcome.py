"""What a fitted log has to say: estimates, errors on either side of the split, the ladder and the verdict."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.ladder import FrictionFit, Rung
from norton_bench.identification.results import Trace
from norton_bench.identification.verdict import words
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.doubts import astray
from norton_bench.logs.equation import Problem
from norton_bench.logs.estimates import doubted, estimates_of, loose, with_back_emf, without_scale
from norton_bench.logs.results import ErrorFigures, Errors, LogFit, Step
from norton_bench.models.parameters import Estimate, Status


@dataclass(frozen=True)
class Judged:
    """A fit of the equation of motion, and what was found wrong with its log.

    ``splits`` are the instants of each stretch to train and to test on; ``doubts`` make every estimate doubtful,
    ``remarks`` tell what was left out.
    """

    column_map: ColumnMap
    problem: Problem
    splits: tuple[tuple[BoolArray, BoolArray], ...]
    rungs: tuple[Rung, ...]
    chosen: Rung
    doubts: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def exertion_errors(self) -> list[ErrorFigures | None]:
        """In training and in test."""
        problem, residual = self.problem, self.chosen.fit.residual
        return [_exertion_error(problem, residual, rows, self.column_map) for rows in (problem.train, problem.test)]


def outcome(judged: Judged) -> LogFit:
    """As the equation of motion has it."""
    from norton_bench.logs.motion import motion_errors  # noqa: PLC0415  (compiled: slow to import)

    column_map, problem, fit = judged.column_map, judged.problem, judged.chosen.fit
    doubtful = bool(judged.doubts)
    estimates, verdict = _estimates(column_map, problem, fit, doubtful=doubtful)
    together = loose(fit, estimates)
    told = {name for direction in together for name in direction.names}
    untold = [estimate for estimate in estimates if estimate.name not in told]
    sentences = [*judged.doubts, *judged.remarks, *verdict, *map(words, together), *_uncertain(untold)]
    train, test = map(Errors, judged.exertion_errors, motion_errors(column_map, problem, fit, judged.splits))
    return LogFit(
        model=judged.chosen.name,
        estimates=estimates,
        verdict=tuple(dict.fromkeys(sentences)),
        converged=fit.converged,
        doubtful=doubtful,
        train=train,
        test=test,
        ladder=tuple(_step(column_map, problem, rung, doubtful=doubtful) for rung in judged.rungs),
        exertion=_trace(problem, fit, column_map),
    )


def refined(judged: Judged, asked: str | None) -> LogFit:
    """Refined on the motion itself; ``asked`` names the model, None the best."""
    from norton_bench.logs.refine import refine  # noqa: PLC0415  (compiled: slow to import)

    column_map, problem, fit = judged.column_map, judged.problem, judged.chosen.fit
    found = refine(column_map, problem, fit, judged.splits, asked, doubtful=bool(judged.doubts))
    doubts = (*judged.doubts, *astray(found.train))
    estimates = doubted(found.estimates) if doubts else found.estimates
    train, test = map(Errors, judged.exertion_errors, (found.train, found.test))
    return LogFit(
        model=found.model,
        estimates=estimates,
        verdict=tuple(dict.fromkeys([*doubts, *judged.remarks, *found.verdict, *_uncertain(estimates)])),
        converged=found.converged,
        doubtful=bool(doubts),
        train=train,
        test=test,
        ladder=tuple(replace(step, estimates=doubted(step.estimates)) if doubts else step for step in found.ladder),
        exertion=_trace(problem, fit, column_map),
    )


def _estimates(
    column_map: ColumnMap, problem: Problem, fit: FrictionFit, *, doubtful: bool
) -> tuple[tuple[Estimate, ...], list[str]]:
    """The fit's values as a user wants them, and what is to be said of them."""
    estimates = estimates_of(fit, column_map.units, problem.exertion_rms, doubtful=doubtful)
    verdict: list[str] = []
    log = problem.stretches[0].log
    if column_map.actuator.voltage_driven:
        gain = log.given("actuator", "torque_gain")
        estimates, said = with_back_emf(estimates, log.given("actuator", "resistance"), gain)
        verdict.append(said)
    if not problem.scaled:
        estimates, said = without_scale(estimates, column_map.units)
        verdict.append(said)
    elif log.given("actuator", "torque_gain") is not None and "exertion" not in log.columns:
        verdict.append("No torque was measured: the scale of every exertion is that of the torque gain given.")
    if not fit.converged:
        verdict.append("The fit did not converge: treat every number as provisional, and use a longer log.")
    return estimates, verdict


def _uncertain(estimates: Sequence[Estimate]) -> list[str]:
    sentences = []
    for status, what in (
        (Status.UNEXCITED, "The data hardly excite {}: {} uncertain by more than half of the value."),
        (Status.AT_BOUND, "At the edge of what was searched: {}; {} no estimate."),
    ):
        names = [estimate.name.replace("_", " ") for estimate in estimates if estimate.status is status]
        if names:
            sentences.append(what.format(", ".join(names), "it is" if len(names) == 1 else "they are"))
    return sentences


def _exertion_error(
    problem: Problem, residual: FloatArray, rows: BoolArray, column_map: ColumnMap
) -> ErrorFigures | None:
    if not problem.scaled or not rows.any():
        return None
    scale = float(np.sqrt(np.mean(problem.exertion[rows] ** 2)))
    return ErrorFigures.of(residual[rows], scale, column_map.units.exertion)


def _step(column_map: ColumnMap, problem: Problem, rung: Rung, *, doubtful: bool) -> Step:
    scale = problem.exertion_rms
    estimates, _ = _estimates(column_map, problem, rung.fit, doubtful=doubtful)
    return Step(
        rung.name,
        rung.train_rms / scale,
        rung.held_out_rms / scale,
        rung.held_out_std / scale,
        rung.selected,
        estimates,
    )


def _trace(problem: Problem, fit: FrictionFit, column_map: ColumnMap) -> Trace:
    exertion = problem.exertion
    return Trace(problem.equation.time_s, exertion, exertion - problem.side * fit.residual, column_map.units.exertion)
