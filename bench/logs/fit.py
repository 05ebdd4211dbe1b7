"""Foreign logs to a fit: read, checked, put on a grid, fitted by every model of friction, and predicted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bench.errors import UsageError
from bench.identification.friction.family import family_for
from bench.identification.friction.family import model as friction_model
from bench.identification.friction.model import FrictionModel
from bench.identification.ladder import FrictionFit, Rung, ladder, selected
from bench.identification.results import Trace
from bench.identification.verdict import words
from bench.logs.column_map import ColumnMap
from bench.logs.doubts import (
    Basic,
    ahead_of_goal,
    out_of_step,
    swapped,
    unexplained,
    unlike_derivative,
    variation,
    wrong_signs,
)
from bench.logs.equation import Problem, make_problem
from bench.logs.estimates import estimates_of, loose, with_back_emf, without_scale
from bench.logs.grid import Stretch, common_interval, stretches
from bench.logs.log import Log, read_log
from bench.logs.motion import motion_errors
from bench.logs.results import ErrorFigures, Errors, LogFit, Step
from bench.logs.rows import usable_rows
from bench.logs.split import Selection, extra_files, parse_selection, train_and_test
from bench.models.parameters import Estimate, Status

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

BEST = "best"
# What a refinement begins with.
FIRST_MODEL = "coulomb-viscous"


@dataclass(frozen=True)
class Request:
    """What is to be fitted. ``train`` and ``test`` as on the command line; ``model`` names one, or the best."""

    paths: tuple[Path, ...]
    column_map: ColumnMap
    train: str | None = None
    test: str | None = None
    model: str | None = None


def fit_logs(request: Request) -> LogFit:
    """Raises UsageError for files, maps and splits that cannot be used, ExperimentError for data that cannot be."""
    column_map = request.column_map
    train, test, paths = _split(request)
    logs = [_checked(path, column_map) for path in paths]
    _check_alike(logs)
    remarks: list[str] = [remark for log in logs for remark in log.remarks]
    parts, said = _on_grid(logs, column_map)
    remarks += said
    splits = _splits(parts, train, test)
    problem = make_problem(column_map, parts, splits)
    if request.test is not None and not problem.test.any():
        raise UsageError("--test: no row that is not trained on lies there; choose another part, or a narrower --train")
    rungs = ladder(problem.equation, _models(request, problem), problem.train)
    chosen = _chosen(request, rungs)

    def again(others: Sequence[Log]) -> Problem:
        moved, _ = _on_grid(others, column_map)
        return make_problem(column_map, moved, _splits(moved, train, test))

    doubts = _doubts(column_map, logs, problem, chosen, again)
    if column_map.model.refine is not None:
        return _refined(request, problem, chosen, doubts, remarks, splits)
    motion = motion_errors(column_map, problem, chosen.fit, splits)
    return _result(column_map, problem, rungs, chosen, doubts, remarks, motion)


def _split(request: Request) -> tuple[Selection | None, Selection | None, tuple[Path, ...]]:
    """What to train and to test on, and all logs. What the command line says replaces all that the map says.

    The map's own split is for the logs it was written with: where it names none of those given, all are fitted.
    """
    if request.train is None and request.test is None:
        split = request.column_map.split
        train, test = (_selection(text, f"{request.column_map.place}: [split]") for text in (split.train, split.test))
        known = train is None or not train.files or any(map(train.names, request.paths))
        return (train, test, request.paths) if known else (None, None, request.paths)
    train, test = _selection(request.train, "--train"), _selection(request.test, "--test")
    paths = (*request.paths, *extra_files(train, request.paths), *extra_files(test, request.paths))
    _check_files((train, test), paths)
    return train, test, paths


def _selection(text: str | None, where: str) -> Selection | None:
    return None if text is None else parse_selection(text, where)


def _check_files(selections: Sequence[Selection | None], paths: Sequence[Path]) -> None:
    for selection in selections:
        if selection is not None and selection.files and not any(map(selection.names, paths)):
            known = ", ".join(path.name for path in paths[:5])
            raise UsageError(f'--train, --test: no log is named "{", ".join(selection.files)}"; there are {known}')


def _checked(path: Path, column_map: ColumnMap) -> Log:
    return usable_rows(read_log(path, column_map))


def _check_alike(logs: Sequence[Log]) -> None:
    for log in logs[1:]:
        if set(log.columns) != set(logs[0].columns):
            odd = ", ".join(sorted(set(log.columns) ^ set(logs[0].columns)))
            raise UsageError(f"{log.place}: differs from {logs[0].place} in what it holds ({odd}); fit them apart")


def _on_grid(logs: Sequence[Log], column_map: ColumnMap) -> tuple[tuple[Stretch, ...], list[str]]:
    dt_s = common_interval(logs, column_map.log.rate_hz)
    parts: list[Stretch] = []
    remarks: list[str] = []
    for log in logs:
        found, said = stretches(log, dt_s, column_map.log.gap_s)
        parts += found
        remarks += said
    return tuple(parts), remarks


def _splits(
    parts: Sequence[Stretch], train: Selection | None, test: Selection | None
) -> list[tuple[BoolArray, BoolArray]]:
    return [train_and_test(train, test, Path(part.log.place), part.time_s) for part in parts]


def _models(request: Request, problem: Problem) -> tuple[FrictionModel, ...]:
    """The candidates of the map, or all that the log can tell, and the one that is asked for.

    What is refined afterwards only needs a place to begin.
    """
    if request.column_map.model.refine is not None:
        return (friction_model(FIRST_MODEL),)
    candidates = request.column_map.model.candidates
    models = tuple(map(friction_model, candidates)) or family_for(problem.equation.path)
    asked = request.model or request.column_map.model.friction
    if asked == BEST or asked in {member.name for member in models}:
        return models
    return (*models, friction_model(asked))


def _chosen(request: Request, rungs: Sequence[Rung]) -> Rung:
    asked = request.model or request.column_map.model.friction
    if asked == BEST or request.column_map.model.refine is not None:
        return selected(rungs)
    return next(rung for rung in rungs if rung.name == asked)


def _doubts(
    column_map: ColumnMap,
    logs: Sequence[Log],
    problem: Problem,
    chosen: Rung,
    again: Callable[[Sequence[Log]], Problem],
) -> tuple[str, ...]:
    basic = Basic.of(problem)
    left = chosen.train_rms / max(variation(problem), 1e-300)
    found = [
        *unlike_derivative(problem.stretches, problem.filters),
        *ahead_of_goal(problem.stretches, problem.filters),
    ]
    found = found or [*wrong_signs(basic, column_map)]
    found = found or [*out_of_step(problem, column_map), *unexplained(basic, left)]
    return (*found, *(swapped(logs, basic, again) if found else ()))


def _exertion_rms(problem: Problem) -> float:
    return float(np.sqrt(np.mean(problem.exertion[problem.train] ** 2)))


def _result(
    column_map: ColumnMap,
    problem: Problem,
    rungs: Sequence[Rung],
    chosen: Rung,
    doubts: tuple[str, ...],
    remarks: Sequence[str],
    motion: tuple[ErrorFigures | None, ErrorFigures | None],
) -> LogFit:
    fit, doubtful = chosen.fit, bool(doubts)
    estimates, verdict = _estimates(column_map, problem, fit, doubtful=doubtful)
    together = loose(fit, estimates)
    told = {name for direction in together for name in direction.names}
    untold = [estimate for estimate in estimates if estimate.name not in told]
    sentences = [*doubts, *remarks, *verdict, *map(words, together), *_uncertain(untold)]
    residual = fit.residual
    return LogFit(
        model=chosen.name,
        estimates=estimates,
        verdict=tuple(dict.fromkeys(sentences)),
        converged=fit.converged,
        doubtful=doubtful,
        train=Errors(_exertion_error(problem, residual, problem.train, column_map), motion[0]),
        test=Errors(_exertion_error(problem, residual, problem.test, column_map), motion[1]),
        ladder=tuple(_step(column_map, problem, rung, doubtful=doubtful) for rung in rungs),
        exertion=_trace(problem, fit, column_map),
    )


def _refined(
    request: Request,
    problem: Problem,
    chosen: Rung,
    doubts: tuple[str, ...],
    remarks: Sequence[str],
    splits: list[tuple[BoolArray, BoolArray]],
) -> LogFit:
    """The fit of the equation of motion, refined on the motion itself."""
    from bench.logs.refine import refine  # noqa: PLC0415  (compiled: slow to import)

    column_map, fit, doubtful = request.column_map, chosen.fit, bool(doubts)
    asked = request.model or column_map.model.friction
    found = refine(column_map, problem, fit, splits, None if asked == BEST else asked, doubtful=doubtful)
    train, test = (_exertion_error(problem, fit.residual, rows, column_map) for rows in (problem.train, problem.test))
    return LogFit(
        model=found.model,
        estimates=found.estimates,
        verdict=tuple(dict.fromkeys([*doubts, *remarks, *found.verdict, *_uncertain(found.estimates)])),
        converged=found.converged,
        doubtful=doubtful,
        train=Errors(train, found.train),
        test=Errors(test, found.test),
        ladder=found.ladder,
        exertion=_trace(problem, fit, column_map),
    )


def _estimates(
    column_map: ColumnMap, problem: Problem, fit: FrictionFit, *, doubtful: bool
) -> tuple[tuple[Estimate, ...], list[str]]:
    """The fit's values as a user wants them, and what is to be said of them."""
    estimates = estimates_of(fit, column_map.units, _exertion_rms(problem), doubtful=doubtful)
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
    scale = _exertion_rms(problem)
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
    return Trace(problem.equation.time_s, exertion, exertion - fit.residual, column_map.units.exertion)
