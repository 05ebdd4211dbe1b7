"""What of a residual goes with the shaft's position: lines by their periods a turn."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification import cogging
from norton_bench.identification.residuals.dependence import SIGNIFICANCE, blocks_of, chance_of_sum

# Position is drawn with up to so many periods a turn; at most so many lines of it are named.
MOST_PERIODS = 256
MOST_HARMONICS = 3
# A harmonic is looked for while the shaft is slow enough for it to pass the band: its frequency in cycles a tick.
HIGHEST_CYCLES = 0.1
LEAST_HARMONIC_S = 2.0
# A harmonic of a shaft that hardly travels is no different from a constant: the mean of its phasor must stay below.
LARGEST_MEAN_PHASOR = 0.5


@dataclass(frozen=True)
class Harmonic:
    """A part of the residual that follows the shaft's position; ``p_value`` allows for all that were looked at."""

    periods_per_turn: float
    amplitude_nm: float
    p_value: float


def position_harmonics(
    residual: FloatArray, position_rad: FloatArray, velocity_rad_s: FloatArray, step_s: float, tick_s: float
) -> tuple[FloatArray, tuple[Harmonic, ...]]:
    """Amplitude by whole periods a turn (MOST_PERIODS,), and the harmonics that are no chance, the greatest first.

    Of sequences (n,) at every ``step_s``, NaN in ``residual`` where there is none; ``tick_s`` is the tick of its band.
    """
    rows = np.isfinite(residual)
    position, left = position_rad[rows], residual[rows] - np.nanmean(residual)
    cycles = np.abs(velocity_rad_s[rows]) * tick_s / (2 * np.pi)
    block = blocks_of(rows, step_s)
    spectrum = _spectrum(position, left, cycles, step_s)
    harmonics: list[Harmonic] = []
    for _ in range(MOST_HARMONICS):
        periods = cogging.strongest_period(position, left, 1.0)
        if periods is None:
            break
        slow = cycles * periods < HIGHEST_CYCLES
        angle = periods * position[slow]
        pair = np.stack([np.cos(angle), np.sin(angle)])
        scores = np.array([np.bincount(block[slow], wave * left[slow]) for wave in pair], dtype=np.float64)
        used = np.bincount(block[slow], minlength=scores.shape[1]) > 0
        p_value = min(1.0, looked_at(position) * chance_of_sum(scores[:, used]))
        if not p_value < SIGNIFICANCE:
            break
        weights = np.linalg.lstsq(pair @ pair.T, pair @ left[slow], rcond=None)[0]
        harmonics.append(Harmonic(periods, float(np.hypot(*weights)), p_value))
        left = left - weights @ np.stack([np.cos(periods * position), np.sin(periods * position)])
    return spectrum, tuple(harmonics)


def looked_at(position: FloatArray) -> float:
    """How many different lines a search over position has to choose from."""
    return cogging.MOST_PERIODS * max(1.0, float(np.ptp(position)) / (2 * np.pi))


def _spectrum(position: FloatArray, residual: FloatArray, cycles: FloatArray, step_s: float) -> FloatArray:
    """Amplitude by periods a turn; NaN where it cannot be told."""
    amplitude = np.full(MOST_PERIODS, np.nan)
    # Slowest first: the more periods a turn, the fewer of the samples are slow enough.
    order = np.argsort(cycles)
    ascending = cycles[order]
    turn = np.exp(1j * position[order])
    phasor, values = np.ones_like(turn), residual[order]
    for periods in range(1, MOST_PERIODS + 1):
        count = int(np.searchsorted(ascending, HIGHEST_CYCLES / periods))
        if count * step_s < LEAST_HARMONIC_S:
            break
        phasor = phasor[:count] * turn[:count]
        if abs(np.mean(phasor)) < LARGEST_MEAN_PHASOR:
            amplitude[periods - 1] = 2 * abs(phasor @ values[:count]) / count
    return amplitude
