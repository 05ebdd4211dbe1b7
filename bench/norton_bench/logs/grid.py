"""A log on a uniform grid: cut into stretches where it has gaps, resampled where its clock is uneven."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from scipy import ndimage, signal
from scipy.interpolate import make_interp_spline

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.errors import UsageError
from norton_bench.identification.standstill import resolution
from norton_bench.logs.log import Log, untrustworthy
from norton_bench.logs.streams import GAP

# Where the map says nothing: the low-pass of the position, and the rows' rate, as shares of the sampling rate.
CUTOFF = 0.1
ROWS = 0.1
HIGHEST_CUTOFF = 0.4
SLOWEST_ROWS_HZ = 100.0
# Decimation: a sinc of this share of the new Nyquist frequency in Kaiser's window, as long as a row remembers. What is
# beyond this many rows has no part in a row at all: a sharper filter rings on, and carries every jump of friction far.
PASS = 0.8
SETTLED_ROWS = 5
# Only the motion passes the low-pass, both sides the decimation: so that it takes nothing from what is left of the
# other side, its cutoff is by this much above. There a Butterworth of 4th order, both ways, is at 0.9993.
ABOVE = 2.5
# The low-pass has settled after this many periods of its cutoff.
SETTLED_PERIODS = 2


# Zero-phase low-pass, derivatives, and the one decimation that both sides of an equation pass.
@dataclass(frozen=True)
class Filters:
    """What stands between samples every ``dt_s`` and the rows of the equation, ``factor`` samples apart.

    ``margin`` samples around anything that is not to be used are spoilt by the filters' memory.
    """

    dt_s: float
    cutoff_hz: float
    factor: int

    @classmethod
    def of(cls, dt_s: float, cutoff_hz: float | None, rows_hz: float | None, fastest_hz: float = np.inf) -> "Filters":
        """Where nothing is said of rows, they hold what is slower than ``fastest_hz``, if not less. A cutoff that the
        samples are too coarse for has no effect: it is held below half of their rate."""
        rate_hz = 1 / dt_s
        usual_hz = min(max(ROWS * rate_hz, min(SLOWEST_ROWS_HZ, rate_hz)), 2 * fastest_hz / PASS)
        rows = usual_hz if rows_hz is None else rows_hz
        factor = max(1, round(rate_hz / rows))
        usual = max(CUTOFF * rate_hz, ABOVE * 0.5 * PASS * rate_hz / factor)
        cutoff = min(usual if cutoff_hz is None else cutoff_hz, HIGHEST_CUTOFF * rate_hz)
        return cls(dt_s, cutoff, factor)

    @property
    def margin(self) -> int:
        settled = SETTLED_PERIODS / (self.cutoff_hz * self.dt_s)
        return int(np.ceil(max(SETTLED_ROWS * self.factor if self.factor > 1 else 0, settled)))

    def smooth(self, values: FloatArray) -> FloatArray:
        """4th order Butterworth, forwards and backwards."""
        sos = signal.butter(4, self.cutoff_hz, fs=1 / self.dt_s, output="sos")
        return np.asarray(signal.sosfiltfilt(sos, values))

    def noise(self, part: "Stretch", name: str, sound: BoolArray) -> float:
        """The deviation of white noise in a column as it was logged, of which the low-pass takes off a known part.

        Where the log was brought to a grid, the spline has taken some of it off before: how much, such noise shows.
        """

        # What was read wrong rings in the low-pass.
        settled = ndimage.binary_erosion(sound, iterations=self.margin)
        used = settled if settled.any() else sound

        def taken(values: FloatArray) -> FloatArray:
            return (values - self.smooth(values))[used]

        if part.logged_s is None:
            pulse, passed = _pulse(self)
            left = float(np.linalg.norm(pulse - passed))
        else:
            white = np.random.default_rng(0).standard_normal(part.logged_s.size)
            left = float(np.std(taken(part.on_grid(name, white))))
        return float(np.std(taken(part.columns[name]))) / left

    def response(self, order: int) -> FloatArray:
        """Of the low-pass to one sample of size 1, derived ``order`` times, (2 m + 1,)."""
        result = _pulse(self)[1]
        for _ in range(order):
            result = slope(result, self.dt_s)
        return result

    def in_rows(self, order: int) -> float:
        """The deviation of that derivative in a row, for white noise of deviation 1 in what was logged."""
        return float(np.linalg.norm(np.convolve(self.response(order), self.kernel)))

    @property
    def kernel(self) -> FloatArray:
        """How much each sample around a row has of it, (2 m + 1,)."""
        return _kernel(self.factor)

    def decimated(self, samples: FloatArray) -> FloatArray:
        """Of shape (columns, n), filtered at every ``factor``-th sample from the first on."""
        if self.factor == 1:
            return samples
        rows = signal.upfirdn(self.kernel, samples, down=self.factor, axis=-1)
        count = -(-samples.shape[-1] // self.factor)
        return np.asarray(rows[:, SETTLED_ROWS : SETTLED_ROWS + count])


@cache
def _pulse(filters: Filters) -> tuple[FloatArray, FloatArray]:
    """One sample of size 1, and what the low-pass makes of it: long enough for all that it remembers, and for what it
    goes on with beyond its ends."""
    reach = max(2 * filters.margin, 32)
    pulse = np.asarray(signal.unit_impulse(2 * reach + 1, "mid"))
    return pulse, filters.smooth(pulse)


@cache
def _kernel(factor: int) -> FloatArray:
    if factor == 1:
        return np.ones(1)
    # Kaiser's window for a transition that ends at the new Nyquist frequency.
    taps = 2 * SETTLED_ROWS * factor + 1
    beta = signal.kaiser_beta(signal.kaiser_atten(taps, 2 * (1 - PASS) / factor))
    return np.asarray(signal.firwin(taps, PASS / factor, window=("kaiser", beta)))


def slope(values: FloatArray, dt_s: float) -> FloatArray:
    """The derivative of the spline of fifth order through all samples, shape (n,).

    Central differences lose sin(ωT)/(ωT) of every frequency, which shows as inertia: 2 % of it for EMPS at 200 Hz.
    """
    time_s = dt_s * np.arange(len(values))
    return np.asarray(make_interp_spline(time_s, values, k=5).derivative()(time_s))


def integral(values: FloatArray, dt_s: float) -> FloatArray:
    """From zero, by trapezoids, shape (n,)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * dt_s)])


