"""A test that the fit does not hold on: said, with the likely reason."""

from collections.abc import Iterator, Sequence

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.identification.friction_fit import FrictionFit, scaled_rms
from norton_bench.identification.ladder import Rung
from norton_bench.identification.statistics import NOTHING
from norton_bench.logs.equation import Problem
from norton_bench.logs.log_units import Units
from norton_bench.logs.results import ErrorFigures, Step, unit_of

# Of the error on held-out parts: a test beyond is not what the training data promise.
FAR = 2.0
# Of the squared error: a cause that explains this much is the one.
EXPLAINS = 0.5
UNKNOWN = "no single cause shows: the machine or its load was not the same, or the model does not describe it"
# Beyond what was trained on by this factor is elsewhere.
ELSEWHERE = 1.2


def alarms(problem: Problem, chosen: Rung, units: Units, deviation: FloatArray) -> tuple[str, ...]:
    """Empty where the test errs about as much as the parts that were held out, or as ``deviation`` (n,), that of the
    predictions, says; or there is none."""
    rows = problem.test
    if not rows.any():
        return ()
    fit = chosen.fit
    test, foretold = (
        scaled_rms((fit.scale * errors)[rows], fit.scale[problem.train]) for errors in (fit.residual, deviation)
    )
    expected = max(chosen.held_out_rms, chosen.train_rms, foretold)
    worst = float(np.sqrt(max(chosen.fold_mean_squares)))
    if not test > max(FAR * expected, worst):
        return ()
    reasons = list(_reasons(problem, fit, units)) or [UNKNOWN]
    return (_told(test, expected, units.exertion if problem.scaled else units.drive, reasons),)


def alarms_of_motion(test: ErrorFigures | None, ladder: Sequence[Step]) -> tuple[str, ...]:
    """The same of a fit that was refined on the motion itself."""
    chosen = next(step for step in ladder if step.selected)
    expected = max(chosen.held_out_relative, chosen.train_relative) + chosen.held_out_std
    if test is None or not test.relative > FAR * expected:
        return ()
    spread = test.rms / test.relative
    return (_told(test.rms, expected * spread, test.unit, [UNKNOWN, "a zero, a unit or a gain may differ"]),)


def _told(test: float, expected: float, unit: str, reasons: Sequence[str]) -> str:
    return (
        f"The test's error, {test:.3g} {unit}, is {test / expected:.3g} times that on held-out parts of the training: "
        f"{'; '.join(reasons)}."
    )


def _reasons(problem: Problem, fit: FrictionFit, units: Units) -> Iterator[str]:
    rows = problem.test
    residual = fit.residual[rows]
    total, mean = float(np.mean(residual**2)), float(np.mean(residual))
    if mean**2 > EXPLAINS * total:
        unit = units.exertion if problem.scaled else units.drive
        yield (
            f"most of it is a constant of {problem.side * mean:.3g} {unit}, so the zero of a sensor or a constant load "
            "differs from the training's"
        )
    elif _by_angle(problem, fit, rows) > EXPLAINS:
        yield "most of it goes with the angle, as a weight does: something hangs on the shaft that did not before"
    else:
        yield from _one_number(problem, fit, units, total)
    yield from _elsewhere(problem, units)


def _by_angle(problem: Problem, fit: FrictionFit, rows: BoolArray) -> float:
    """The share of what is left in ``rows`` (n,) that sine and cosine of the position explain, beside a constant."""
    equation = problem.equation
    angle = equation.path.position
    waves = equation.process(np.stack([np.sin(angle), np.cos(angle), np.ones(angle.size)]))[:, rows]
    columns, left = (fit.scale[rows] * waves).T, (fit.scale * fit.residual)[rows]
    beside = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    return 1 - float(beside @ beside) / max(float(left @ left), NOTHING**2)


def _one_number(problem: Problem, fit: FrictionFit, units: Units, total: float) -> Iterator[str]:
    """A factor of everything, or a value that is another one here: what explains the most, if that is most of it."""
    equation, rows = problem.equation, problem.test
    target = equation.target[rows]
    predicted = target - fit.residual[rows]
    power = float(predicted @ predicted)
    factor = float(predicted @ target) / power if power > 0 else 1.0
    by_factor = 1 - float(np.mean((target - factor * predicted) ** 2)) / total
    columns = np.concatenate([equation.others, -equation.process(fit.model.columns(equation.path, fit.shape))])[:, rows]
    columns, residual = fit.scale[rows] * columns, (fit.scale * fit.residual)[rows]
    squares = np.maximum(np.sum(columns**2, axis=1), NOTHING**2)
    changes = columns @ residual / squares
    by_value = changes**2 * squares / (residual @ residual)
    index = int(np.argmax(by_value))
    if max(by_factor, by_value[index]) < EXPLAINS:
        return
    if by_factor >= by_value[index]:
        yield f"everything is {factor:.3g} times as large as predicted: a gain, a unit or a load differs"
        return
    name, value = fit.names[index], float(fit.values[index])
    yield (
        f"with {name.replace('_', ' ')} {value + changes[index]:.4g} {unit_of(name, fit, units)} in place of "
        f"{value:.4g} {by_value[index]:.0%} of it would be explained"
    )


def _elsewhere(problem: Problem, units: Units) -> Iterator[str]:
    """What goes beyond anything trained on."""
    path = problem.equation.path
    ranges = {"speeds": (np.abs(path.velocity), f"{units.motion}/s")}
    if path.load is not None:
        ranges["loads"] = (np.abs(path.load), units.exertion)
    if path.temperature_c is not None:
        ranges["temperatures"] = (path.temperature_c, "degC")
    for name, (values, unit) in ranges.items():
        here = values[problem.pick]
        test, train = float(np.max(here[problem.test])), float(np.max(here[problem.train]))
        if test > ELSEWHERE * train:
            yield f"its {name} reach {test:.3g} {unit}, those trained on {train:.3g}"
