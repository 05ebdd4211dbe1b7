"""Linear least squares from its normal equations, some of the coefficients held at or above zero."""

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from norton_bench.arrays import BoolArray, FloatArray

# Directions that carry less than this share of the strongest say nothing.
WEAKEST = 1e-9
# A coefficient; columns nearly alike change places more often than scipy expects.
MOST_EXCHANGES = 100


def bounded_solution(gram: FloatArray, moment: FloatArray, nonnegative: BoolArray) -> FloatArray:
    """Minimises ``c·gram·c − 2 c·moment`` with ``c[nonnegative] >= 0``; columns that say nothing get zero.

    Free coefficients are eliminated first (a Schur complement), so that the rest is plain non-negative least squares.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))
    silent = scale == 0.0
    scale[silent] = 1.0
    gram, moment = gram / np.outer(scale, scale), moment / scale
    free = ~nonnegative
    inverse = np.linalg.pinv(gram[np.ix_(free, free)], rcond=WEAKEST, hermitian=True)
    coupling = inverse @ gram[np.ix_(free, nonnegative)]
    solution = np.zeros(moment.size)
    if nonnegative.any():
        left = gram[np.ix_(nonnegative, nonnegative)] - gram[np.ix_(nonnegative, free)] @ coupling
        # A trace of ridge: columns that are alike share what they explain.
        root = np.linalg.cholesky(left + WEAKEST * np.eye(len(left)))
        right = solve_triangular(root, moment[nonnegative] - coupling.T @ moment[free], lower=True)
        solution[nonnegative] = nnls(root.T, right, maxiter=MOST_EXCHANGES * len(right))[0]
    solution[free] = inverse @ moment[free] - coupling @ solution[nonnegative]
    solution[silent] = 0.0
    return np.asarray(solution / scale)
