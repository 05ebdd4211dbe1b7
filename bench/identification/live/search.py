"""Regressions on a Gram matrix of the live bank's rows: the best linear parameters of any shape, and the best shape."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bench.identification.live.bank import BANDWIDTH_NODES, COMMAND_NODES, S_NODES, WIDTH, combination
from bench.identification.regression import Shape

FloatArray = npt.NDArray[np.float64]

STEPS_AN_UPDATE = 3
LONGEST_STEP = np.array([0.5, 0.5, 3e-4, 3e-4])
DIFFERENCE = np.array([0.02, 0.02, 2e-5, 2e-5])
SCAN_BANDWIDTHS = (150.0, 600.0, 2000.0)
SCAN_TORQUE_DELAYS = (-1.0, 0.0)
LOW = np.array([np.log(BANDWIDTH_NODES[0]), np.log(S_NODES[0]), -2e-3, -3e-3])
HIGH = np.array([np.log(BANDWIDTH_NODES[-1]), np.log(S_NODES[-1]), 4e-3, 3e-3])
# The deviation of what nothing tells of.
UNKNOWN = 1e9


@dataclass(frozen=True)
class Candidate:
    """One shape with linear parameters, the combinations of a row that give its columns and its residual."""

    shape: Shape
    linear: FloatArray
    columns: FloatArray
    residual: FloatArray
    tick_s: float

    @classmethod
    def of(cls, shape: Shape, linear: FloatArray, tick_s: float) -> "Candidate":
        columns, target = combination(shape, tick_s)
        return cls(shape, linear, columns, target - columns @ linear, tick_s)

    def cost(self, gram: FloatArray) -> float:
        return float(self.residual @ gram @ self.residual)

    def gradient(self) -> FloatArray:
        """How the prediction's combination changes with (log β, log s, d_c, d_m), then the six linear: (WIDTH, 10)."""
        at = self.shape.as_array()
        slopes = np.empty((WIDTH, 4))
        for k in range(4):
            side = np.zeros(4)
            side[k] = DIFFERENCE[k] if at[k] + DIFFERENCE[k] < HIGH[k] else -DIFFERENCE[k]
            moved = Candidate.of(Shape.of(at + side), self.linear, self.tick_s)
            slopes[:, k] = (self.residual - moved.residual) / side[k]
        return np.concatenate([slopes, self.columns], axis=1)


def evaluate(gram: FloatArray, shape: Shape, tick_s: float) -> Candidate:
    """The shape with its best linear parameters."""
    columns, target = combination(shape, tick_s)
    linear = solved(columns.T @ gram @ columns, columns.T @ (gram @ target))
    return Candidate(shape, linear, columns, target - columns @ linear, tick_s)


def scan(gram: FloatArray, tick_s: float) -> Candidate:
    """The best of all, from nothing: a grid, improved from the best of it for each of several bandwidths."""
    starts = [_best_with(gram, bandwidth, tick_s) for bandwidth in SCAN_BANDWIDTHS]
    return min((improved(gram, start) for start in starts), key=lambda candidate: candidate.cost(gram))


def _best_with(gram: FloatArray, bandwidth: float, tick_s: float) -> Candidate:
    candidates = (
        evaluate(gram, Shape(bandwidth, s, command * tick_s, torque * tick_s), tick_s)
        for s in S_NODES[1:-1:2]
        for command in COMMAND_NODES[1:-1:2]
        for torque in SCAN_TORQUE_DELAYS
    )
    return min(candidates, key=lambda candidate: candidate.cost(gram))


def improved(gram: FloatArray, candidate: Candidate) -> Candidate:
    """A few steps of Gauss-Newton."""
    for _ in range(STEPS_AN_UPDATE):
        every = candidate.gradient()
        step = solved(every.T @ gram @ every, every.T @ (gram @ candidate.residual))[:4]
        at = candidate.shape.as_array()
        for share in (1.0, 0.3):
            moved = np.clip(at + share * np.clip(step, -LONGEST_STEP, LONGEST_STEP), LOW, HIGH)
            trial = evaluate(gram, Shape.of(moved), candidate.tick_s)
            if trial.cost(gram) < candidate.cost(gram):
                break
        else:
            break
        candidate = trial
    return candidate


def covariance(candidate: Candidate, blocks: list[FloatArray], samples: int, correlated: float) -> FloatArray:
    """Of (log β, log s, d_c, d_m) and the six linear, (10, 10): a sandwich over blocks, never below white noise's.

    One sample in ``correlated`` is independent. The correlations are the white noise's.
    """
    total = np.sum(blocks, axis=0)
    every = candidate.gradient()
    information = every.T @ total @ every
    scale = np.sqrt(np.where(np.diag(information) > 0.0, np.diag(information), 1.0))
    bread = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    scores = np.stack([every.T @ (block @ candidate.residual) for block in blocks]) / scale
    sandwich = np.diag(bread @ (scores.T @ scores) @ bread)
    white = np.diag(bread) * correlated * candidate.cost(total) / samples
    deviation = np.sqrt(np.maximum(np.maximum(sandwich, white), 1e-300))
    excited = np.diag(bread) > 0.0
    own = np.sqrt(np.where(excited, np.diag(bread), 1.0))
    found = bread / np.outer(own, own) * np.outer(deviation / scale, deviation / scale)
    # What nothing has moved yet may be anything.
    found[~excited, ~excited] = UNKNOWN**2
    return np.asarray(found)


def evidence(candidate: Candidate, gram: FloatArray) -> float:
    """As fit.scale_evidence: what only the command explains of the torque, over what nothing explains, both rms."""
    others, lag = candidate.columns[:, 1:], candidate.columns[:, 0]
    alone = lag - others @ solved(others.T @ gram @ others, others.T @ (gram @ lag))
    explained = max(float(alone @ gram @ alone), 0.0) / max(candidate.cost(gram), 1e-300)
    return float(np.abs(candidate.linear[0]) * np.sqrt(explained))


def solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """A symmetric system, scaled; directions that nothing excites get zero."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale)
    return np.asarray(np.linalg.lstsq(scaled, right / scale, rcond=1e-11)[0] / scale)
