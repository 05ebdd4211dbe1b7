"""What the outcomes of a sweep say together, parameter by parameter."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.models.parameters import PARAMETERS, Status
from norton_bench.sweep.task import Outcome

WITHIN = 1.96  # deviations, of 95 %


@dataclass(frozen=True)
class Spread:
    """One parameter over all runs in which it is valid, in ``unit``; NaN where runs or truth are too few to say.

    ``spread`` is the standard deviation of the values, ``std`` the median of those that the runs themselves give.
    ``bias`` and ``rms_error`` are of the errors, ``within`` is the share of 95 % intervals that hold the truth.
    """

    name: str
    unit: str
    runs: int
    median: float
    least: float
    greatest: float
    spread: float
    std: float
    bias: float
    rms_error: float
    within: float


def summary(outcomes: Sequence[Outcome]) -> tuple[Spread, ...]:
    """In the order of the table of parameters; what is valid nowhere is left out."""
    found = (_spread(parameter.name, outcomes) for parameter in PARAMETERS)
    return tuple(each for each in found if each is not None)


def _spread(name: str, outcomes: Sequence[Outcome]) -> Spread | None:
    valid = [
        (outcome, estimate)
        for outcome in outcomes
        for estimate in outcome.estimates
        if estimate.name == name and estimate.status is Status.VALID
    ]
    if not valid:
        return None
    value, std = np.array([(estimate.value, estimate.std) for _, estimate in valid]).T
    error = value - np.array([outcome.true.get(name, np.nan) for outcome, _ in valid])
    known = bool(np.isfinite(error).all())
    return Spread(
        name=name,
        unit=valid[0][1].unit,
        runs=len(valid),
        median=float(np.median(value)),
        least=float(value.min()),
        greatest=float(value.max()),
        spread=float(np.std(value, ddof=1)) if len(valid) > 1 else float("nan"),
        std=float(np.median(std)),
        bias=float(np.mean(error)),
        rms_error=float(np.sqrt(np.mean(error**2))),
        within=float(np.mean(np.abs(error) <= WITHIN * std)) if known else float("nan"),
    )
