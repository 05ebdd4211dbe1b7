"""What a bench measures twice must agree: two encoders on one shaft, position and velocity, sensor and load drive.

Looked at in bins of 50 ms, in which neither delays nor noise count.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.identification.separable import linear_solution
from norton_bench.identification.statistics import sandwich
from norton_bench.records import Measured, Table, has_device_clock

BIN_S = 0.05
FEWEST_BINS = 20
# One as a multiple of the other, and how well the two must agree (their correlation about zero).
SLOPE = (0.8, 1.25)
AGREEMENT = 0.8
# Below so many counts in a bin nothing is said.
TELLING_COUNTS = 20
# Two encoders on one shaft part by no more than this, beside what the torque twists.
PART_RAD = 0.035
PART_TAILS = (0.005, 0.995)
# What the load drive says it exerts, over what the sensor reads, is off by less than this.
SCALE = 3.0
SIGNIFICANT = 6.0
SLOW = 0.05
AROUND_S = 0.005


@dataclass(frozen=True)
class Bins:
    """Equal spans of time: edges (n + 1,) [ns]."""

    edges_ns: FloatArray

    @classmethod
    def of(cls, ticks: Table) -> "Bins":
        start, end = float(ticks["tick_ns"][0]), float(ticks["tick_ns"][-1])
        count = max(int((end - start) * 1e-9 / BIN_S), 1)
        return cls(np.asarray(start + np.arange(count + 1) * BIN_S * 1e9, dtype=np.float64))

    def mean(self, stamp_ns: npt.NDArray[np.int64], values: FloatArray) -> FloatArray:
        """Of what was stamped in each bin, shape (n,); NaN where nothing was."""
        count = len(self.edges_ns) - 1
        index = np.searchsorted(self.edges_ns, stamp_ns, side="right") - 1
        inside = (index >= 0) & (index < count)
        total = np.bincount(index[inside], values[inside], count)
        number = np.bincount(index[inside], minlength=count)
        return np.asarray(np.where(number > 0, total / np.maximum(number, 1), np.nan))

    def at_edges(self, table: Table, later_s: float = 0.0) -> FloatArray:
        """The position at every edge, or later, shape (n + 1,); NaN where it was not recorded nearby."""
        stamp_ns, position, at_ns = table["arrival_ns"], table["position_rad"], self.edges_ns + 1e9 * later_s
        after = np.clip(np.searchsorted(stamp_ns, at_ns), 1, len(stamp_ns) - 1)
        near = (stamp_ns[after] - stamp_ns[after - 1]) < 0.5 * BIN_S * 1e9
        near &= (at_ns >= stamp_ns[0]) & (at_ns <= stamp_ns[-1])
        return np.asarray(np.where(near, np.interp(at_ns, stamp_ns, position), np.nan))


def agreement(one: FloatArray, other: FloatArray) -> tuple[float, float]:
    """``other`` as a multiple of ``one``, and their correlation about zero; zeros where one of them is nil."""
    power = float(one @ one) * float(other @ other)
    if power == 0.0:
        return 0.0, 0.0
    product = float(one @ other)
    return product / float(one @ one), abs(product) / float(np.sqrt(power))


def contradictions(measured: Measured) -> Iterator[str]:
    """A sentence, with the remedy, for each pair that does not agree."""
    if len(measured.ticks) < 2 or len(measured.motion) < 2:
        return
    bins = Bins.of(measured.ticks)
    own = bins.at_edges(measured.motion)
    yield from _unlike_derivative(bins, measured.motion, own, "actuator")
    if len(measured.load_motion) < 2:
        return
    load = bins.at_edges(measured.load_motion)
    yield from _unlike_derivative(bins, measured.load_motion, load, "load")
    if len(measured.torque):
        torque = bins.mean(measured.torque["arrival_ns"], measured.torque["torque_nm"])
    else:
        torque = np.full(len(own) - 1, np.nan)
    around = [bins.at_edges(measured.motion, later_s) for later_s in (-AROUND_S, AROUND_S)]
    yield from _parted(own, load, (around[1] - around[0]) / (2 * AROUND_S), torque)
    command = bins.mean(measured.ticks["tick_ns"], measured.ticks["load_torque_nm"])
    yield from _out_of_scale(own, torque, command)


def _unlike_derivative(bins: Bins, table: Table, position: FloatArray, whose: str) -> Iterator[str]:
    """A drive's velocity must be the derivative of its position."""
    derived = np.diff(position) / BIN_S
    told = bins.mean(table["arrival_ns"], table["velocity_rad_s"])
    known = np.isfinite(derived) & np.isfinite(told)
    if not _telling(derived[known], table) or not np.any(told[known]):
        return
    factor, alike = agreement(derived[known], told[known])
    if alike < AGREEMENT:
        yield (
            f"The {whose}'s velocity is not the derivative of its position: check which reading is which, and the "
            "encoder."
        )
    elif not SLOPE[0] < factor < SLOPE[1]:
        yield (
            f"The {whose}'s velocity is {factor:.3g} times the derivative of its position: check the units and signs "
            "of both."
        )


