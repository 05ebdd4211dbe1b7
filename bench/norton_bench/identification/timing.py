"""When a stream's readings were taken, recovered from when they arrived.

A device samples at regular instants of its own clock; transport adds a delay and a jitter. The instants are found by a
robust fit of a slowly bending line of arrival against the device's own stamps, or, where it sends none, against a
count of its readings in which losses are seen as gaps. The mean transport delay stays in: it is the same for
all readings of a stream, and the fit estimates it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray, IntArray
from norton_bench.identification import noise

# Two clocks drift apart by parts in a million, and the drift itself changes over tens of seconds.
KNOT_S = 20.0
# After a silence longer than this many periods, the count of readings cannot be trusted and starts anew.
LONGEST_COUNTED_GAP = 50
# A stalled host hands over at most so many readings at once; later than that they were lost.
LATE_READINGS = 40
FEW_READINGS = 8
TRIMMED_ROUNDS = 4
TRIMMED_AT = 3.0
NORMAL_OF_MEDIAN_DEVIATION = 1.4826
# Deviations from which readings are taken to be uneven: neighbours of one difference err alike, which makes deviations
# seem smaller than they are by up to two.
SIGNIFICANT = 8.0


def nominal_period_s(arrival_ns: IntArray) -> float:
    """The time between two readings [s]: the mean of the usual ones, for arrivals may be bunched."""
    steps = np.diff(arrival_ns) * 1e-9
    if not steps.size:
        return float("nan")
    span = _usual_span(arrival_ns)
    return float(span if span > 0 else np.median(steps))


def sampled_at_s(arrival_ns: IntArray, device_ns: IntArray | None, origin_ns: int) -> FloatArray:
    """When each reading was taken plus the stream's mean delay [s since ``origin_ns``], shape (n,).

    ``device_ns`` are the device's own stamps, or None where it sends none.
    """
    own = None if device_ns is None else np.asarray(device_ns, dtype=np.int64).tobytes()
    return _sampled_at_s(np.asarray(arrival_ns, dtype=np.int64).tobytes(), own, origin_ns).copy()


@lru_cache(maxsize=4)  # records that are simulated for the deviations have the stamps of the one that was measured
def _sampled_at_s(arrival: bytes, own: bytes | None, origin_ns: int) -> FloatArray:
    arrival_ns: IntArray = np.frombuffer(arrival, dtype=np.int64)
    arrival_s = np.asarray((arrival_ns - origin_ns) * 1e-9, dtype=np.float64)
    if own is not None:
        device_ns: IntArray = np.frombuffer(own, dtype=np.int64)
        return _on_host_clock(np.asarray((device_ns - device_ns[0]) * 1e-9, dtype=np.float64), arrival_s)
    period_s = nominal_period_s(arrival_ns)
    times_s = np.empty_like(arrival_s)
    starts = np.flatnonzero(np.diff(arrival_s) > LONGEST_COUNTED_GAP * period_s) + 1
    for part in np.split(np.arange(arrival_s.size), starts):
        ticks = count_readings(arrival_s[part], period_s)
        times_s[part] = _on_host_clock(ticks * period_s, arrival_s[part])
    return times_s


def travel_s(arrival_ns: IntArray) -> FloatArray:
    """How much longer than on average each reading travelled [s], shape (n,), as its arrival tells."""
    arrival_s = np.asarray((arrival_ns - arrival_ns[0]) * 1e-9, dtype=np.float64)
    return arrival_s - sampled_at_s(arrival_ns, None, int(arrival_ns[0]))


def taken_late_s(time_s: FloatArray, late_s: FloatArray, value: FloatArray) -> FloatArray:
    """How much later than at even instants readings were taken, as far as their arrivals tell [s], shape (n,).

    A drive that reads when a command arrives, and answers, takes its readings unevenly: a share of the time which
    command and answer travelled together. Where the value moves, that shows: value = path + share · rate · late, looked
    at in differences in which no path shows. ``time_s`` (n,) are the even instants, ``late_s`` (n,) how much longer
    each reading travelled. All zero where that share is not significant.
    """
    usual_s = _usual(late_s)
    if time_s.size <= noise.ORDER:
        return np.zeros(time_s.size)
    read = np.diff(value, noise.ORDER)
    shown = np.diff(np.gradient(value, time_s) * usual_s, noise.ORDER)
    power = max(float(shown @ shown), 1e-300)
    share = float(read @ shown) / power
    std = float(np.linalg.norm((read - share * shown) * shown)) / power
    return min(share, 1.0) * usual_s if share > SIGNIFICANT * std else np.zeros(time_s.size)


def _usual(late_s: FloatArray) -> FloatArray:
    """The same without what is later or earlier than nearly all: a stalled host hands over late what was taken in
    time."""
    middle = np.median(late_s)
    deviation = NORMAL_OF_MEDIAN_DEVIATION * np.median(np.abs(late_s - middle))
    return np.where(np.abs(late_s - middle) <= TRIMMED_AT * deviation, late_s, 0.0)


def _usual_span(arrival_ns: IntArray) -> float:
    """The period from blocks of readings without a loss: the median over blocks of their mean step [s]."""
    block = min(64, arrival_ns.size - 1)
    spans = (arrival_ns[block:] - arrival_ns[:-block]) * 1e-9 / block
    return float(np.median(spans))


def count_readings(arrival_s: FloatArray, period_s: float) -> FloatArray:
    """The number of each reading on its device's clock (n,): neighbours one apart, or more where some were lost."""
    from norton_bench.identification import loops  # noqa: PLC0415  (compiled: slow to import)

    return np.asarray(loops.count_readings(arrival_s, period_s, LATE_READINGS))