# Intervals that agree this well are one: nothing is interpolated.
EVEN = 1e-3
# A stretch with fewer samples than this is left out.
SHORTEST = 50
# Not to be interpolated: they step.
HELD = ("enabled", "goal")
# A step of the position beyond this many times those around it is none of the machine's.
LEAP = 8.0
LEAP_AROUND = 3


@dataclass(frozen=True)
class Stretch:
    """A part of one log without a gap, every ``dt_s``; arrays (n,). ``sound`` says where sensors can be trusted.

    ``logged_s`` (m,) are the instants of its rows in the log, None where these are the grid.
    """

    log: Log
    dt_s: float
    time_s: FloatArray
    columns: Mapping[str, FloatArray]
    sound: BoolArray
    logged_s: FloatArray | None = None

    def on_grid(self, name: str, values: FloatArray) -> FloatArray:
        """What becomes of ``values`` (m,) in the rows of the log, in the column of this name, (n,)."""
        if self.logged_s is None:
            return values
        return _at(name, self.logged_s + self.log.shifts_s.get(name, 0.0), values, self.time_s)

    def in_log(self, name: str, column: FloatArray) -> FloatArray:
        """A column of the grid (n,) at the instants of the rows of the log, (m,); flat beyond its ends."""
        if self.logged_s is None:
            return column
        at = np.clip(self.logged_s + self.log.shifts_s.get(name, 0.0), self.time_s[0], self.time_s[-1])
        return _at(name, self.time_s, column, at)

    @property
    def motion_name(self) -> str:
        """The column that the motion is taken from: the velocity where no position was logged."""
        return "position" if "position" in self.columns else "velocity"


def usual_interval(log: Log) -> float:
    return float(np.median(np.diff(log.time_s)))


