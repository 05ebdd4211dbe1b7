"""A test that the fit does not hold on: said, with the likely reason."""

from collections.abc import Iterator

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.ladder import Rung
from norton_bench.logs.equation import Problem
from norton_bench.logs.log_units import Units

# Of the error on held-out parts: a test beyond is not what the training data promise.
FAR = 2.0
# Of the squared error: a cause that explains this much is the one.
EXPLAINS = 0.5
# Beyond what was trained on by this factor is elsewhere.
ELSEWHERE = 1.2


def alarms(problem: Problem, chosen: Rung, units: Units) -> tuple[str, ...]:
    """Empty where the test errs about as much as the parts that were held out, or there is none."""
    rows = problem.test
    if not problem.scaled or not rows.any():
        return ()
    residual = chosen.fit.residual[rows]
    # As weighted in training: rows near rest count for as little as there.
    usual = float(np.sqrt(np.mean(chosen.fit.scale[problem.train] ** 2)))
    test = float(np.sqrt(np.mean((chosen.fit.scale[rows] * residual) ** 2))) / usual
    expected = max(chosen.held_out_rms, chosen.train_rms)
    worst = float(np.sqrt(max(chosen.fold_mean_squares)))
    if not test > max(FAR * expected, worst):
        return ()
    reasons = list(_reasons(problem, residual, units)) or [
        "no single cause shows: the machine or its load was not the same, or the model does not describe it"
    ]
    return (
        f"The test's error, {test:.3g} {units.exertion}, is {test / expected:.3g} times that on held-out parts of the "
        f"training: {'; '.join(reasons)}.",
    )


def _reasons(problem: Problem, residual: FloatArray, units: Units) -> Iterator[str]:
    rows, total = problem.test, float(np.mean(residual**2))
    mean = float(np.mean(residual))
    if mean**2 > EXPLAINS * total:
        yield (
            f"most of it is a constant of {problem.side * mean:.3g} {units.exertion}, so the zero of a sensor or a "
            "constant load differs from the training's"
        )
    predicted = problem.equation.target[rows] - residual
    power = float(predicted @ predicted)
    factor = float(predicted @ problem.equation.target[rows]) / power if power > 0 else 1.0
    left = float(np.mean((problem.equation.target[rows] - factor * predicted) ** 2))
    if left < (1 - EXPLAINS) * total:
        yield f"everything is {factor:.3g} times as large as predicted: a gain, a unit or a load differs"
    yield from _elsewhere(problem, units)


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
