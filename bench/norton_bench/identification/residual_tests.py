"""What the residual of a fit still tells: whether it remembers itself, and which measured signal it follows.

The residual lives in the fit's band: neighbouring samples are alike even if nothing is wrong. So it is thinned to the
band and freed of the colour that the fit's own low-pass gives to white noise; only then is whiteness judged. Variances
may change over time (the encoder's noise weighs more where the shaft accelerates): no test assumes otherwise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_toeplitz

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.distributions import chi2_tail, f_tail
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.results import FitResult
from norton_bench.identification.rows import Aligned, align
from norton_bench.identification.signals import Signals
from norton_bench.identification.turns import SEARCHED_PERIODS, is_new, strongest_period
from norton_bench.identification.validation import network_trace

INPUT_LAGS = range(-4, 9)
# Sums over blocks this long are taken as independent of each other.
BLOCK_S = 0.5
BLOCKS_PER_LAG = 4
PEAK_LENGTH = 128
# What happens less often than this by chance is said to be so.
SIGNIFICANCE = 0.01


# Whether a residual follows an input: tests whose blocks judge themselves, so that neither colour nor bursts alarm.
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


# Whether a sequence with gaps remembers itself, once the colour of a known low-pass is taken away.
@dataclass(frozen=True)
class Memory:
    """Autocorrelation at ``lags_s`` (lags,), the half width of its 95 % band for a white residual, and ``p_value``, the
    chance of their sum where nothing is remembered: a portmanteau test that allows for changing variance.
    """

    lags_s: FloatArray
    correlation: FloatArray
    band: FloatArray
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
        chi2_tail(statistic, MEMORY_LAGS),
    )


# Position is drawn with up to so many periods a turn; at most so many lines of it are named.
MOST_PERIODS = 256
MOST_HARMONICS = 3
# A harmonic is looked for while the shaft is slow enough for it to pass the band: its frequency in cycles a tick.
HIGHEST_CYCLES = 0.1
LEAST_HARMONIC_S = 2.0
# A harmonic of a shaft that hardly travels is no different from a constant: the mean of its phasor must stay below.
LARGEST_MEAN_PHASOR = 0.5


# What of a residual goes with the shaft's position: lines by their periods a turn.
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
        periods = strongest_period(position, left, 1.0)
        if periods is None or not is_new(periods, [each.periods_per_turn for each in harmonics], position):
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
    return SEARCHED_PERIODS * max(1.0, float(np.ptp(position)) / (2 * np.pi))


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


# Thinned by this, the samples are as many as the band holds.
STRIDE = 3
# Inputs that hold the encoder's noise.
OWN_NOISE = ("velocity", "acceleration")
# Slower than this share of the fastest is rest: no direction.
REST_SHARE = 0.005


@dataclass(frozen=True)
class ResidualTests:
    """All tests of one residual. ``spectrum_nm`` (MOST_PERIODS,) is amplitude by periods a turn, from 1 on; NaN where
    the shaft did not turn enough, or too fast, to tell.

    ``memory`` is None where the residual is one of the motion itself: the encoder's noise, differentiated twice, is
    coloured by nature.
    """

    rms_nm: float
    memory: Memory | None
    dependences: tuple[Dependence, ...]
    harmonics: tuple[Harmonic, ...]
    spectrum_nm: FloatArray


@dataclass(frozen=True)
class Thinned:
    """Signals on one uniform grid, gaps as NaN: residual (n,), each input (n,), the shaft's position and velocity."""

    step_s: float
    residual: FloatArray
    inputs: Mapping[str, FloatArray]
    position_rad: FloatArray
    velocity_rad_s: FloatArray


def diagnose(result: FitResult, stretches: tuple[Signals, ...]) -> ResidualTests | None:
    """Of what the network of a fit leaves of ``stretches``; None where too little was fitted to judge."""
    told = network_trace(result, stretches, free_motion=result.ratios_only)
    ends = np.cumsum([len(stretch.time_s) for stretch in stretches])[:-1]
    parts = np.split(told.measured - told.predicted, ends)
    return residual_tests(parts, align(stretches, result.motion_delay_s), of_motion=result.ratios_only)


def residual_tests(
    residual: Sequence[FloatArray], stretches: Sequence[Aligned], *, of_motion: bool = False
) -> ResidualTests | None:
    """Of residuals (n,), one a stretch, NaN where nothing was fitted; None where too few are left to judge.

    A residual ``of_motion`` shares its noise with velocity and acceleration, and follows them for that alone: neither
    they nor its memory are then looked at.
    """
    together = _thinned(residual, stretches)
    whitened = whiten(together.residual, FULL_BAND, STRIDE)
    if np.count_nonzero(np.isfinite(whitened)) < 10 * MEMORY_LAGS:
        return None
    rms = float(np.sqrt(np.nanmean(together.residual**2)))
    dependences = []
    for name, values in together.inputs.items():
        if of_motion and name in OWN_NOISE:
            continue
        result = dependence(whitened, whiten(values, FULL_BAND, STRIDE), together.step_s, name, rms)
        if result is not None:
            dependences.append(result)
    spectrum, harmonics = position_harmonics(
        together.residual, together.position_rad, together.velocity_rad_s, together.step_s, together.step_s / STRIDE
    )
    remembered = None if of_motion else memory(whitened, together.step_s)
    return ResidualTests(rms, remembered, tuple(dependences), harmonics, spectrum)


def _thinned(residual: Sequence[FloatArray], stretches: Sequence[Aligned]) -> Thinned:
    """All stretches on the thinned grid, kept apart by gaps longer than any lag."""
    gap = np.full(MEMORY_LAGS + ORDER, np.nan)

    def joined(parts: Sequence[FloatArray]) -> FloatArray:
        return np.concatenate([piece for part in parts for piece in (part[::STRIDE], gap)])

    fastest = max(float(np.max(np.abs(each.velocity_rad_s))) for each in stretches)
    direction = [
        each.rows.of_tick_signal(np.sign(each.velocity_rad_s) * (np.abs(each.velocity_rad_s) > REST_SHARE * fastest))
        for each in stretches
    ]
    velocity = joined([each.velocity_rad_s for each in stretches])
    return Thinned(
        step_s=STRIDE * stretches[0].signals.tick_s,
        residual=joined(residual),
        inputs={
            "command": joined([each.command for each in stretches]),
            "velocity": velocity,
            "acceleration": joined([each.acceleration_rad_s2 for each in stretches]),
            "direction": joined(direction),
        },
        position_rad=joined([each.position_rad for each in stretches]),
        velocity_rad_s=velocity,
    )
