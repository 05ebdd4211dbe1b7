"""How noisy a stream of readings is, told by the readings themselves."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

# Motion and torque change too slowly to show in an eighth difference; of independent errors it has C(16, 8) times the
# variance.
ORDER = 8
VARIANCE = 12870.0
BLOCK = 100
FEWEST_BLOCKS = 5


def deviation(values: FloatArray, chosen: npt.NDArray[np.bool_]) -> float:
    """Standard deviation of one reading's own error where ``chosen``, both of shape (n,); 0 where too few are left.

    The median over blocks of readings, so that a shock or a lost reading here and there does not count.
    """
    if values.size <= ORDER:
        return 0.0
    squares = np.diff(values, ORDER)[chosen[ORDER // 2 : -(ORDER // 2)]] ** 2
    blocks = squares[: squares.size // BLOCK * BLOCK].reshape(-1, BLOCK)
    if len(blocks) < FEWEST_BLOCKS:
        return 0.0
    return float(np.sqrt(np.median(np.mean(blocks, axis=1)) / VARIANCE))
