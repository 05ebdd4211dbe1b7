"""What a fitted log has to say: estimates, errors on either side of the split, the ladder and the verdict."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.ladder import FrictionFit, Rung, held, selected
from norton_bench.identification.results import Trace, words
from norton_bench.logs.alarms import alarms, alarms_of_motion
from norton_bench.logs.basic_equation import SIGNIFICANT, UNEXPLAINED
from norton_bench.logs.between import Compared, Part, of_logs, of_quarters, widened
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.delays import SHIFT
from norton_bench.logs.equation import Problem
from norton_bench.logs.estimate import Estimated
from norton_bench.logs.link import spring_of
from norton_bench.logs.near_rest import NearRest
from norton_bench.logs.predictions import predictions
from norton_bench.logs.results import (
    ErrorFigures,
    Errors,
    LogFit,
    Step,
    as_doubtful,
    as_inadequate,
    back_emf_damping,
    estimates_of,
    inadequate,
    loose,
    with_back_emf,
    without_scale,
)
from norton_bench.logs.sanity_checks import astray
from norton_bench.logs.simulated_motion import motion_errors
from norton_bench.logs.totals import totals
from norton_bench.models.parameters import Estimate, Status

# A column that holds what is applied until the next sample belongs to the middle of the interval.
HALF_A_SAMPLE = 0.5
# The weight, and the share of the rows, from which on rows near rest are spoken of.
HALF = 0.5
WORTH_SAYING = 0.01


@dataclass(frozen=True)
class Judged:
    """A fit of the equation of motion, and what was found wrong with its log.

    ``apart`` are fits of each training log alone, where there are several. ``doubts`` make every estimate doubtful,
    ``remarks`` tell what was left out.
    """

    column_map: ColumnMap
    fitted: Estimated
    apart: tuple[Part, ...]
    doubts: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def problem(self) -> Problem:
        return self.fitted.problem

    @property
    def chosen(self) -> Rung:
        return self.fitted.chosen

    @property
    def best(self) -> Rung:
        """Of all laws, whichever was asked for."""
        return selected(self.fitted.rungs)

    def fitted_to(self, rung: Rung) -> Problem:
        """The equation that one law was fitted to."""
        return self.problem if rung.name == self.chosen.name else self.fitted.compared

    @property
    def exertion_errors(self) -> list[ErrorFigures | None]:
        """In training and in test."""
        problem, residual = self.problem, self.chosen.fit.residual
        return [_exertion_error(problem, residual, rows, self.column_map) for rows in (problem.train, problem.test)]

    def outdone(self, rung: Rung) -> bool:
        """Whether the law that was selected leaves so much less on held-out parts that this one does not hold."""
        return not held(rung, self.best)


def outcome(judged: Judged) -> LogFit:
    """As the equation of motion has it."""
    column_map, problem, whole = judged.column_map, judged.problem, judged.chosen.fit
    parts = of_logs(problem, whole, judged.apart) if judged.apart else of_quarters(problem, whole)
    fit = widened(whole, parts)
    predicted = predictions(problem, fit, column_map.units.exertion if problem.scaled else column_map.units.drive)
    wrong = alarms(problem, judged.chosen, column_map.units, predicted.deviation)
    estimates, total, verdict = _figures(judged, fit, parts)
    together = loose(fit, estimates)
    told = {name for direction in together for name in direction.names}
    untold = [estimate for estimate in estimates if estimate.name not in told]
    spring, message = spring_of(problem, fit, column_map.units.link, believed=not judged.doubts)
    said = [
        *judged.doubts,
        *wrong,
        *_outdone(judged),
        *_open(judged),
        *judged.remarks,
        *verdict,
        *_of_result(problem, total, estimates, column_map),
        parts.sentence,
        *message,
        *map(words, together),
        *_uncertain([*untold, *spring]),
    ]
    train, test = map(Errors, judged.exertion_errors, motion_errors(column_map, problem, fit))
    return LogFit(
        model=judged.chosen.name,
        estimates=(*estimates, *spring),
        verdict=tuple(dict.fromkeys([*said, *_runs_away(train.motion)])),
        converged=fit.converged,
        doubtful=bool(judged.doubts),
        train=train,
        test=test,
        ladder=tuple(_step(judged, rung) for rung in judged.fitted.rungs),
        exertion=_trace(problem, fit, column_map),
        totals=total if problem.scaled else (),
        alarms=wrong,
        between=parts,
        predictions=predicted,
    )


def _figures(
    judged: Judged, fit: FrictionFit, parts: Compared
) -> tuple[tuple[Estimate, ...], tuple[Estimate, ...], list[str]]:
    """The estimates, the totals of friction, and what is to be said of both.

    Of several logs that differ, what they ask for together is a value that none of them has.
    """
    estimates, verdict = _estimates(judged, judged.chosen, fit)
    total = _totals(judged, fit)
    if parts.of_none & {term.name for term in judged.chosen.model.terms}:
        total = tuple(map(inadequate, total))
    return tuple(inadequate(each) if each.name in parts.of_none else each for each in estimates), total, verdict


def _of_result(
    problem: Problem, totals: Sequence[Estimate], estimates: Sequence[Estimate], column_map: ColumnMap
) -> Iterator[str]:
    """What the values as they are give reason to say."""
    if not problem.scaled:
        yield from _ratios(totals, column_map.units.drive)
    yield from _late(estimates, problem)
    yield from _near_rest(problem)


def refined(judged: Judged, asked: str | None) -> LogFit:
    """Refined on the motion itself; ``asked`` names the model, None the best."""
    from norton_bench.logs.refine import refine  # noqa: PLC0415  (compiled: slow to import)

    column_map, problem, fit = judged.column_map, judged.problem, judged.chosen.fit
    result = refine(column_map, problem, fit, asked, doubtful=bool(judged.doubts))
    doubts = (*judged.doubts, *astray(result.train))
    estimates = as_doubtful(result.estimates) if doubts else result.estimates
    train, test = map(Errors, judged.exertion_errors, (result.train, result.test))
    wrong = alarms_of_motion(result.test, result.ladder)
    return LogFit(
        model=result.model,
        estimates=estimates,
        verdict=tuple(dict.fromkeys([*doubts, *wrong, *judged.remarks, *result.verdict, *_uncertain(estimates)])),
        converged=result.converged,
        doubtful=bool(doubts),
        train=train,
        test=test,
        ladder=tuple(
            replace(step, estimates=as_doubtful(step.estimates)) if doubts else step for step in result.ladder
        ),
        exertion=_trace(problem, fit, column_map),
        alarms=wrong,
    )


def _outdone(judged: Judged) -> Iterator[str]:
    chosen, best = judged.chosen, judged.best
    if judged.outdone(chosen):
        left, least = (rung.held_out_rms / judged.problem.exertion_rms for rung in (chosen, best))
        yield (
            f"{chosen.name} does not describe this friction: on held-out parts it leaves {left:.2%} of the exertion, "
            f"and {best.name} {least:.2%}. Its values, delays too, stand for what it lacks."
        )


def _open(judged: Judged) -> Iterator[str]:
    """The simplest law with a term more than the chosen one that is no better on held-out parts, though the term is
    surely there if the law is right."""
    chosen = judged.chosen
    known = {term.name for term in chosen.model.terms}
    for rung in sorted(judged.fitted.rungs, key=lambda each: len(each.fit.names)):
        more = [term.name for term in rung.model.terms if term.name not in known]
        contained = known < {term.name for term in rung.model.terms}
        if not contained or rung.held_out_rms > chosen.held_out_rms + chosen.held_out_std:
            continue
        sure = [each for each in _estimates(judged, rung, rung.fit)[0] if each.name in more and _beyond_zero(each)]
        if sure:
            told = " and ".join(
                f"{each.name.replace('_', ' ')} {each.value:.3g} ± {each.half_interval:.2g} {each.unit}".rstrip()
                for each in sure
            )
            yield (
                f"{rung.name} would have {told}, and is no better than {chosen.name} on held-out parts: whether this "
                "friction has it is open. A longer log, or more motion where it shows, would tell."
            )
            return


def _beyond_zero(estimate: Estimate) -> bool:
    """Beyond accident, although several laws are looked at."""
    return estimate.status is Status.VALID and abs(estimate.value) > SIGNIFICANT * estimate.std


def _totals(judged: Judged, fit: FrictionFit) -> tuple[Estimate, ...]:
    """Of the chosen law, which may be outdone by another one."""

    def of(problem: Problem, each: FrictionFit) -> tuple[Estimate, ...]:
        back_emf = _back_emf(judged.column_map, problem, each)
        return totals(problem, each, judged.column_map.units, back_emf=back_emf, believed=not judged.doubts)

    result, best = of(judged.problem, fit), judged.best
    if not judged.outdone(judged.chosen):
        return result
    return as_inadequate(result, _by_name(of(judged.fitted_to(best), best.fit)))


def _ratios(total: Sequence[Estimate], drive: str) -> Iterator[str]:
    """Total friction where only its ratio to the torque gain is known."""
    if all(each.status is Status.VALID for each in total):
        told = " and ".join(
            f"{each.name.removeprefix('total_')} {each.value:.4g} ± {each.half_interval:.2g}" for each in total
        )
        unit = drive or "unit of command"
        yield f"In total, in steady sliding, friction is {told} times the torque gain (per {unit})."


def _by_name(estimates: Sequence[Estimate]) -> dict[str, Estimate]:
    return {each.name: each for each in estimates}


def _estimates(judged: Judged, rung: Rung, fit: FrictionFit) -> tuple[tuple[Estimate, ...], list[str]]:
    """The values of a law as a user wants them, and what is to be said of them; ``fit`` is that of the rung, or the
    same with wider deviations."""
    column_map, problem, best = judged.column_map, judged.fitted_to(rung), judged.best
    estimates = estimates_of(problem, fit, column_map.units, doubtful=bool(judged.doubts))
    if judged.outdone(rung):
        right = estimates_of(judged.fitted_to(best), best.fit, column_map.units, doubtful=False)
        same = {name: each for name, each in _by_name(right).items() if name in problem.equation.names}
        estimates = as_inadequate(estimates, same)
    verdict: list[str] = []
    log = problem.stretches[0].log
    if column_map.actuator.voltage_driven:
        gain = log.given("actuator", "torque_gain")
        estimates, message = with_back_emf(estimates, log.given("actuator", "resistance"), gain)
        verdict.append(message)
    if not problem.scaled:
        estimates, message = without_scale(estimates, column_map.units)
        verdict.append(message)
    elif log.given("actuator", "torque_gain") is not None and "exertion" not in log.columns:
        verdict.append("Nothing measures the torque at the port: its scale is that of the torque gain given.")
    if not fit.converged:
        verdict.append("The fit did not converge: treat every number as provisional, and use a longer log.")
    return estimates, verdict


def _back_emf(column_map: ColumnMap, problem: Problem, fit: FrictionFit) -> float:
    """Its damping, where the resistance tells it from that of friction; else 0."""
    resistance_ohm = problem.stretches[0].log.given("actuator", "resistance")
    if not column_map.actuator.voltage_driven or resistance_ohm is None:
        return 0.0
    known = problem.stretches[0].log.given("actuator", "torque_gain")
    return back_emf_damping(known or fit.value("torque_gain"), resistance_ohm)


def _late(estimates: Sequence[Estimate], problem: Problem) -> Iterator[str]:
    """Delays that are surely more than half a sample."""
    for estimate in estimates:
        if not estimate.name.endswith(SHIFT) or estimate.status is not Status.VALID:
            continue
        if abs(estimate.value) - estimate.half_interval > HALF_A_SAMPLE * problem.filters.dt_s:
            yield (
                f"{estimate.name.removesuffix(SHIFT)} is logged {1e3 * abs(estimate.value):.3g} ± "
                f"{1e3 * estimate.half_interval:.2g} ms {'earlier' if estimate.value > 0 else 'later'} than the motion "
                "it goes with; that is reckoned with, and no friction."
            )


def _near_rest(problem: Problem) -> Iterator[str]:
    """For how long the log is near rest, if rows are trained on that count for less than half because of it."""
    if np.mean(problem.equation.scale[problem.train] ** 2 < HALF) > WORTH_SAYING:
        share = float(np.mean(NearRest.of(problem).share[problem.train]))
        yield (
            f"Near rest, {share:.0%} of the time, friction is not what the law says of its velocity: it sticks, or "
            "turns round between two samples. Rows that hold such instants count for less."
        )


def _runs_away(motion: ErrorFigures | None) -> Iterator[str]:
    """A motion that was not fitted to, and is not foretold."""
    if motion is not None and motion.relative > UNEXPLAINED:
        yield (
            f"The simulated motion differs from the logged one by {motion.relative:.0%} of its spread: where nothing "
            "holds a position, small errors of a torque add up; a load that hangs needs its gravity, and gravity_zero."
        )


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


def _step(judged: Judged, rung: Rung) -> Step:
    scale = judged.problem.exertion_rms
    estimates, _ = _estimates(judged, rung, rung.fit)
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
