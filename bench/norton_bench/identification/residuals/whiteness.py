"""Whether a sequence with gaps remembers itself, once the colour of a known low-pass is taken away."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter
from scipy.stats import chi2

from norton_bench.arrays import FloatArray
from norton_bench.identification.kernels import Kernel

# Order of the filter that takes the band's own colour away.
ORDER = 6
MEMORY_LAGS = 25


@dataclass(frozen=True)
class Memory:
    """Autocorrelation at ``lags_s`` (lags,), the half width of its 95 % band for a white residual, and the sum of all:
    a portmanteau test that allows for changing variance (``p_value`` is its chance where nothing is remembered)."""

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
    output = np.asarray(lfilter(np.concatenate([[1.0], -prediction]), [1.0], np.nan_to_num(values)))
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
        float(chi2.sf(statistic, MEMORY_LAGS)),
    )
