"""How noisy a stream of readings is, told by the readings themselves."""

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray

# Motion and torque change too slowly to show in an eighth difference; of independent errors it has C(16, 8) times the
# variance.
ORDER = 8
VARIANCE = 12870.0
BLOCK = 100
FEWEST_BLOCKS = 5
# Errors that grow with the speed, of readings taken at instants that nobody knows just so, make some blocks noisier by
# far than most: then the mean counts, for it is what pulls at a fit. A shock is no noise: it is a few readings of a
# block, and the block's median square (for normal errors so much less than their mean square) passes it over.
UNEVEN = 2.0
NORMAL_MEDIAN_SQUARE = 0.4549


def deviation(values: FloatArray, chosen: npt.NDArray[np.bool_]) -> float:
    """Standard deviation of one reading's own error where ``chosen``, both of shape (n,); 0 where too few are left.

    The median over blocks of readings, so that a shock or a lost reading here and there does not count; their mean
    where some blocks are much noisier throughout.
    """
    if values.size <= ORDER:
        return 0.0
    squares = np.diff(values, ORDER)[chosen[ORDER // 2 : -(ORDER // 2)]] ** 2
    blocks = squares[: squares.size // BLOCK * BLOCK].reshape(-1, BLOCK)
    if len(blocks) < FEWEST_BLOCKS:
        return 0.0
    usual = float(np.median(np.mean(blocks, axis=1)))
    mean = float(np.mean(np.median(blocks, axis=1))) / NORMAL_MEDIAN_SQUARE
    return float(np.sqrt((mean if mean > UNEVEN * usual else usual) / VARIANCE))
