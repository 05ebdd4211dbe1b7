"""Foreign logs to a fit: read, checked, put on a grid, fitted by every model of friction, and predicted."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.errors import ExperimentError, UsageError
from norton_bench.identification.friction_laws import FILMS, family_for
from norton_bench.identification.friction_laws import model as friction_model
from norton_bench.identification.friction_model import FrictionModel
from norton_bench.identification.ladder import Rung, held, selected
from norton_bench.logs import delays as late
from norton_bench.logs.basic_equation import Basic, variation
from norton_bench.logs.between import Part, trained_places
from norton_bench.logs.column_map import ColumnMap
from norton_bench.logs.equation import Problem, make_problem
from norton_bench.logs.estimate import Estimated, comparable, estimated
from norton_bench.logs.grid import Stretch, common_interval, stretches
from norton_bench.logs.log import Log, read_log, usable_rows
from norton_bench.logs.near_rest import NearRest
from norton_bench.logs.outcome import Judged, outcome, refined
from norton_bench.logs.readings import Readings
from norton_bench.logs.results import LogFit
from norton_bench.logs.sanity_checks import (
    ahead_of_goal,
    hanging,
    out_of_step,
    scales_apart,
    swapped,
    unexplained,
    unidentifiable_gain,
    unlike_derivative,
    unlike_link,
    wrong_columns,
    wrong_signs,
)
from norton_bench.units import NUMBER, parse_quantity

WINDOW = rf"({NUMBER})?\s*:\s*({NUMBER})?\s*([A-Za-zµμ]*)"
PART = re.compile(rf"\s*(?:(\S.*?)\s+)?{WINDOW}\s*")


# ``--train`` and ``--test``: parts of the time ("0:12.5 s, 20:30 s"), files by name or pattern, or both
# ("a*.csv 0:5 s").
@dataclass(frozen=True)
class Piece:
    """Part of the time of the files that a pattern names; all files, or all of the time, where one is not given."""

    pattern: str | None
    first_s: float = -float("inf")
    last_s: float = float("inf")

    def names(self, path: Path) -> bool:
        """Whether the pattern is that of the file, by its name or by its path."""
        each = self.pattern
        return each is None or path.match(each) or fnmatch(path.name, each) or fnmatch(str(path), each)


@dataclass(frozen=True)
class Selection:
    """What any of its pieces names; times are each log's own, in seconds."""

    pieces: tuple[Piece, ...]

    @property
    def files(self) -> tuple[str, ...]:
        """Every pattern."""
        return tuple(piece.pattern for piece in self.pieces if piece.pattern is not None)

    def of(self, path: Path, time_s: FloatArray) -> BoolArray:
        """Which instants of the log at ``path`` are chosen, shape (n,)."""
        chosen = np.zeros(time_s.shape, dtype=bool)
        for piece in self.pieces:
            if piece.names(path):
                chosen |= (time_s >= piece.first_s) & (time_s < piece.last_s)
        return chosen

    def names(self, path: Path) -> bool:
        """Whether any of the file can be chosen."""
        return any(piece.names(path) for piece in self.pieces)


def parse_selection(text: str, where: str) -> Selection:
    """Raises UsageError in a sentence; ``where`` is the option or key that says it."""
    written = [piece.strip() for piece in text.split(",") if piece.strip()]
    if not written:
        raise UsageError(f'{where}: is empty; write it like "0:12.5 s", or name files')
    matches = [PART.fullmatch(piece) for piece in written]
    unit = next((match[4] for match in reversed(matches) if match and match[4]), "s")
    pairs = zip(written, matches, strict=True)
    return Selection(tuple(Piece(text) if match is None else _part(match, unit, text, where) for text, match in pairs))


def _part(match: re.Match[str], unit: str, piece: str, where: str) -> Piece:
    try:
        first, last = (
            float(default) if written is None else parse_quantity(f"{written} {match[4] or unit}", "s")
            for written, default in ((match[2], "-inf"), (match[3], "inf"))
        )
    except ValueError as wrong:
        raise UsageError(f"{where}: {wrong}") from None
    if first >= last:
        raise UsageError(f'{where}: "{piece}" ends before it begins; write it like "0:12.5 s"')
    return Piece(match[1], first, last)


def extra_files(selection: Selection | None, paths: Sequence[Path]) -> tuple[Path, ...]:
    """Files that a selection names and that are not among the logs yet, in order."""
    result: list[Path] = []
    known = {path.resolve() for path in paths}
    for pattern in selection.files if selection else ():
        given = Path(pattern)
        matches = [given] if given.is_file() else sorted(given.parent.glob(given.name)) if given.name else []
        result += [path for path in matches if path.is_file() and path.resolve() not in known]
        known |= {path.resolve() for path in matches}
    return tuple(result)


