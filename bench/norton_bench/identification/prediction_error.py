"""How far a network's predictions are off, of torque and free motion, on motion that its values were not fitted to."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification.expansion import Expansion, Sums
from norton_bench.identification.results import FitResult, SensorZero
from norton_bench.identification.signals import Signals
from norton_bench.identification.validation import free_runs
from norton_bench.models.parameters import NAN, PredictionError
from norton_bench.records import Measured
from norton_bench.segments import Use

# Predictions are judged over stretches of this length, and over what is left of a segment down to the shorter one.
PIECE_S, SHORTEST_PIECE_S = 2.0, 0.5
LEVEL = 0.95
# Noise is no greater than what this share of the segments is left with: knocks make readings' differences look noisy.
QUIETEST = 0.25


def prediction_error(
    result: FitResult, at: Expansion, standing_nm: float, stretches: Sequence[Signals], measured: Measured
) -> PredictionError:
    """Of the fit ``result`` expanded ``at`` its values; ``stretches`` are those that it was fitted to and those kept
    for validation. To simulate the free motion takes a second."""
    velocity_rad_s = _velocity(result, at.zero.moved(-standing_nm), stretches, measured)
    return _prediction(at, *mean_squares(at, standing_nm), velocity_rad_s)


def bound(mean_squares: FloatArray) -> tuple[float, float]:
    """What the next of exchangeable values (n,) stays below, and how often: at LEVEL, or as near as n values can tell.

    The k-th smallest of n exceeds the next with a chance of k/(n + 1), whatever their distribution (conformal
    prediction: Vovk, Gammerman and Shafer 2005).
    """
    count = mean_squares.size
    rank = min(count, int(np.ceil(LEVEL * (count + 1))))
    return float(np.sort(mean_squares)[rank - 1]), min(LEVEL, rank / (count + 1))


def mean_squares(at: Expansion, standing_nm: float) -> tuple[FloatArray, float]:
    """Of the network's error over pieces (pieces,), each predicted without itself; and the noise's share of each.

    ``standing_nm`` is a torque that stands in the fitted zero and is no zero."""
    sums = Sums.of(at, at.jacobian)
    every = np.arange(len(at.jacobian))
    left = at.without(at.zero.moved(-standing_nm))
    whole = sums.solved(every)
    values = []
    for part in range(int(at.part.max()) + 1):
        inside = np.flatnonzero(at.part == part)
        error = left[inside] + at.drifted_nm[inside]
        if at.fitted[inside[0]]:
            shift = (sums.solved(every, part) - whole) / sums.scale
            shift[at.basis] = 0.0
            error = error - shift @ at.jacobian[:, inside]
        values += [float(np.mean(error[piece] ** 2)) for piece in _pieces(at.time_s[inside])]
    squares = np.array(values)
    return squares, min(at.noise_nm2, float(np.quantile(squares, QUIETEST)))


def _pieces(time_s: FloatArray) -> list[npt.NDArray[np.int64]]:
    """Indices of stretches of PIECE_S each; the last may be as short as SHORTEST_PIECE_S."""
    number = np.floor((time_s - time_s[0]) / PIECE_S).astype(np.int64)
    tick_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else 0.0
    pieces = [np.flatnonzero(number == each) for each in range(int(number[-1]) + 1)]
    return [piece for piece in pieces if piece.size * tick_s >= SHORTEST_PIECE_S]


def _velocity(result: FitResult, zero: SensorZero, stretches: Sequence[Signals], measured: Measured) -> float:
    """What the rms error of the free velocity stays below over a piece of free motion; NaN where there was none."""
    used = [each for each in measured.segments if each.use in (Use.IDENTIFY, Use.VALIDATE)]
    runs = free_runs(result, stretches, used, zero)
    if not runs:
        return NAN
    beyond = [
        float(np.mean((run.measured - run.predicted)[piece] ** 2)) - run.noise_rad2_s2
        for run in runs
        for piece in _pieces(run.time_s)
    ]
    return float(np.sqrt(max(bound(np.array(beyond))[0], 0.0))) if beyond else NAN


def _prediction(at: Expansion, squares: FloatArray, noise_nm2: float, velocity_rad_s: float) -> PredictionError:
    greatest, level = bound(squares)
    seen = {"velocity": at.velocity_rad_s, "acceleration": at.acceleration_rad_s2, "command": at.command}
    ranges = {name: (float(np.min(values)), float(np.max(values))) for name, values in seen.items()}
    return PredictionError(float(np.sqrt(max(greatest - noise_nm2, 0.0))), velocity_rad_s, level, ranges)
