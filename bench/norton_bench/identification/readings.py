"""What readings are worth: when they were taken, how noisy they are, and which only repeat an earlier one."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.ndimage import minimum_filter1d

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.records import Table

Lags = TypeVar("Lags", FloatArray, IntArray)

# Two clocks drift apart by parts in a million, and the drift itself changes over tens of seconds.
KNOT_S = 20.0
# A line below all arrivals must be long enough to meet early ones. A crystal that warms changes its rate by some 0.8
# parts in a million within two minutes: that moves a clock by 12 µs aside of a straight line.
KNOT_BELOW_S = 120.0
BENDS_S = 12e-6
# Delays are compared between blocks of so many readings: a quarter of a second at 1 kHz.
DELAY_BLOCK = 256
# After a silence longer than this many periods, the count of readings cannot be trusted and starts anew.
LONGEST_COUNTED_GAP = 50
# Readings that are late come in the end, lost ones never: so many that follow are asked. A host that stalls for
# LONGEST_COUNTED_GAP hands over as many late ones, and it stalls several times in a row.
LATE_READINGS = 10 * LONGEST_COUNTED_GAP
FEW_READINGS = 8
TRIMMED_ROUNDS = 4
TRIMMED_AT = 3.0
NORMAL_OF_MEDIAN_DEVIATION = 1.4826
# Medians of many independent normal values scatter by so much more than their means; of even ones about as much.
MEDIAN_OF_NORMAL = 1.2533
# Even of FEW_READINGS blocks the scatter is known to a quarter: twice what independent delays make is three deviations.
DEPENDENT = 2.0
# Deviations from which readings are taken to be uneven: neighbours of one difference err alike, which makes deviations
# seem smaller than they are by up to two.
SIGNIFICANT = 8.0


# When a stream's readings were taken, recovered from when they arrived.
#
# A device samples at regular instants of its own clock; transport adds a delay and a jitter. The instants are found
# by a robust fit of a slowly bending line of arrival against the device's own stamps, or, where it sends none,
# against a count of its readings in which losses are seen as gaps. The mean transport delay stays in: it is the same
# for all readings of a stream, and the fit estimates it.
#
# Bytes on a serial line bear no stamp: they arrive when the loop looks, up to a tick after they came. That wait stays
# the same for long where sensor and loop are about as fast, and then leaps by any part of a tick: the loop paused, or
# the phases have passed each other. No mean tells such a delay. But clocks do not leap, and nothing arrives before it
# was sent: the sensor's own stamps are put on the host's clock by the highest line below all arrivals (Moon, Skelly and
# Towsley 1999, "Estimation and removal of clock skew from network delay measurements"), and the least delay stays in.
def nominal_period_s(arrival_ns: IntArray) -> float:
    """The time between two readings [s]: the median over blocks of their mean step, for arrivals may be bunched."""
    steps = np.diff(arrival_ns) * 1e-9
    if not steps.size:
        return float("nan")
    block = min(64, steps.size)
    span = np.median((arrival_ns[block:] - arrival_ns[:-block]) * 1e-9 / block)
    return float(span if span > 0 else np.median(steps))


def sampled_at_s(arrival_ns: IntArray, device_ns: IntArray | None, origin_ns: int) -> FloatArray:
    """When each reading was taken plus the stream's mean delay [s since ``origin_ns``], shape (n,).

    ``device_ns`` are the device's own stamps, or None where it sends none. Where those readings waited for the loop, it
    is the least delay.
    """
    own = None if device_ns is None else np.asarray(device_ns, dtype=np.int64).tobytes()
    return _sampled_at_s(np.asarray(arrival_ns, dtype=np.int64).tobytes(), own, origin_ns).copy()


@lru_cache(maxsize=4)  # records that are simulated for the deviations have the stamps of the one that was measured
def _sampled_at_s(arrival: bytes, own: bytes | None, origin_ns: int) -> FloatArray:
    arrival_ns: IntArray = np.frombuffer(arrival, dtype=np.int64)
    arrival_s = np.asarray((arrival_ns - origin_ns) * 1e-9, dtype=np.float64)
    if own is not None:
        device_ns: IntArray = np.frombuffer(own, dtype=np.int64)
        return _by_own_clock(np.asarray((device_ns - device_ns[0]) * 1e-9, dtype=np.float64), arrival_s)
    period_s = nominal_period_s(arrival_ns)
    times_s = np.empty_like(arrival_s)
    starts = np.flatnonzero(np.diff(arrival_s) > LONGEST_COUNTED_GAP * period_s) + 1
    for part in np.split(np.arange(arrival_s.size), starts):
        ticks = count_readings(arrival_s[part], period_s)
        times_s[part] = _on_host_clock(ticks * period_s, arrival_s[part])
    return times_s


def taken_late_s(time_s: FloatArray, late_s: FloatArray, value: FloatArray) -> FloatArray:
    """How much later than at even instants readings were taken, as far as their arrivals tell [s], shape (n,).

    A drive that reads when a command arrives, and answers, takes its readings unevenly: a share of the time which
    command and answer travelled together. Where the value moves, that shows: value = path + share · rate · late, looked
    at in differences in which no path shows. ``time_s`` (n,) are the even instants, ``late_s`` (n,) how much longer
    each reading travelled. All zero where that share is not significant.
    """
    usual_s = _usual(late_s)
    if time_s.size <= NOISE_ORDER:
        return np.zeros(time_s.size)
    read = np.diff(value, NOISE_ORDER)
    shown = np.diff(np.gradient(value, time_s) * usual_s, NOISE_ORDER)
    power = max(float(shown @ shown), 1e-300)
    share = float(read @ shown) / power
    std = float(np.linalg.norm((read - share * shown) * shown)) / power
    return min(share, 1.0) * usual_s if share > SIGNIFICANT * std else np.zeros(time_s.size)


def _usual(late_s: FloatArray) -> FloatArray:
    """The same without what is later or earlier than nearly all: what a stalled host handed over was taken in time."""
    middle = np.median(late_s)
    deviation = NORMAL_OF_MEDIAN_DEVIATION * np.median(np.abs(late_s - middle))
    return np.where(np.abs(late_s - middle) <= TRIMMED_AT * deviation, late_s, 0.0)


def count_readings(arrival_s: FloatArray, period_s: float) -> FloatArray:
    """The number of each reading on its device's clock (n,): neighbours one apart, or more where some were lost."""
    from norton_bench.identification import loops  # noqa: PLC0415  (compiled: slow to import)

    return np.asarray(loops.count_readings(least_to_come(arrival_s - np.arange(arrival_s.size) * period_s), period_s))