def _telling(speed: FloatArray, table: Table) -> bool:
    """Whether a shaft moved enough for two speeds to be compared."""
    steps = np.abs(np.diff(table["position_rad"]))
    steps = steps[steps > 0]
    if speed.size < FEWEST_BINS or not steps.size:
        return False
    return bool(np.max(np.abs(speed)) * BIN_S > TELLING_COUNTS * np.quantile(steps, 0.01))


def _parted(own: FloatArray, load: FloatArray, own_speed: FloatArray, torque: FloatArray) -> Iterator[str]:
    """Two encoders on one shaft turn alike, part by a twist, and the twist goes with the torque.

    Positions and ``own_speed`` are at the edges of the bins, ``torque`` is in them.
    """
    speed, load_speed = np.diff(own) / BIN_S, np.diff(load) / BIN_S
    known = np.isfinite(speed) & np.isfinite(load_speed)
    if np.count_nonzero(known) < FEWEST_BINS or np.ptp(own[np.isfinite(own)]) < PART_RAD:
        return
    factor, alike = agreement(speed[known], load_speed[known])
    if alike < AGREEMENT:
        yield "Actuator and load do not turn together: check the coupling, and which reading is which."
        return
    if not SLOPE[0] < factor < SLOPE[1]:
        yield (
            f"The load turns {factor:.3g} times as fast as the actuator, on one shaft: check the units and signs "
            "(direction) of both encoders."
        )
        return
    apart = own - load
    there = np.isfinite(apart) & np.isfinite(own_speed)
    columns = np.stack([own_speed, np.ones(own.size)])[:, there]
    parted = apart[there] - linear_solution(columns, apart[there]) @ columns
    way = float(np.ptp(np.quantile(parted, PART_TAILS)))
    if way > PART_RAD:
        yield (
            f"The encoders of actuator and load part by {way:.2g} rad: one of them loses counts, or the coupling "
            "slips; check both."
        )
        return
    yield from _twisted_backwards(0.5 * (apart[1:] + apart[:-1]), speed, torque)


def _twisted_backwards(twist: FloatArray, speed: FloatArray, torque: FloatArray) -> Iterator[str]:
    """The actuator runs ahead of the load when it drives it."""
    known = np.isfinite(twist) & np.isfinite(torque)
    slow = known & (np.abs(speed) < SLOW * np.max(np.abs(speed[known]), initial=0.0))
    if np.count_nonzero(slow) < FEWEST_BINS:
        return
    compliance, deviation = _slope(np.stack([torque, speed, np.ones(speed.size)])[:, slow], twist[slow], slow)
    if compliance < -SIGNIFICANT * deviation:
        yield (
            "The shaft twists against the torque: the readings of actuator and load are swapped, or the torque's sign "
            "is wrong (direction)."
        )


def _out_of_scale(position: FloatArray, torque: FloatArray, command: FloatArray) -> Iterator[str]:
    """The load drive, commanded in N*m, must find roughly its own torque in the sensor."""
    speed = np.diff(position) / BIN_S
    change = np.gradient(speed)
    known = np.isfinite(change) & np.isfinite(torque) & np.isfinite(command)
    if np.count_nonzero(known) < FEWEST_BINS or np.ptp(command[known]) == 0:
        return
    columns = np.stack([command, change, speed, np.sign(speed), np.ones(speed.size)])[:, known]
    slope, deviation = _slope(columns, torque[known], known)
    if deviation * SIGNIFICANT > abs(slope):
        return
    if abs(slope) > SCALE or abs(slope) < 1 / SCALE:
        yield (
            f"The torque sensor reads {abs(slope):.2g} times what the load drive is commanded: check the sensor's "
            "scale and unit, and the load's."
        )
    elif slope > 0:
        yield "The torque sensor and the load drive do not agree about the sign of torque: check their directions."


