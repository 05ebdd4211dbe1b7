"""Whether a residual follows an input: tests whose blocks judge themselves, so that neither colour nor bursts alarm."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_toeplitz

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.distributions import chi2_tail, f_tail
from norton_bench.identification.kernels import Kernel

INPUT_LAGS = range(-4, 9)
# Sums over blocks this long are taken as independent of each other.
BLOCK_S = 0.5
BLOCKS_PER_LAG = 4
PEAK_LENGTH = 128
# What happens less often than this by chance is said to be so.
SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class Dependence:
    """How the residual follows one input, ``lags_s`` earlier (negative: later); ``band`` is the half width of 95 %.

    ``share`` of its variance, ``rms_nm`` of it, is a linear response to the input, strongest at ``peak_hz``.
    """

    name: str
    lags_s: FloatArray
    correlation: FloatArray
    band: FloatArray
    p_value: float
    share: float
    rms_nm: float
    peak_hz: float


def dependence(whitened: FloatArray, values: FloatArray, step_s: float, name: str, rms_nm: float) -> Dependence | None:
    """Of a whitened residual on a whitened input; None where the input stood still or too little is left.

    Products are summed over blocks, and the blocks' own scatter judges their sum (Hotelling): what colours the residual
    for shorter than a block raises no alarm.
    """
    lags = np.array(INPUT_LAGS)
    columns = np.stack([_shifted(values, lag) for lag in lags])
    rows = np.isfinite(whitened) & np.isfinite(columns).all(axis=0)
    block = blocks_of(rows, step_s)
    if not rows.any() or int(block[-1]) + 1 < BLOCKS_PER_LAG * lags.size:
        return None
    x, e = columns[:, rows], whitened[rows] - np.mean(whitened[rows])
    x = x - x.mean(axis=1, keepdims=True)
    size = np.sqrt(np.mean(x**2, axis=1))
    if not np.all(size > 0):
        return None
    x /= size[:, None]
    blocks = int(block[-1]) + 1
    scores = np.array([np.bincount(block, row * e, blocks) for row in x], dtype=np.float64)
    p_value = chance_of_sum(scores)
    gram = x @ x.T + 1e-9 * x.shape[1] * np.eye(lags.size)
    response = np.linalg.solve(gram, x @ e) @ x
    deviation = float(np.sqrt(np.mean(e**2)))
    # Any response as long as this takes up so much of mere noise.
    share = max(0.0, float(np.mean(response**2)) / max(deviation**2, 1e-300) - lags.size / e.size)
    full = np.zeros(whitened.size)
    full[rows] = response
    return Dependence(
        name,
        lags * step_s,
        scores.sum(axis=1) / (e.size * max(deviation, 1e-300)),
        1.96 * np.sqrt(np.sum(scores**2, axis=1)) / (e.size * max(deviation, 1e-300)),
        p_value,
        share,
        float(np.sqrt(share)) * rms_nm,
        _peak_hz(full, step_s),
    )


def blocks_of(rows: npt.NDArray[np.bool_], step_s: float) -> IntArray:
    """The number of each chosen row's block of time, from 0 without gaps."""
    length = max(1, round(BLOCK_S / step_s))
    return np.asarray(np.unique(np.flatnonzero(rows) // length, return_inverse=True)[1], dtype=np.int64)


def chance_of_sum(scores: FloatArray) -> float:
    """Chance of such a sum of independent blocks with zero mean; ``scores`` (dimensions, blocks). 1 for too few."""
    dimensions, blocks = scores.shape
    if blocks <= dimensions + 1:
        return 1.0
    total = scores.sum(axis=1)
    scatter = scores @ scores.T
    distance = float(total @ np.linalg.pinv(scatter, hermitian=True) @ total)
    freedom = blocks - dimensions
    return float(f_tail(freedom / dimensions * distance / max(blocks - distance, 1e-12), dimensions, freedom))


def _shifted(values: FloatArray, lag: int) -> FloatArray:
    """The value ``lag`` steps earlier, NaN where there is none."""
    output = np.full(values.size, np.nan)
    if lag > 0:
        output[lag:] = values[:-lag]
    elif lag < 0:
        output[:lag] = values[-lag:]
    else:
        output[:] = values
    return output


def _peak_hz(values: FloatArray, step_s: float) -> float:
    """Where most of the power lies, from averaged periodograms."""
    pieces = values[: values.size // PEAK_LENGTH * PEAK_LENGTH].reshape(-1, PEAK_LENGTH)
    if not len(pieces):
        return float("nan")
    power = np.mean(np.abs(np.fft.rfft(pieces * np.hanning(PEAK_LENGTH), axis=1)) ** 2, axis=0)
    return float(np.fft.rfftfreq(PEAK_LENGTH, step_s)[int(np.argmax(power))])


# Order of the filter that takes the band's own colour away.
ORDER = 6
MEMORY_LAGS = 25


@dataclass(frozen=True)
class Memory:
    """Whether a sequence with gaps remembers itself, once the colour of a known low-pass is taken away.

    Autocorrelation at ``lags_s`` (lags,), the half width of its 95 % band for a white residual, and the sum of all:
    a portmanteau test that allows for changing variance (``p_value`` is its chance where nothing is remembered).
    """

    lags_s: FloatArray
    correlation: FloatArray
    band: FloatArray
    statistic: float
    p_value: float

    @property
    def greatest(self) -> float:
        """The greatest correlation, either way."""
        return float(np.max(np.abs(self.correlation)))


def whiten(values: FloatArray, band: Kernel, stride: int) -> FloatArray:
    """Thinned ``values`` without the colour that ``band`` gives to white noise; NaN within ORDER of a gap."""
    reach = int(np.ceil(band.half_width))
    taps = band.taps(np.arange(-reach, reach + 1, dtype=np.float64), 0)
    covariance = np.correlate(taps, taps, mode="full")[taps.size - 1 :: stride]
    known = np.zeros(ORDER + 1)
    known[: covariance.size] = covariance[: ORDER + 1]
    prediction = solve_toeplitz(known[:-1], known[1:])
    output = np.convolve(np.concatenate([[1.0], -prediction]), np.nan_to_num(values))[: values.size]
    missing = np.convolve(np.isnan(values), np.ones(ORDER + 1))[: values.size] > 0.5
    missing[:ORDER] = True
    output[missing] = np.nan
    return output


def memory(whitened: FloatArray, step_s: float) -> Memory:
    """Of a sequence with gaps as NaN. The variance of each lag is its own, so that bursts of noise are no alarm."""
    known = np.isfinite(whitened)
    centred = np.where(known, whitened - np.mean(whitened[known]), 0.0)
    power = centred**2
    total = float(np.sum(power))
    lags = range(1, MEMORY_LAGS + 1)
    products = np.array([centred[lag:] @ centred[:-lag] for lag in lags])
    variance = np.array([power[lag:] @ power[:-lag] for lag in lags])
    statistic = float(np.sum(products**2 / np.maximum(variance, 1e-300)))
    return Memory(
        np.array(lags) * step_s,
        products / max(total, 1e-300),
        1.96 * np.sqrt(variance) / max(total, 1e-300),
        statistic,
        chi2_tail(statistic, MEMORY_LAGS),
    )