def common_interval(logs: Sequence[Log], rate_hz: float | None) -> float:
    """The interval of the grid: as asked for, or that of the log sampled fastest. UsageError for a longer one."""
    fastest = min(map(usual_interval, logs))
    if rate_hz is None:
        return fastest
    if 1 / rate_hz > fastest * (1 + GAP * EVEN):
        raise UsageError(
            f"[log] rate: {rate_hz:.6g} Hz is less than the {1 / fastest:.6g} Hz of {logs[0].place}; leave it out, and "
            "write [filter] rate for coarser rows"
        )
    return 1 / rate_hz


def stretches(log: Log, dt_s: float, gap_s: float | None) -> tuple[tuple[Stretch, ...], tuple[str, ...]]:
    """The log's parts on a grid, and what is to be said of its clock and sensors. Raises UsageError for no part."""
    wrong, remarks = untrustworthy(log)
    usual = usual_interval(log)
    steps = np.diff(log.time_s)
    gaps = steps > (gap_s or GAP * usual)
    leaps = _leaps(log) & ~gaps
    ends = np.concatenate([[0], np.flatnonzero(gaps | leaps) + 1, [len(log.time_s)]])
    parts = [slice(a, b) for a, b in pairwise(ends) if b - a >= SHORTEST]
    if not parts:
        raise UsageError(f"{log.place}: gaps leave no stretch of {SHORTEST} rows; check its time, or write [log] gap")
    sentences = list(remarks)
    if gaps.any():
        sentences.append(
            f"{log.place}: {int(gaps.sum())} gaps or jumps of the clock, the longest of {steps.max():.3g} s at "
            f"{log.time_s[int(np.argmax(steps))]:.4g} s; the log is cut there."
        )
    if leaps.any():
        sentences.append(
            f"{log.place}: a position leaps {int(leaps.sum())} times, first at "
            f"{log.time_s[int(np.argmax(leaps))]:.4g} s (rows are missing, or it wraps); the log is cut there."
        )
    return tuple(_stretch(log, dt_s, part, wrong) for part in parts), tuple(sentences)


def _leaps(log: Log) -> BoolArray:
    """Where a position goes on from somewhere else: one step far beyond those around it, shape (n − 1,)."""
    found = np.zeros(len(log.time_s) - 1, dtype=bool)
    for name in ("position", "link_position"):
        if name in log.columns and np.ptp(log.columns[name]) > 0:
            found |= _leaps_of(log.columns[name])
    return found


def _leaps_of(position: FloatArray) -> BoolArray:
    ways = np.abs(np.diff(position))
    around = np.pad(ways, LEAP_AROUND)
    beside = np.max([around[k : k + ways.size] for k in range(2 * LEAP_AROUND + 1) if k != LEAP_AROUND], axis=0)
    usual = np.percentile(ways[ways > 0], 95)
    return np.asarray((ways > LEAP * np.maximum(beside, resolution(position))) & (ways > 2 * usual))


def _stretch(log: Log, dt_s: float, part: slice, wrong: BoolArray) -> Stretch:
    time_s = log.time_s[part]
    steps = np.diff(time_s)
    columns = {name: values[part] for name, values in log.columns.items()}
    even = bool(np.all(np.abs(steps - dt_s) < EVEN * dt_s))
    if even and not log.shifts_s:
        return Stretch(log, dt_s, time_s, columns, ~wrong[part])
    grid = time_s if even else time_s[0] + dt_s * np.arange(int((time_s[-1] - time_s[0]) / dt_s + 1e-6) + 1)
    sound = np.interp(grid, time_s, wrong[part].astype(np.float64)) == 0.0
    bare = Stretch(log, dt_s, grid, {}, sound, time_s)
    return replace(bare, columns={name: bare.on_grid(name, values) for name, values in columns.items()})


def _at(name: str, time_s: FloatArray, values: FloatArray, grid: FloatArray) -> FloatArray:
    """A column at the instants of the grid: what steps is held, the rest is a cubic spline.

    Straight lines would take 1 − sinc²(f/fs) off what varies with the frequency f, which shows as too small a gain.
    """
    if name in HELD:
        return np.asarray(values[np.maximum(np.searchsorted(time_s, grid, side="right") - 1, 0)])
    return np.asarray(make_interp_spline(time_s, values, k=3)(grid))
