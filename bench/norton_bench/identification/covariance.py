"""Deviations that can be believed: residuals are coloured, and part of them is not noise but the model's fault.

Neighbouring residuals are summed in blocks of time before they are squared (a sandwich estimate clustered by
block), for several lengths of block; the widest answer counts.
"""

import numpy as np

from norton_bench.arrays import FloatArray

BLOCKS_S = (0.1, 0.5, 2.0)


def sandwich(
    jacobian: FloatArray,
    residual: FloatArray,
    time_s: FloatArray,
    contamination: FloatArray | None = None,
    linear: FloatArray | None = None,
) -> FloatArray:
    """Covariance of least squares parameters, shape (parameters, parameters).

    ``jacobian`` (samples, parameters), ``residual`` and ``time_s`` (samples,). ``contamination`` (parameters,) is what
    errors in the columns add to their squares, ``linear`` the values of those parameters, the first, that stand in the
    equation as factors. The correlations are those of the middle length of block, the deviations the largest of all.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    information = (jacobian / scale).T @ (jacobian / scale)
    scores = jacobian / scale * residual[:, None]
    if contamination is not None and linear is not None:
        at = np.arange(len(contamination))
        information[at, at] -= contamination / scale[at] ** 2
        linearly = slice(len(linear))
        scores[:, linearly] += contamination[linearly] * linear / len(residual) / scale[linearly]
    bread = np.linalg.pinv(information, rcond=1e-13, hermitian=True)
    candidates = [bread @ _meat(scores, time_s, block_s) @ bread for block_s in BLOCKS_S]
    widest = np.sqrt(np.max([np.diag(candidate) for candidate in candidates], axis=0))
    middle = candidates[len(candidates) // 2]
    deviation = np.sqrt(np.maximum(np.diag(middle), 1e-300))
    return np.asarray(middle / np.outer(deviation, deviation) * np.outer(widest, widest) / np.outer(scale, scale))


def _meat(scores: FloatArray, time_s: FloatArray, block_s: float) -> FloatArray:
    block = np.unique(((time_s - time_s[0]) / block_s).astype(np.int64), return_inverse=True)[1]
    count = int(block.max()) + 1
    sums = np.stack([np.bincount(block, column, count) for column in scores.T], axis=1)
    # The usual correction for few clusters and spent degrees of freedom.
    correction = count / max(count - 1, 1) * len(scores) / max(len(scores) - scores.shape[1], 1)
    return np.asarray(correction * sums.T @ sums)