def train_and_test(
    train: Selection | None, test: Selection | None, path: Path, time_s: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Which instants of a log are fitted and which are only predicted: what one leaves unsaid is the rest."""
    everything = np.ones(time_s.shape, dtype=bool)
    if train is None and test is None:
        return everything, ~everything
    if train is None:
        assert test is not None
        tested = test.of(path, time_s)
        return ~tested, tested
    trained = train.of(path, time_s)
    tested = ~trained if test is None else test.of(path, time_s)
    return trained, tested & ~trained


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


def fit_logs(request: Request, on_read: Callable[[], None] = lambda: None) -> LogFit:
    """``on_read`` is called once all files are read and found in order.

    Raises UsageError for files, maps and splits that cannot be used, ExperimentError for data that cannot be."""
    column_map = request.column_map
    train, test, paths = _split(request)
    logs = [_checked(path, column_map) for path in paths]
    _check_alike(logs)
    remarks: list[str] = [remark for log in logs for remark in log.remarks]
    parts, sentences = _on_grid(logs, column_map, train, test)
    remarks += sentences
    splits = _splits(parts, train, test)
    remarks += _overlap(parts, train, test)
    if request.test is not None and not any(split[1].any() for split in splits):
        longest_s = max(float(log.time_s[-1]) for log in logs)
        raise UsageError(
            f"--test: no row that is not trained on lies there, and the last row is at {longest_s:.4g} s; choose "
            "another part, or a narrower --train"
        )
    on_read()
    readings = Readings.of(column_map, parts, splits)
    result = _estimated(
        column_map, readings, lambda near: _models(request, near, remarks), lambda rungs: _chosen(request, rungs)
    )

    def readings_of(others: Sequence[Log]) -> Readings:
        moved, _ = _on_grid(others, column_map, train, test)
        return Readings.of(column_map, moved, _splits(moved, train, test))

    doubts = _doubts(column_map, logs, result, readings_of)
    apart = () if column_map.model.refine is not None else _each_log(column_map, result, readings)
    judged = Judged(column_map, result, apart, doubts, tuple(remarks))
    return outcome(judged) if column_map.model.refine is None else refined(judged, _asked(request))


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
        for piece in selection.pieces if selection is not None else ():
            if not any(map(piece.names, paths)):
                known = ", ".join(path.name for path in paths[:5])
                raise UsageError(f'--train, --test: no log is named "{piece.pattern}"; there are {known}')


def _checked(path: Path, column_map: ColumnMap) -> Log:
    return usable_rows(read_log(path, column_map))


def _check_alike(logs: Sequence[Log]) -> None:
    for log in logs[1:]:
        if set(log.columns) != set(logs[0].columns):
            odd = ", ".join(sorted(set(log.columns) ^ set(logs[0].columns)))
            raise UsageError(f"{log.place}: differs from {logs[0].place} in what it holds ({odd}); fit them apart")


def _on_grid(
    logs: Sequence[Log], column_map: ColumnMap, train: Selection | None, test: Selection | None
) -> tuple[tuple[Stretch, ...], list[str]]:
    """The interval is that of the logs trained on: what is only predicted has no influence."""
    trained = [log for log in logs if train_and_test(train, test, Path(log.place), log.time_s)[0].any()]
    dt_s = common_interval(trained or logs, column_map.log.rate_hz)
    parts: list[Stretch] = []
    remarks: list[str] = []
    for log in logs:
        result, message = stretches(log, dt_s, column_map.log.gap_s)
        parts += result
        remarks += message
    return tuple(parts), remarks


def _splits(
    parts: Sequence[Stretch], train: Selection | None, test: Selection | None
) -> list[tuple[BoolArray, BoolArray]]:
    return [train_and_test(train, test, Path(part.log.place), part.time_s) for part in parts]


def _overlap(parts: Sequence[Stretch], train: Selection | None, test: Selection | None) -> Iterator[str]:
    """Whether rows are named to be trained on and to be tested."""
    if train is None or test is None:
        return
    pairs = ((Path(part.log.place), part.time_s) for part in parts)
    if any((train.of(*each) & test.of(*each)).any() for each in pairs):
        yield "--train and --test overlap: rows that both name are trained on, and not tested."


def _asked(request: Request) -> str | None:
    """The model that is asked for; None for the best."""
    asked = request.model or request.column_map.model.friction
    return None if asked == BEST else asked


def _models(request: Request, near: NearRest, remarks: list[str]) -> tuple[FrictionModel, ...]:
    """The candidates of the map, or all that the log can tell, and the one that is asked for.

    What is refined afterwards only needs a place to begin. What is not compared is added to the remarks.
    """
    if request.column_map.model.refine is not None:
        return (friction_model(FIRST_MODEL),)
    models = tuple(map(friction_model, request.column_map.model.candidates))
    if not models:
        models, remark = comparable(near, (*family_for(near.problem.equation.path), *FILMS))
        remarks += [remark] if remark else []
    asked = _asked(request)
    if asked is None or asked in {member.name for member in models}:
        return models
    return (*models, friction_model(asked))


def _chosen(request: Request, rungs: Sequence[Rung]) -> Rung:
    asked = _asked(request)
    if asked is None or request.column_map.model.refine is not None:
        return selected(rungs)
    return next(rung for rung in rungs if rung.name == asked)


def _doubts(
    column_map: ColumnMap,
    logs: Sequence[Log],
    fitted: Estimated,
    readings_of: Callable[[Sequence[Log]], Readings],
) -> tuple[str, ...]:
    """What is wrong with the log, the likeliest cause alone."""

    def solve(others: Sequence[Log]) -> Problem:
        return make_problem(column_map, readings_of(others))

    @cache
    def without_delays() -> Problem:
        return solve(logs)

    problem, chosen = fitted.problem, fitted.chosen
    units = [*unlike_derivative(problem.stretches, problem.filters), *unlike_link(problem.stretches)]
    if units:
        return tuple(units)  # which say themselves what is swapped
    exchanged = tuple(ahead_of_goal(problem.stretches, problem.filters))
    if exchanged or not held(chosen, selected(fitted.rungs)):
        return exchanged  # what a law lacks looks like many a mistake
    basic = Basic.of(problem).with_contact(chosen.fit)
    left = chosen.train_rms / max(variation(problem), 1e-300)
    apart = _apart(column_map, logs, fitted, basic, left, readings_of)
    if apart:
        return apart
    ratio = problem.stretches[0].log.given("actuator", "gear_ratio")
    signs = {} if basic.sound else wrong_columns(logs, Basic.of(without_delays()), solve)
    result = tuple(wrong_signs(basic, column_map, ratio, signs))
    settled = () if result else tuple(unidentifiable_gain(basic, column_map))
    # What is refined on the motion is judged by it.
    if not result and not settled and column_map.model.refine is None:
        result = tuple(out_of_step(problem, chosen.fit, column_map))
        settled = () if result else tuple(hanging(without_delays(), left, column_map))
        result = result or tuple(unexplained(basic, left, column_map))
    if settled or signs or not result:
        return settled or result
    return tuple(swapped(logs, Basic.of(without_delays()), solve)) or result


def _each_log(column_map: ColumnMap, fitted: Estimated, readings: Readings) -> tuple[Part, ...]:
    """The chosen law fitted to each training log alone, with its own delays; none where there is one, or one that is
    too short."""
    places = trained_places(fitted.problem)
    if len(places) < 2:
        return ()
    result = []
    for place in places:
        pairs = zip(readings.stretches, readings.splits, strict=True)
        of_it = [(part, split) for part, split in pairs if part.log.place == place]
        alone = replace(readings, stretches=tuple(p for p, _ in of_it), splits=tuple(s for _, s in of_it), _noise={})
        try:
            each = _by_law(column_map, alone, fitted.chosen.model)
        except ExperimentError:
            return ()
        result.append(Part.of(Path(place).name, each.problem, each.chosen.fit))
    return tuple(result)


def _by_law(column_map: ColumnMap, readings: Readings, law: FrictionModel) -> Estimated:
    """One law alone. Raises ExperimentError where there is too little to fit."""
    return _estimated(column_map, readings, lambda _: (law,), lambda rungs: rungs[0])


def _estimated(
    column_map: ColumnMap,
    readings: Readings,
    models: Callable[[NearRest], Sequence[FrictionModel]],
    choose: Callable[[Sequence[Rung]], Rung],
) -> Estimated:
    """With the delays that the map leaves open."""
    return estimated(lambda delays: make_problem(column_map, readings, delays), late.sought(column_map), models, choose)


def _apart(
    column_map: ColumnMap,
    logs: Sequence[Log],
    fitted: Estimated,
    basic: Basic,
    left: float,
    readings_of: Callable[[Sequence[Log]], Readings],
) -> tuple[str, ...]:
    """Where both a gain and a torque are known, the same law with the gain left open."""
    first, key = fitted.problem.terms[0], ("actuator", "torque_gain")
    measured = first.port is not None or first.load is not None
    if first.gain is None or not measured or not column_map.model.inertia or column_map.model.refine is not None:
        return ()
    if basic.load is not None:
        return ()  # nothing else tells a gain
    bare = [replace(log, givens={each: value for each, value in log.givens.items() if each != key}) for log in logs]
    freed = _by_law(column_map, readings_of(bare), fitted.chosen.model)
    return tuple(scales_apart(first.gain, freed.problem, freed.chosen.fit, basic, left))
