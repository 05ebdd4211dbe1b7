"""Separable least squares (variable projection): the linear unknowns are solved for exactly at every step.

No initial guess: a scan over the friction's shape, then Gauss-Newton from several amplifier bandwidths in a low band,
in which delays are harmless, then in the full band.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bench.identification.kernels import Kernel
from bench.identification.regression import Regression, Shape
from bench.identification.signals import Signals

FloatArray = npt.NDArray[np.float64]

# In cycles a tick. The low band leaves delays of some ticks within the reach of Gauss-Newton.
FULL_BAND = Kernel(cutoff=0.18, half_width=8.0)
LOW_BAND = Kernel(cutoff=0.05, half_width=24.0)
LOW_STRIDE = 5

BANDWIDTH_RAD_S = (20.0, 6000.0)
S_PER_RAD = (5.0, 5e4)
DELAY_TICKS = 8.0
SCAN_S = np.geomspace(20.0, 10_000.0, 10)
START_BANDWIDTHS = (150.0, 500.0, 1500.0)

LONGEST_STEP = np.array([0.7, 0.7, 5e-4, 5e-4])
# Of each parameter: relative for the first two, seconds for the delays.
CONVERGED_STEP = np.array([1e-4, 1e-4, 1e-7, 1e-7])
MOST_STEPS = 40


@dataclass(frozen=True)
class Solution:
    """Where the iteration ended. ``jacobian`` (samples, parameters): the linear columns, then log β, log s, delays."""

    shape: Shape
    linear: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    free: tuple[int, ...]
    converged: bool
    free_motion: bool = False

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)


def solve(stretches: tuple[Signals, ...], *, free_motion: bool = False) -> Solution:
    """The best fit of all stretches; ``free_motion`` as in Regression."""
    low = Regression.of(stretches, LOW_BAND, LOW_STRIDE, free_motion=free_motion)
    starts = [_iterate(low, start, most_steps=15) for start in _starts(low)]
    best = min(starts, key=lambda solution: solution.cost)
    full = Regression.of(stretches, FULL_BAND, free_motion=free_motion)
    return _iterate(full, best.shape, most_steps=MOST_STEPS)


def limits(tick_s: float) -> tuple[FloatArray, FloatArray]:
    """The box searched: (log β, log s, d_c, d_m)."""
    delay_s = DELAY_TICKS * tick_s
    low = np.array([np.log(BANDWIDTH_RAD_S[0]), np.log(S_PER_RAD[0]), -delay_s, -delay_s])
    high = np.array([np.log(BANDWIDTH_RAD_S[1]), np.log(S_PER_RAD[1]), delay_s, delay_s])
    return low, high


def linear_solution(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Least squares by the normal equations of scaled columns; columns that say nothing get zero."""
    scale = np.linalg.norm(columns, axis=1)
    scale[scale == 0] = 1.0
    scaled = columns / scale[:, None]
    return np.asarray(np.linalg.lstsq(scaled @ scaled.T, scaled @ target, rcond=1e-13)[0] / scale)


def _starts(regression: Regression) -> list[Shape]:
    target = regression.target()
    tick_s = regression.rows[0].signals.tick_s

    def cost(s: float) -> float:
        columns = regression.columns(Shape(START_BANDWIDTHS[1], s, tick_s, 0.0))
        residual = target - linear_solution(columns, target) @ columns
        return float(residual @ residual)

    best = float(min(SCAN_S, key=cost))
    return [Shape(bandwidth, best, tick_s, 0.0) for bandwidth in START_BANDWIDTHS]


def _evaluate(regression: Regression, target: FloatArray, shape: Shape) -> tuple[FloatArray, FloatArray, FloatArray]:
    columns = regression.columns(shape)
    linear = linear_solution(columns, target)
    return columns, linear, target - linear @ columns


def _iterate(regression: Regression, shape: Shape, *, most_steps: int) -> Solution:
    """Gauss-Newton on the projected problem with step halving, inside the box."""
    target = regression.target()
    low, high = limits(regression.rows[0].signals.tick_s)
    free = regression.free
    columns, linear, residual = _evaluate(regression, target, shape)
    converged = False
    for _ in range(most_steps):
        slopes = regression.jacobian(shape, columns, linear)[list(free)]
        step = np.zeros(4)
        step[list(free)] = linear_solution(np.concatenate([slopes, columns]), residual)[: len(free)]
        step = np.clip(step, -LONGEST_STEP, LONGEST_STEP)
        if np.all(np.abs(step) < CONVERGED_STEP):
            converged = True
            break
        improved = False
        for share in (1.0, 0.5, 0.2, 0.05):
            trial = Shape.of(np.clip(shape.as_array() + share * step, low, high))
            evaluated = _evaluate(regression, target, trial)
            if evaluated[2] @ evaluated[2] < residual @ residual:
                shape, improved = trial, True
                columns, linear, residual = evaluated
                break
        if not improved:
            # Gauss-Newton cannot improve: at the minimum to within rounding, or held by the box.
            converged = bool(np.all(np.abs(step) < 100 * CONVERGED_STEP))
            break
    slopes = regression.jacobian(shape, columns, linear)[list(free)]
    return Solution(
        shape, linear, residual, np.concatenate([columns, slopes]).T, free, converged, regression.free_motion
    )