def _on_host_clock(device_s: FloatArray, arrival_s: FloatArray) -> FloatArray:
    """The device's time on the host's clock, by a robust piecewise linear fit of their difference.

    A few readings alone tell no more than when they arrived.
    """
    if arrival_s.size < FEW_READINGS:
        return arrival_s
    difference = arrival_s - device_s
    hats = _hats(device_s)
    chosen = np.ones(device_s.size, dtype=bool)
    fitted = difference
    for _ in range(TRIMMED_ROUNDS):
        fitted = _piecewise_line(hats, difference, chosen)
        residual = difference - fitted
        centre = np.median(residual)
        deviation = NORMAL_OF_MEDIAN_DEVIATION * np.median(np.abs(residual - centre))
        before, chosen = chosen, np.abs(residual - centre) <= TRIMMED_AT * deviation + 1e-9
        if np.array_equal(before, chosen):
            break
    return np.asarray(device_s + fitted)


@dataclass(frozen=True)
class _Hats:
    """Hats over equally spaced knots: each instant lies behind knot ``index``, at ``share`` of the way to the next."""

    index: IntArray
    share: FloatArray
    knots: int


def _hats(x: FloatArray) -> _Hats:
    knots = np.linspace(x[0], x[-1], max(2, round((x[-1] - x[0]) / KNOT_S) + 1))
    index = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    return _Hats(index, (x - knots[index]) / (knots[index + 1] - knots[index]), len(knots))


def _piecewise_line(hats: _Hats, y: FloatArray, chosen: npt.NDArray[np.bool_]) -> FloatArray:
    """Least squares line through the hats, fitted on the chosen points, at all points."""
    matrix = np.zeros((hats.knots, hats.knots))
    right = np.zeros(hats.knots)
    count = hats.knots - 1
    reference = float(np.mean(y[chosen]))
    left, rest, target = hats.index[chosen], hats.share[chosen], y[chosen] - reference
    at = np.arange(count)
    for offset, weight in ((0, 1 - rest), (1, rest)):
        right[at + offset] += np.bincount(left, weight * target, count)
        matrix[at + offset, at + offset] += np.bincount(left, weight * weight, count)
    matrix[at, at + 1] = matrix[at + 1, at] = np.bincount(left, (1 - rest) * rest, count)
    heights = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return np.asarray(reference + heights[hats.index] * (1 - hats.share) + heights[hats.index + 1] * hats.share)
