"""What was measured and what is predicted, row by row, with the deviation of the prediction."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import UsageError
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.logs.equation import Problem
from norton_bench.logs.near_rest import NearRest


@dataclass(frozen=True)
class Predictions:
    """Rows of all logs, arrays (n,), exertion in ``unit``. ``place`` is the log of each row, ``time_s`` that log's own,
    ``part`` is "train", "test" or "neither". ``deviation`` holds noise, parameters, and drift since the training."""

    place: Sequence[str]
    time_s: FloatArray
    part: Sequence[str]
    measured: FloatArray
    predicted: FloatArray
    deviation: FloatArray
    unit: str


def predictions(problem: Problem, fit: FrictionFit, unit: str) -> Predictions:
    """Every row of the equation."""
    lengths = [len(stretch.time_s) for stretch in problem.stretches]
    places = np.repeat([stretch.log.place for stretch in problem.stretches], lengths)[problem.pick]
    time_s = np.concatenate([stretch.time_s for stretch in problem.stretches])[problem.pick]
    part = np.where(problem.train, "train", np.where(problem.test, "test", "neither"))
    slopes = _slopes(problem, fit)
    variance = NearRest.of(problem).noise_variance(fit) + np.einsum("kn,kl,ln->n", slopes, fit.covariance, slopes)
    variance = variance + _wandering(fit) * _untrained_s(problem, places, time_s)
    return Predictions(
        places.tolist(),
        time_s,
        part.tolist(),
        problem.exertion,
        problem.exertion - problem.side * fit.residual,
        np.sqrt(np.maximum(variance, 0.0)),
        unit,
    )


def _slopes(problem: Problem, fit: FrictionFit) -> FloatArray:
    """Change of every row's prediction with every value of the fit, shape (values, n)."""
    equation = problem.equation

    def friction(shape: FloatArray) -> FloatArray:
        return -equation.process(fit.model.columns(equation.path, shape))

    columns = friction(fit.shape)
    rows = [*equation.others, *columns]
    rows += [fit.strengths @ (friction(changed) - columns) / change for changed, change in fit.moved_shapes()]
    return np.stack(rows)


def _wandering(fit: FrictionFit) -> float:
    """By how much the square of the offset grows a second, as its steps from knot to knot in training say.

    The knots of a log stand as far apart as the map says; those of an offset that does not drift say nothing.
    """
    knots = np.array([value for name, value in zip(fit.names, fit.values, strict=True) if name.startswith("offset_")])
    return float(np.mean(np.diff(knots) ** 2)) if knots.size > 1 else 0.0


def _untrained_s(problem: Problem, places: FloatArray, time_s: FloatArray) -> FloatArray:
    """How long each row is from the nearest row trained on in its log, in knots of the drift; a log without any is as
    far from the training as its own beginning, and one knot more, because a zero may have been set anew."""
    spacing_s = problem.drift_s
    if spacing_s is None:
        return np.zeros(time_s.size)
    away = np.zeros(time_s.size)
    for place in dict.fromkeys(places):
        here = places == place
        trained = np.sort(time_s[here & problem.train])
        if not trained.size:
            away[here] = 1.0 + (time_s[here] - time_s[here][0]) / spacing_s
            continue
        at = np.clip(np.searchsorted(trained, time_s[here]), 1, trained.size - 1) if trained.size > 1 else 0
        beside = np.stack([trained[at], trained[np.maximum(at - 1, 0)]])
        away[here] = np.min(np.abs(beside - time_s[here]), axis=0) / spacing_s
    return away


def write_predictions(path: Path, table: Predictions | None) -> None:
    """A CSV with units in its header. Raises UsageError where it cannot be written, or there is nothing to write."""
    if table is None:
        raise UsageError(f"{path}: predictions are of the equation of motion; leave out --predict, or refine")
    unit = table.unit
    lines = [f"log,time [s],part,measured [{unit}],predicted [{unit}],deviation [{unit}]"]
    columns = (table.place, table.time_s, table.part, table.measured, table.predicted, table.deviation)
    for place, time_s, part, *values in zip(*columns, strict=True):
        numbers = ",".join(f"{value:.9g}" for value in values)
        lines.append(f'"{place}",{time_s:.9g},{part},{numbers}')
    try:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror}); choose another place") from error