def _slope(columns: FloatArray, target: FloatArray, rows: BoolArray) -> tuple[float, float]:
    """Of ``target`` over the first column beside the others, and its deviation."""
    linear = linear_solution(columns, target)
    time_s = np.asarray(np.flatnonzero(rows) * BIN_S, dtype=np.float64)
    covariance = sandwich(columns.T, target - linear @ columns, time_s)
    return float(linear[0]), float(np.sqrt(max(covariance[0, 0], 1e-300)))


# A stamp this much before another is no matter of order: the clock was set back.
SET_BACK_NS = 100_000_000
# More steps back than this are a matter of order.
MOST_JUMPS = 10
# Two clocks that part by more than this, for good, have not both been left alone.
PARTED_NS = 2_000_000
BLOCK = 64
AROUND = 8
# A stream that overruns the others by a gap of its own, to within this, was set forward there.
OVERRUN_NS = 200_000_000
LIKE_GAP = 0.1
# Clocks that differ more than this in rate are not both in nanoseconds.
RATES_DIFFER = 0.02


# Rows in the order in which they came, and where the clocks that stamped them jumped.
def in_order(table: Table, stamp: str) -> Table:
    """Rows as they came, each once: by their number where they bear one, else by their stamp."""
    if "sequence" in (table.dtype.names or ()):
        if np.all(np.diff(table["sequence"]) > 0):
            return table
        order = np.argsort(table["sequence"], kind="stable")
        again = np.diff(table["sequence"][order]) == 0
        # Rows of one number are one row, if they were stamped at once; else the numbers are none.
        if np.all(np.diff(table[stamp][order])[again] == 0):
            once: Table = table[order[np.concatenate([[True], ~again])]]
            return once
    back = np.diff(table[stamp]) < 0
    if back.any() and (np.count_nonzero(back) > MOST_JUMPS or np.diff(table[stamp]).min() > -SET_BACK_NS):
        return np.asarray(table[np.argsort(table[stamp], kind="stable")])
    return table


def jumps(table: Table, stamp: str, others_end_ns: int) -> IntArray:
    """Rows, in order, before which a clock jumped: set back, set forward, or parted from the device's own."""
    stamps = table[stamp]
    steps = np.diff(stamps)
    result = np.flatnonzero(steps < -SET_BACK_NS) + 1
    overrun = int(stamps[-1]) - others_end_ns
    widest = int(np.argmax(steps)) if steps.size else 0
    if steps.size and overrun > OVERRUN_NS and abs(int(steps[widest]) - overrun) < LIKE_GAP * overrun:
        result = np.append(result, widest + 1)
    if has_device_clock(table):
        # What a loop as slow as the sensor reads of a serial line has waited for it, for up to a period.
        least_ns = max(PARTED_NS, float(np.median(steps)) if steps.size else 0.0)
        result = np.append(result, _partings((stamps - table["device_ns"]).astype(np.float64), least_ns))
    return np.unique(result)


def useless_device_clock(table: Table, stamp: str) -> bool:
    """Whether the device's clock stands still or runs at another rate than the host's."""
    reach = min(BLOCK, len(table) - 1)
    host, own = (table[name][reach:] - table[name][: len(table) - reach] for name in (stamp, "device_ns"))
    return bool(reach == BLOCK and abs(np.median(own / np.maximum(host, 1)) - 1.0) > RATES_DIFFER)


def longest(count: int, breaks: IntArray) -> slice:
    """The longest part of so many rows between breaks."""
    edges = np.concatenate([[0], breaks, [count]])
    part = int(np.argmax(np.diff(edges)))
    return slice(int(edges[part]), int(edges[part + 1]))


def _partings(difference: FloatArray, least_ns: float) -> IntArray:
    """Where the difference of two clocks changes for good by more than ``least_ns``; late readings come and go."""
    blocks = len(difference) // BLOCK
    if blocks < 2 * AROUND:
        return np.empty(0, dtype=np.int64)
    middle = np.median(difference[: blocks * BLOCK].reshape(blocks, BLOCK), axis=1)
    around = np.lib.stride_tricks.sliding_window_view(middle, AROUND)
    level = np.median(around, axis=1)
    change = np.abs(level[AROUND:] - level[:-AROUND])
    result = []
    while change.size and change.max() > least_ns:
        at = int(np.argmax(change))
        first, last = at * BLOCK, (at + 2 * AROUND) * BLOCK
        result.append(first + 1 + int(np.argmax(np.abs(np.diff(difference[first:last])))))
        change[max(at - 2 * AROUND, 0) : at + 2 * AROUND] = 0.0
    return np.array(sorted(result), dtype=np.int64)
