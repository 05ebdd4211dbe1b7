"""Torque that goes with the shaft's position: found in what nothing else explains, by its periods in a turn.

Magnets and teeth give integers; a gear train gives any number, so the search is over all of them.
"""

import numpy as np

from norton_bench.arrays import FloatArray

BINS_A_TURN = 2048
MOST_PERIODS = 400.0
# Fewer turns, and what slow friction does looks like a period.
FEWEST_TURNS = 3.0
# Power over that of noise: noise alone passes it in one search of thousands, so long as residuals are nearly white.
EVIDENCE = 25.0
# A wave smaller than this share of the residual is not worth its two unknowns, however sure it is.
LEAST_SHARE = 0.1
# Nearer to an integer than the turns can resolve is that integer.
RESOLVED = 0.5


def strongest_period(position_rad: FloatArray, residual: FloatArray, correlated: float) -> float | None:
    """Periods a turn of the strongest line of ``residual`` over position, both (n,); None where none stands out.

    ``correlated`` is how many neighbouring residuals count as one.
    """
    first = float(np.min(position_rad))
    turns = (float(np.max(position_rad)) - first) / (2 * np.pi)
    if turns < FEWEST_TURNS:
        return None
    bins = ((position_rad - first) / (2 * np.pi) * BINS_A_TURN).astype(np.int64)
    sums = np.bincount(bins, residual - np.mean(residual))
    length = 2 ** int(np.ceil(np.log2(2 * sums.size)))
    spectrum = np.abs(np.fft.rfft(sums, length)) ** 2 / (correlated * np.sum(residual**2))
    periods = np.arange(spectrum.size) * (BINS_A_TURN / length)
    searched = (periods >= 1 - RESOLVED / turns) & (periods <= MOST_PERIODS)
    best = int(np.argmax(np.where(searched, spectrum, 0.0)))
    share = 2.0 * np.sqrt(correlated * spectrum[best] / residual.size)
    if spectrum[best] < EVIDENCE or share < LEAST_SHARE:
        return None
    whole = float(np.round(periods[best]))
    return whole if abs(whole - periods[best]) < RESOLVED / turns else float(periods[best])
