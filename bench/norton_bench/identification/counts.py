"""Encoder counts: the steps in which positions are read, and a smooth motion that agrees with every reading."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.fft import next_fast_len
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from norton_bench.arrays import FloatArray
from norton_bench.identification.kernels import Kernel

# From the gentlest to the heaviest; cutoffs in cycles a reading.
LEVELS = (
    Kernel(0.3, 3.0),
    Kernel(0.2, 5.0),
    Kernel(0.12, 8.0),
    Kernel(0.07, 12.0),
    Kernel(0.04, 20.0),
    Kernel(0.02, 32.0),
    Kernel(0.01, 56.0),
    Kernel(0.005, 80.0),
)
EXACT_TO = 3
REACH = round(LEVELS[-1].half_width)
# A low-pass is too heavy where it departs by more than so many deviations of what counting errors alone would make it.
DEPARTS = 3.0
# Of an error that is as likely anywhere within one step, in steps.
UNIFORM_DEVIATION = 1 / np.sqrt(12)
# A low-pass that is too heavy is not trusted within this share of its half-width either.
DOUBTED_SHARE = 0.3
AT_REST_STEPS = 1.5
# From one level to the next within so many readings.
BLEND = 4
# A shaft that moves less than so many counts within so many readings counts as stuck.
MOVING_COUNTS = 8
MOVING_WITHIN = 31
SMALLEST_STEP_RAD = 1e-9
# Differences up to so many of the smallest tell the step, in places so fine. It is sought between these multiples of
# the smallest: rounding makes a step smaller or greater by less than one of its own.
TELLING_STEPS = 12
FEWEST_STEPS = 20
PLACES = 200
PERIODS, PERIODS_TRIED = (0.95, 1.6), 1301
# Steps rounded to half a count have a coherence of sinc²(0.5) = 0.41; of no counts at all, one near nil.
COHERENT = 0.35
ROUNDED = 0.05
# Counts behind a message's steps are sought within so many steps, and where one in fifty or more is never read.
WIDEST = 2**18
LEAST_SKIPPED = 0.02
# A shaft turns slowly where each of two readings came so many times as often as in this share, the fastest.
READ_TIMES, FASTEST_SHARE = 2, 0.1
# Such places are as regular, and leaps as many, as they must be to within this share; and by chance they would be so
# regular at one of WIDEST frequencies once in 10^8.
LIKE, CERTAIN = 0.3, 31.0


@dataclass(frozen=True)
class Resolution:
    """The steps in which values come: a device's counts, and those to which its messages round them once more.

    Zero where none can be seen; counts finer than the rounding never are, and it then passes for the count.
    """

    count: float = 0.0
    rounding: float = 0.0

    @property
    def width(self) -> float:
        """Within which the true value lies, about a reading."""
        return self.count + self.rounding

    @property
    def variance(self) -> float:
        """Of a reading's error, over many places."""
        return (self.count**2 + self.rounding**2) / 12.0

    def read(self, values: FloatArray, zero: float | FloatArray = 0.0) -> FloatArray:
        """Readings of values (n,), where counts begin at ``zero`` before the origin."""
        if self.count > 0.0:
            values = np.round((values + zero) / self.count) * self.count - zero
        return values if self.rounding == 0.0 else np.asarray(np.round(values / self.rounding) * self.rounding)


NO_STEPS = Resolution()