def least_to_come(lags: Lags) -> Lags:
    """The least of each lag (n,) and the next LATE_READINGS: what all of them share is a loss, not lateness."""
    result: Lags = minimum_filter1d(lags, LATE_READINGS, origin=-(LATE_READINGS // 2), mode="nearest")
    return result


def _on_host_clock(device_s: FloatArray, arrival_s: FloatArray) -> FloatArray:
    """The device's time on the host's clock, by a robust piecewise linear fit of their difference.

    A few readings alone tell no more than when they arrived.
    """
    if arrival_s.size < FEW_READINGS:
        return arrival_s
    difference = arrival_s - device_s
    basis = _linear_basis(device_s)
    chosen = np.ones(device_s.size, dtype=bool)
    fitted = difference
    for _ in range(TRIMMED_ROUNDS):
        fitted = _piecewise_line(basis, difference, chosen)
        residual = difference - fitted
        centre = np.median(residual)
        deviation = NORMAL_OF_MEDIAN_DEVIATION * np.median(np.abs(residual - centre))
        before, chosen = chosen, np.abs(residual - centre) <= TRIMMED_AT * deviation + 1e-9
        if np.array_equal(before, chosen):
            break
    return np.asarray(device_s + fitted)


def _by_own_clock(device_s: FloatArray, arrival_s: FloatArray) -> FloatArray:
    """The time of a device that has a clock, on the host's, however long its readings waited for the loop."""
    time_s = _on_host_clock(device_s, arrival_s)
    return device_s + _line_below(device_s, arrival_s - device_s) if _waits(arrival_s - time_s) else time_s


def _waits(late_s: FloatArray) -> bool:
    """Whether delays (n,) differ from block to block by more than independent delays would, and by enough to matter."""
    count = late_s.size // DELAY_BLOCK
    if count < FEW_READINGS:
        return False
    blocks = late_s[: count * DELAY_BLOCK].reshape(count, DELAY_BLOCK)
    medians = np.median(blocks, axis=1)
    within = NORMAL_OF_MEDIAN_DEVIATION * float(np.median(np.abs(blocks - medians[:, None])))
    independent = MEDIAN_OF_NORMAL * within / float(np.sqrt(DELAY_BLOCK))
    return float(np.std(medians)) > max(DEPENDENT * independent, BENDS_S)


def _line_below(x: FloatArray, y: FloatArray) -> FloatArray:
    """The line below all points whose mean is the highest, at all points: a linear program of each block's lowest.

    No wait is longer than a tick: a block in which one reading is a whole period earlier than most has wrong stamps.
    """
    from scipy.optimize import linprog  # noqa: PLC0415  (slow to import)

    blocks = np.pad(y, (0, -y.size % DELAY_BLOCK), mode="edge").reshape(-1, DELAY_BLOCK)
    sound = np.min(blocks, axis=1) > np.median(blocks, axis=1) - np.median(np.diff(x))
    chosen = np.flatnonzero(sound if np.count_nonzero(sound) > FEW_READINGS else sound | True)
    lowest = np.minimum(chosen * DELAY_BLOCK + np.argmin(blocks[chosen], axis=1), y.size - 1)
    basis, reference = _linear_basis(x, KNOT_BELOW_S), float(np.min(y))
    hats = np.stack([basis.at(heights)[lowest] for heights in np.eye(basis.knots)], axis=1)
    # In microseconds, for the solver's tolerance is absolute.
    found = linprog(-hats.mean(axis=0), A_ub=hats, b_ub=1e6 * (y[lowest] - reference), bounds=(None, None))
    return basis.at(1e-6 * np.asarray(found.x, dtype=np.float64), reference)


@dataclass(frozen=True)
class _LinearBasis:
    """Hats over equally spaced knots: each instant lies behind knot ``index``, at ``share`` of the way to the next."""

    index: IntArray
    share: FloatArray
    knots: int

    def at(self, heights: FloatArray, reference: float = 0.0) -> FloatArray:
        """The line of these ``heights`` (knots,) above ``reference``, at all instants."""
        return np.asarray(reference + heights[self.index] * (1 - self.share) + heights[self.index + 1] * self.share)


def _linear_basis(x: FloatArray, knot_s: float = KNOT_S) -> _LinearBasis:
    knots = np.linspace(x[0], x[-1], max(2, round((x[-1] - x[0]) / knot_s) + 1))
    index = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    return _LinearBasis(index, (x - knots[index]) / (knots[index + 1] - knots[index]), len(knots))


def _piecewise_line(basis: _LinearBasis, y: FloatArray, chosen: npt.NDArray[np.bool_]) -> FloatArray:
    """Least squares line through the basis functions, fitted on the chosen points, at all points."""
    matrix = np.zeros((basis.knots, basis.knots))
    right = np.zeros(basis.knots)
    count = basis.knots - 1
    reference = float(np.mean(y[chosen]))
    left, rest, target = basis.index[chosen], basis.share[chosen], y[chosen] - reference
    at = np.arange(count)
    for offset, weight in ((0, 1 - rest), (1, rest)):
        right[at + offset] += np.bincount(left, weight * target, count)
        matrix[at + offset, at + offset] += np.bincount(left, weight * weight, count)
    matrix[at, at + 1] = matrix[at + 1, at] = np.bincount(left, (1 - rest) * rest, count)
    heights = np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)
    return basis.at(heights, reference)


def one_a_period(table: Table) -> Table:
    """Readings that a driver said again because no message came, put where the sensor left one out.

    A sensor that sends its value where that has changed says by its silence that it has not. A message that is
    merely late looks alike at first: what was said again in its place is one reading too many, after which all that
    follow seem to be a period later. Which it was shows when the late ones have come.

    A table of readings in which one follows the other by a period, as the sensor took them.

    Messages are counted by their arrivals; those that are missing between two stand for the value before them,
    where the driver said anything again there. Tables of sensors that leave nothing out are returned as they are,
    and those whose rows bear no numbers of their own.
    """
    again = np.flatnonzero(np.diff(table["sequence"]) == 0) + 1
    if not again.size or np.any(table["torque_nm"][again] != table["torque_nm"][again - 1]):
        return table
    messages = np.setdiff1d(np.arange(len(table)), again)
    arrival_ns = table["arrival_ns"][messages]
    period_s = nominal_period_s(table["arrival_ns"])
    number = count_readings((arrival_ns - arrival_ns[0]) * 1e-9, period_s).astype(np.int64)
    # Where nothing was said again the sensor itself was silent, or messages were lost: a gap stays one.
    left_out = np.where(np.diff(messages) > 1, np.diff(number) - 1, 0)
    rows = np.repeat(np.arange(messages.size), np.append(left_out, 0) + 1)
    regular: Table = table[messages][rows]
    places = np.flatnonzero(np.diff(rows, prepend=-1))  # of the messages themselves
    regular["arrival_ns"] = np.interp(np.arange(rows.size), places, arrival_ns - arrival_ns[0]).round() + arrival_ns[0]
    regular = np.concatenate([regular, table[messages[-1] + 1 :]])  # after the last message nothing tells
    regular["sequence"] = np.arange(len(regular))
    return regular


# Motion and torque change too slowly to show in an eighth difference; of independent errors it has C(16, 8) times the
# variance.
NOISE_ORDER = 8
NOISE_VARIANCE = 12870.0
NOISE_BLOCK = 100
NOISE_FEWEST_BLOCKS = 5
# Errors that grow with the speed, of readings taken at instants that nobody knows just so, make some blocks noisier by
# far than most: then the mean counts, for it is what pulls at a fit. A shock is no noise: it is a few readings of a
# block, and the block's median square (for normal errors so much less than their mean square) passes it over.
NOISE_UNEVEN = 2.0
NORMAL_MEDIAN_SQUARE = 0.4549


def noise_deviation(values: FloatArray, chosen: npt.NDArray[np.bool_]) -> float:
    """How noisy a stream of readings is, told by the readings themselves.

    Standard deviation of one reading's own error where ``chosen``, both of shape (n,); 0 where too few are left.

    The median over blocks of readings, so that a shock or a lost reading here and there does not count; their mean
    where some blocks are much noisier throughout.
    """
    if values.size <= NOISE_ORDER:
        return 0.0
    squares = np.diff(values, NOISE_ORDER)[chosen[NOISE_ORDER // 2 : -(NOISE_ORDER // 2)]] ** 2
    blocks = squares[: squares.size // NOISE_BLOCK * NOISE_BLOCK].reshape(-1, NOISE_BLOCK)
    if len(blocks) < NOISE_FEWEST_BLOCKS:
        return 0.0
    usual = float(np.median(np.mean(blocks, axis=1)))
    mean = float(np.mean(np.median(blocks, axis=1))) / NORMAL_MEDIAN_SQUARE
    return float(np.sqrt((mean if mean > NOISE_UNEVEN * usual else usual) / NOISE_VARIANCE))
