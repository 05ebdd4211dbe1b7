"""Coulomb and viscous friction in total, whatever model was fitted: the line nearest to its steady sliding."""

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.friction_model import Path
from norton_bench.logs.equation import Problem
from norton_bench.logs.log_units import Units
from norton_bench.models.parameters import Estimate, Status

# Of the speeds trained on: the middle part, in so many steps.
SPEEDS = np.linspace(0.1, 0.9, 17)
# A total less certain than this share of itself is none.
UNSURE = 0.5


def totals(
    problem: Problem, fit: FrictionFit, units: Units, *, back_emf: float, believed: bool
) -> tuple[Estimate, ...]:
    """``total_coulomb`` and ``total_viscous``: the mean friction of both directions in steady sliding is the first
    plus the second times the speed, best over the speeds that were trained on. ``back_emf`` is the damping that is none
    of friction's. Where nothing gives a scale they are ratios to the torque gain."""
    weights = _lines(problem, fit, fit.shape)
    count = len(problem.equation.names)
    terms = len(fit.model.terms)
    slopes = np.zeros((2, len(fit.names)))
    slopes[:, count : count + terms] = weights
    for index, (changed, change) in enumerate(fit.moved_shapes()):
        slopes[:, count + terms + index] = (_lines(problem, fit, changed) - weights) @ fit.strengths / change
    covariance = slopes @ fit.covariance @ slopes.T
    values = weights @ fit.strengths - np.array([0.0, back_emf])
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    exertion, speed = units.exertion, f"{units.motion}/s"
    damping = {"rad/s": "N*m*s/rad", "m/s": "N*s/m"}[speed]
    return tuple(
        Estimate(name, float(value), float(std), unit, status_of(value, std, believed=believed and fit.converged))
        for name, value, std, unit in zip(
            ("total_coulomb", "total_viscous"), values, deviations, (exertion, damping), strict=True
        )
    )


def status_of(value: float, std: float, *, believed: bool) -> Status:
    """Of what the values of a fit give."""
    if not believed:
        return Status.DOUBTFUL
    return Status.VALID if std <= UNSURE * abs(value) else Status.UNEXCITED


def _lines(problem: Problem, fit: FrictionFit, shape: FloatArray) -> FloatArray:
    """What each coefficient adds to the constant and to the slope, shape (2, terms)."""
    path = problem.equation.path
    trained = slice(None) if path.trained is None else path.trained
    speed = np.abs(path.velocity[trained])
    speeds = np.asarray(np.quantile(speed[speed > 0], SPEEDS), dtype=np.float64)
    load = None if path.load is None else np.full(speeds.size, np.mean(np.abs(path.load[trained])))
    columns = [sign * fit.model.columns(_sliding(path, sign, speeds, load), shape) for sign in (1.0, -1.0)]
    line = np.linalg.pinv(np.stack([np.ones(speeds.size), speeds], axis=1))
    return np.asarray(line @ (0.5 * (columns[0] + columns[1])).T)


def _sliding(path: Path, sign: float, speeds: FloatArray, load: FloatArray | None) -> Path:
    """Steady sliding at each speed: steps so long that every contact has turned over."""
    way = 10.0 * path.displacement_scale * np.arange(1.0, speeds.size + 1.0)
    return Path(
        path.dt_s,
        np.asarray(sign * way, dtype=np.float64),
        sign * speeds,
        np.zeros(1, dtype=np.int64),
        load=load,
        shares=np.array([sign]),
    )