# Undoing an encoder's counts: a smooth motion that agrees with every reading.
#
# A count only says that the shaft is somewhere within one step. Taken literally, a shaft at rest on the edge of two
# counts seems to travel back and forth, and its friction to slide; where it turns round, the outermost count makes
# the way too long, and a low-pass that is too heavy makes it too short. So every stretch is smoothed as heavily as
# its counts allow: by the longest low-pass, exact on cubics, whose result differs from the readings and from all
# shorter ones by no more than counting errors explain (Lepski's rule). What is returned never leaves the steps.
def resolution_of(values: FloatArray) -> Resolution:
    """The steps in which values come, such as positions [rad].

    Counts that were rounded once more, as where a message carries an angle in hundredths of a degree, come in steps
    of unlike size. The count is then the step with which they agree best (the greatest coherence of 2π steps/p), and
    the rounding what makes them differ from it. Where a message's steps are half a count or more, all differences are
    of whole steps: then some steps are never read, and the pattern of these tells the count (``_count_behind``).
    """
    steps = np.abs(np.diff(values))
    steps = np.sort(steps[steps > SMALLEST_STEP_RAD])
    if steps.size < FEWEST_STEPS:
        return NO_STEPS
    # Rounding to a float32 makes equal steps differ a little: the smallest group, not the smallest number.
    least = float(np.median(steps[steps < 1.1 * steps[steps.size // 200]]))
    small = steps[steps < TELLING_STEPS * least]
    places, times = np.unique(np.round(small / least * PLACES), return_counts=True)
    trial = np.linspace(*PERIODS, PERIODS_TRIED)
    coherence = np.cos(2 * np.pi * np.outer(1.0 / trial, places / PLACES)) @ times / small.size
    step = least * float(trial[np.argmax(coherence)])
    if small.size < FEWEST_STEPS or np.max(coherence) < COHERENT:
        return NO_STEPS
    multiple = np.maximum(np.round(small / step), 1)
    step = float((small @ multiple) / (multiple @ multiple))
    # The difference of two errors, each anywhere within ± half of the rounding: its variance is a sixth of the square.
    rounding = float(np.sqrt(6.0 * np.mean((small - multiple * step) ** 2)))
    if rounding > ROUNDED * step:
        return Resolution(step, rounding)
    return _count_behind(values, step)


def _count_behind(values: FloatArray, step: float) -> Resolution:
    """Of values that are whole ``step``s: the counts that these round, of one to two steps.

    Counts c rounded to steps r leave one step out in 1/f, f = 1 - r/c, always the same ones. So a shaft that turns so
    slowly that every count is read several times leaps over these steps and no others, and the places of the leaps
    repeat with f: they have one phase in it, to within f of a turn.
    """
    values = values[np.isfinite(values)]
    # One that was read: from half a step on, values would be rounded either way.
    middle = np.quantile(values, 0.5, method="higher")
    places = np.round((values - middle) / step).astype(np.int64)
    places = places[np.abs(places) < WIDEST // 2]
    edges = np.flatnonzero(np.diff(places, prepend=places[0] - 1))
    read, times = places[edges], np.diff(edges, append=places.size)
    often = READ_TIMES * np.quantile(times, FASTEST_SHARE)  # a drive may send each of them twice
    slowly = (times[1:] >= often) & (times[:-1] >= often)
    leaps = np.abs(np.diff(read))[slowly]
    left_out = np.unique((read[1:] + read[:-1])[slowly][leaps == 2] // 2)
    if left_out.size < FEWEST_STEPS:
        return Resolution(step)
    size = 2 * next_fast_len(int(np.ptp(left_out)) + 1, real=True)  # lines between two frequencies show as well
    strength = np.abs(np.fft.rfft(np.bincount(left_out - left_out[0]), size)) / left_out.size
    frequency = np.arange(1, strength.size) / size
    expected = frequency / (1.0 - frequency)  # of all steps of a slow shaft those over a place that is left out
    like = (frequency > LEAST_SKIPPED) & (np.abs(np.mean(leaps == 2) - expected) < LIKE * expected)
    if not like.any():
        return Resolution(step)
    at = int(np.argmax(np.where(like, strength[1:], 0.0)))
    alike, skips = strength[1 + at], float(frequency[at])
    seen = alike > (1.0 - LIKE) * np.sinc(skips) and left_out.size * alike**2 > CERTAIN
    return Resolution(step / (1.0 - skips), step) if seen else Resolution(step)


def moving(path_rad: FloatArray, step_rad: float) -> npt.NDArray[np.bool_]:
    """Where the path leaves the counts behind, shape (n,): elsewhere they do not tell what friction holds."""
    if step_rad == 0.0:
        return np.ones(path_rad.size, dtype=bool)
    return np.asarray(_travelled(path_rad, MOVING_WITHIN) > MOVING_COUNTS * step_rad)


def unquantised(position_rad: FloatArray, step_rad: float) -> FloatArray:
    """A smooth motion within ± half a step of the readings, shape (n,)."""
    if step_rad == 0.0 or position_rad.size <= 2 * REACH:
        return position_rad
    half_rad, path = 0.5 * step_rad, position_rad
    # At rest on the edge of two counts the readings change at random, and only the edge itself fits both.
    rests = _travelled(position_rad, 2 * REACH + 1) < AT_REST_STEPS * step_rad
    lighter: list[tuple[Kernel, FloatArray, FloatArray]] = []
    for level in LEVELS:
        smooth = _smoothed(position_rad, level)
        too_heavy = np.abs(smooth - position_rad) > half_rad + step_rad * _by_chance(level)
        for other, result, few_steps in lighter:
            too_heavy |= np.abs(smooth - result) > step_rad * np.maximum(_by_chance(level, other), few_steps)
        lighter.append((level, smooth, _few_counts(position_rad, step_rad, level)))
        doubted = round(DOUBTED_SHARE * level.half_width) + BLEND
        trust = uniform_filter1d(1.0 - maximum_filter1d(too_heavy & ~rests, 2 * doubted + 1), 2 * BLEND + 1)
        path = path + trust * (smooth - path)
    return np.clip(path, position_rad - half_rad, position_rad + half_rad)


@cache
def _by_chance(level: Kernel, other: Kernel | None = None) -> float:
    """By how many steps independent counting errors move this low-pass at most, or move it against another one."""
    taps = _taps(level).copy()
    if other is not None:
        inner, surplus = _taps(other), round(level.half_width) - round(other.half_width)
        taps[surplus : surplus + inner.size] -= inner
    return float(DEPARTS * UNIFORM_DEVIATION * np.linalg.norm(taps))


def _few_counts(position_rad: FloatArray, step_rad: float, level: Kernel) -> FloatArray:
    """How wrong this low-pass may be where few counts pass by within it, so that their errors do not average out:
    in steps, shape (n,)."""
    width = round(level.half_width)
    counts = width * uniform_filter1d(np.abs(np.diff(position_rad, prepend=position_rad[0])), width) / step_rad
    return np.asarray(0.5 / (1.0 + counts))


def _travelled(path_rad: FloatArray, within: int) -> FloatArray:
    """The range of the path within so many readings around each."""
    return np.asarray(maximum_filter1d(path_rad, within) - minimum_filter1d(path_rad, within), dtype=np.float64)


def _smoothed(values: FloatArray, level: Kernel) -> FloatArray:
    reach, taps = round(level.half_width), _taps(level)
    padded = np.pad(values, reach, mode="reflect", reflect_type="odd")
    return np.asarray(np.convolve(padded, taps, mode="valid"), dtype=np.float64)


@cache
def _taps(level: Kernel) -> FloatArray:
    reach = round(level.half_width)
    return level.taps(np.arange(-reach, reach + 1, dtype=np.float64), 0, exact_to=EXACT_TO)
