"""From raw streams to one uniform grid: every signal at the same instants, each with its own clock undone.

The grid has the tick's period and the torque stream's time (arrival less jitter, mean delay included). Command and
motion have other delays; the fit estimates both relative to the torque.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray, IntArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.counts import NO_STEPS, Resolution, moving, resolution_of, unquantised
from norton_bench.identification.fed_back import near_limit
from norton_bench.identification.kernels import TABLE_PER_UNIT, Kernel
from norton_bench.identification.readings import noise_deviation, nominal_period_s, sampled_at_s, taken_late_s
from norton_bench.records import Measured, Table, has_device_clock, sent_ns
from norton_bench.segments import Use
from norton_drivers.servo import Servo

# The motion is known this many times a tick: between its samples the friction's path is taken as straight.
FINE = 4
# Wide enough to leave everything below a quarter of the sampling rate as it is.
INTERPOLATION = Kernel(cutoff=0.36, half_width=12.0)
# Of a motion, everything below a third: where a shaft turns round, a path with less of its fast motion travels less
# far, and friction along it is late.
OF_MOTION = Kernel(cutoff=0.45, half_width=12.0)
LONGEST_GAP_S = 0.05
# Readings further apart than so many periods have one missing between them.
LONGEST_STEP = 1.5
# Around each of those a few are left out: with this share of them, everything.
MOST_UNEVEN = 0.25
UNEVEN_QUANTILES = (0.05, 0.95)
Span = tuple[float, float]  # begin and end [s]
SHORTEST_STRETCH_TICKS = 100
# Rows of a shaft that hardly moves are left out, unless little else would remain.
LEAST_MOVING_SHARE = 0.1
# After a rest of this length nobody knows what the friction holds; it is known again where the motion tells.
FORGETS_AFTER_S = 0.1
# A servo at its limit gives another torque than its equation for as long as delays, its amplifier's lag and the fit's
# low-pass reach.
LIMIT_LASTS_TICKS = 20
# A shaft that begins to move has moved a little already when it shows.
BEFORE_MOVING_TICKS = 10


class Port(Enum):
    """Whose port is looked at: the torque sensor is the boundary of both machines."""

    ACTUATOR = "actuator"
    LOAD = "load"


@dataclass(frozen=True)
class Signals:
    """One stretch of time without gaps; arrays of shape (n,), but motions (n · FINE,) and commands (m,).

    ``position_rad`` is as read, for velocity and acceleration (counting makes it noisy, but not wrong);
    ``path_rad`` is smoothed within the encoder's counts, for friction, which minds every turning back.
    ``usable`` marks what may be fitted; the rest is there because friction and amplifier remember it. ``rests`` are the
    ends of longer rests, as indices of ``time_s``; within a rest counts do not tell what becomes of the friction.
    ``torque_nm`` and ``current`` are None where nothing measures them; current comes as it was read, for drives report
    it more slowly than anything can be interpolated. ``smoothed`` are the readings that ``path_rad`` comes from.
    """

    tick_s: float
    origin_ns: int
    time_s: FloatArray
    position_rad: FloatArray
    path_rad: FloatArray
    sent_s: FloatArray
    command: FloatArray
    segment: IntArray
    usable: BoolArray
    rests: IntArray
    torque_nm: FloatArray | None = None
    current: "TimeSeries | None" = None
    position_noise: float = 0.0  # spectral density of the readings' own errors [rad²/Hz], two-sided
    torque_noise: float = 0.0  # [N² m²/Hz]
    position_period_s: float = 0.0  # between two readings
    torque_period_s: float = 0.0
    torque_averaging_s: float = 0.0  # over which the sensor itself averages, or how old its held readings may be
    smoothed: "TimeSeries | None" = None
    counts: Resolution = NO_STEPS  # in which positions are read
    released_at_zero: bool = False  # the drive: as in records.Chain
    servo: Servo | None = None  # its own loop, likewise


def signals(
    measured: Measured, tick_s: float, use: Use, port: Port = Port.ACTUATOR, *, of_both: bool = False
) -> tuple[Signals, ...]:
    """The stretches in which something may be fitted. Raises ExperimentError where nothing was measured.

    ``of_both``: only where neither machine's readings were interrupted, so that each has the same stretches.
    """
    motion = measured.motion if port is Port.ACTUATOR else measured.load_motion
    if not len(motion) or not len(measured.ticks):
        raise ExperimentError(f"no motion of the {port.value} was recorded: run an experiment that moves it")
    origin_ns = int(measured.ticks["tick_ns"][0])
    counts = resolution_of(np.asarray(motion["position_rad"], dtype=np.float64))
    streams = _streams(measured, motion, port, origin_ns, counts)
    runs_s = [(measured.ticks["tick_ns"] - origin_ns) * 1e-9]
    runs_s += [stream.time_s for name, stream in streams.items() if name != "current"]
    if of_both:
        runs_s += [instants(table, origin_ns)[0] for table in (measured.motion, measured.load_motion)]
    stretches = [
        _stretch(measured, streams, tick_s, use, port, origin_ns, span)
        for span in _common_spans(runs_s)
        if span[1] - span[0] >= SHORTEST_STRETCH_TICKS * tick_s
    ]
    useful = tuple(stretch for stretch in stretches if stretch.usable.any())
    if not useful:
        uneven = _uneven(streams["position"], f"the {port.value}'s motion")
        raise ExperimentError(
            uneven or f'nothing was recorded to be used for "{use.value}": run the procedures that measure it'
        )
    return useful


def validation_stretches(measured: Measured, tick_s: float) -> tuple[Signals, ...]:
    """What is kept for validation; nothing where the session has no such step."""
    if all(segment.use is not Use.VALIDATE for segment in measured.segments):
        return ()
    try:
        return signals(measured, tick_s, Use.VALIDATE)
    except ExperimentError:
        return ()


def _uneven(stream: "TimeSeries", name: str) -> str:
    """What is wrong with readings of which most come after a gap; empty where that is not so."""
    steps_s = np.diff(stream.time_s)
    if np.count_nonzero(steps_s > LONGEST_STEP * stream.period_s) <= MOST_UNEVEN * steps_s.size:
        return ""
    shortest_ms, longest_ms = 1e3 * np.quantile(steps_s, UNEVEN_QUANTILES)
    return (
        f"readings of {name} come too unevenly for a fit, {shortest_ms:.2g} to {longest_ms:.2g} ms apart: choose a "
        "lower [rig] rate, and see with `rig check` how long answers take"
    )


@dataclass(frozen=True)
class TimeSeries:
    """Readings with the instants at which they were taken [s]."""

    time_s: FloatArray
    value: FloatArray
    period_s: float
    steps: Resolution = NO_STEPS  # in which values come

    def at(self, grid_s: FloatArray) -> FloatArray:
        """Interpolated, band-limited; a straight line where readings are missing."""
        from norton_bench.identification import loops  # noqa: PLC0415  (compiled: slow to import)

        time_s, value = self._filled()
        table = INTERPOLATION.table()
        return np.asarray(loops.resample(time_s, value, self.period_s, grid_s, table, TABLE_PER_UNIT))

    def motion_at(self, other: "TimeSeries", grid_s: FloatArray) -> FloatArray:
        """The same of a motion, and another one whose readings were taken at the same instants, (2, n)."""
        from norton_bench.identification import loops  # noqa: PLC0415  (compiled: slow to import)

        (time_s, value), (_, of_other), table = self._filled(), other._filled(), OF_MOTION.table()
        return np.asarray(loops.resample_both(time_s, value, of_other, self.period_s, grid_s, table, TABLE_PER_UNIT))

    def _filled(self) -> tuple[FloatArray, FloatArray]:
        steps = np.diff(self.time_s)
        gaps = np.flatnonzero((steps > LONGEST_STEP * self.period_s) & (steps < LONGEST_GAP_S))
        if not gaps.size:
            return self.time_s, self.value
        missing = [
            np.linspace(self.time_s[gap], self.time_s[gap + 1], round(steps[gap] / self.period_s) + 1)[1:-1]
            for gap in gaps
        ]
        time_s = np.sort(np.concatenate([self.time_s, *missing]))
        return time_s, np.interp(time_s, self.time_s, self.value)

    def between(self, start_s: float, end_s: float) -> "TimeSeries":
        """The readings of a span."""
        first, last = np.searchsorted(self.time_s, [start_s, end_s])
        return replace(self, time_s=self.time_s[first:last], value=self.value[first:last])

    def covers(self, grid_s: FloatArray) -> BoolArray:
        """Where no reading is missing within the kernel's main lobe."""
        gaps = np.flatnonzero(np.diff(self.time_s) > LONGEST_STEP * self.period_s)
        covered = np.ones(grid_s.size, dtype=bool)
        for gap in gaps:
            reach = 3 * self.period_s
            first, last = np.searchsorted(grid_s, [self.time_s[gap] - reach, self.time_s[gap + 1] + reach])
            covered[first:last] = False
        return covered


def _streams(
    measured: Measured, motion: Table, port: Port, origin_ns: int, counts: Resolution
) -> dict[str, TimeSeries]:
    position = positions_of(motion, origin_ns)
    smooth = unquantised(position.value, counts.width)
    streams = {
        "position": replace(position, steps=counts),
        "path": replace(position, value=smooth),
        "moving": replace(position, value=moving(smooth, counts.width).astype(float)),
    }
    torque = measured.torque[measured.torque["valid"]]
    if len(torque):
        stream = stream_of(torque, "torque_nm", origin_ns)
        sign = 1.0 if port is Port.ACTUATOR else -1.0
        streams["torque"] = replace(stream, value=sign * stream.value)
    if len(measured.current) and port is Port.ACTUATOR:
        streams["current"] = stream_of(measured.current, "current_a", origin_ns)
    return streams


def stream_of(table: Table, column: str, origin_ns: int) -> TimeSeries:
    """One column of a table of readings, by the device's own clock where it sends its time."""
    time_s, rows = instants(table, origin_ns)
    value = np.ascontiguousarray(table[column], dtype=float)
    return TimeSeries(time_s, value[rows], nominal_period_s(table["arrival_ns"]))


def positions_of(table: Table, origin_ns: int) -> TimeSeries:
    """An encoder's readings, as they would be at even instants: without what the shaft turned in the time by which they
    were taken later."""
    stream = stream_of(table, "position_rad", origin_ns)
    late_s = positions_late_s(table, origin_ns)
    if not late_s.any():
        return stream
    return replace(stream, value=stream.value - np.gradient(stream.value, stream.time_s) * late_s)


def positions_late_s(table: Table, origin_ns: int) -> FloatArray:
    """How much later than at even instants these readings were taken [s], shape (n,), as far as arrivals tell."""
    time_s, rows = instants(table, origin_ns)
    arrival_s = (table["arrival_ns"][rows] - origin_ns) * 1e-9
    value = np.asarray(table["position_rad"][rows], dtype=np.float64)
    return taken_late_s(time_s, arrival_s - time_s, value)


def sent_at_s(ticks: Table, origin_ns: int) -> FloatArray:
    """When the commands of each tick were sent [s since ``origin_ns``], shape (ticks,)."""
    return np.asarray((sent_ns(ticks) - origin_ns) * 1e-9)


def instants(table: Table, origin_ns: int) -> tuple[FloatArray, IntArray]:
    """When readings were taken [s], and which rows of the table they are: those that are later than the row before."""
    own = table["device_ns"] if has_device_clock(table) else None
    time_s = sampled_at_s(table["arrival_ns"], own, origin_ns)
    rows = np.flatnonzero(np.diff(time_s, prepend=-np.inf) > 0)
    return time_s[rows], rows


def travel_times_s(table: Table) -> FloatArray:
    """How much longer than on average readings travelled [s], of those that came before the next was due.

    Later ones were held up together by a host or an adapter that stood still: no command travels like that by chance.
    """
    origin_ns = int(table["arrival_ns"][0])
    time_s, rows = instants(table, origin_ns)
    late_s = (table["arrival_ns"][rows] - origin_ns) * 1e-9 - time_s
    return np.asarray(late_s[late_s < nominal_period_s(table["arrival_ns"])])


def _common_spans(runs_s: Sequence[FloatArray]) -> list[Span]:
    """Where all of them, instants [s] in order, go on without a long silence."""
    spans = [(-np.inf, np.inf)]
    for times in runs_s:
        breaks = np.flatnonzero(np.diff(times) > LONGEST_GAP_S)
        starts, ends = times[np.concatenate([[0], breaks + 1])], times[np.concatenate([breaks, [-1]])]
        spans = [
            (max(a, start), min(b, end))
            for a, b in spans
            for start, end in zip(starts, ends, strict=True)
            if max(a, start) < min(b, end)
        ]
    return spans


def _stretch(
    measured: Measured, streams: dict[str, TimeSeries], tick_s: float, use: Use, port: Port, origin_ns: int, span: Span
) -> Signals:
    # On whole ticks, so that grids of different machines fall on each other.
    start_s, end_s = float(np.ceil(span[0] / tick_s) * tick_s), span[1]
    count = int((end_s - start_s) / tick_s)
    time_s = np.asarray(start_s + np.arange(count) * tick_s, dtype=np.float64)
    fine_s = np.asarray(start_s + np.arange(count * FINE) * (tick_s / FINE), dtype=np.float64)
    torque = streams.get("torque")
    sent_s, command = _sent(measured, port, origin_ns, (start_s, end_s))
    segment, in_use = _segments(measured, origin_ns, time_s, use)
    usable, moves = _usable(streams, time_s, in_use)
    position_rad, path_rad = streams["position"].motion_at(streams["path"], fine_s)
    servo = measured.chain.servo if port is Port.ACTUATOR else None
    if servo is not None:
        usable &= _below_limit(servo, streams["path"].at(time_s), time_s, sent_s, command)
    return Signals(
        tick_s=tick_s,
        origin_ns=origin_ns,
        time_s=time_s,
        position_rad=position_rad,
        path_rad=path_rad,
        sent_s=sent_s,
        command=command,
        segment=segment,
        usable=usable,
        rests=_ends_of_rests(moves, tick_s),
        torque_nm=None if torque is None else torque.at(time_s),
        current=streams["current"].between(start_s, end_s) if "current" in streams else None,
        position_noise=_density_of_counts(streams["position"], streams["path"].value, time_s, usable),
        torque_noise=0.0 if torque is None else _density(torque, time_s, usable),
        position_period_s=streams["position"].period_s,
        torque_period_s=0.0 if torque is None else torque.period_s,
        torque_averaging_s=measured.chain.torque_averaging_s,
        smoothed=streams["path"].between(start_s - LONGEST_GAP_S, end_s + LONGEST_GAP_S),
        counts=streams["position"].steps,
        released_at_zero=port.value in measured.chain.released_at_zero,
        servo=servo,
    )


def _sent(measured: Measured, port: Port, origin_ns: int, span: Span) -> tuple[FloatArray, FloatArray]:
    """The commands of a stretch and those just before it, each with when it was sent [s]."""
    sent_s = sent_at_s(measured.ticks, origin_ns)
    chosen = (sent_s >= span[0] - LONGEST_GAP_S) & (sent_s <= span[1])
    column = "command" if port is Port.ACTUATOR else "load_torque_nm"
    return np.ascontiguousarray(sent_s[chosen]), np.ascontiguousarray(measured.ticks[column][chosen])


def _below_limit(
    servo: Servo, angle_rad: FloatArray, time_s: FloatArray, sent_s: FloatArray, command: FloatArray
) -> BoolArray:
    """Where the servo's limit does not hold its torque, (n,)."""
    return ~_lasting(near_limit(servo, sent_s, command, time_s, angle_rad), LIMIT_LASTS_TICKS)


def _usable(streams: dict[str, TimeSeries], time_s: FloatArray, in_use: BoolArray) -> tuple[BoolArray, BoolArray]:
    """At which instants readings are there and well enough known to be fitted, and at which the shaft moves."""
    covered = streams["position"].covers(time_s)
    if "torque" in streams:
        covered &= streams["torque"].covers(time_s)
    edge = round(INTERPOLATION.half_width)
    covered[:edge], covered[-edge:] = False, False
    usable = covered & in_use
    moves = np.interp(time_s, streams["moving"].time_s, streams["moving"].value) > 0.5
    well_known = usable & moves
    # A clamped shaft never moves, and still tells its gain.
    enough = np.count_nonzero(well_known) > LEAST_MOVING_SHARE * np.count_nonzero(usable)
    return (well_known if enough else usable), moves


def _lasting(held: BoolArray, ticks: int) -> BoolArray:
    """Also for so long before and after."""
    return np.asarray(np.convolve(held, np.ones(2 * ticks + 1), "same") > 0.5)


def _ends_of_rests(moves: BoolArray, tick_s: float) -> IntArray:
    """Where motion begins after a rest of at least FORGETS_AFTER_S."""
    changes = np.flatnonzero(np.diff(moves.astype(np.int8))) + 1
    edges = np.concatenate([[0], changes, [moves.size]])
    ends = edges[1:][(np.diff(edges) * tick_s >= FORGETS_AFTER_S) & ~moves[edges[:-1]]]
    return np.asarray(ends[ends < moves.size] - BEFORE_MOVING_TICKS, dtype=np.int64)


def _density(stream: TimeSeries, time_s: FloatArray, usable: BoolArray) -> float:
    """Of the readings' own errors, where they are used."""
    return noise_deviation(stream.value, _used(stream, time_s, usable)) ** 2 * stream.period_s


def _used(stream: TimeSeries, time_s: FloatArray, usable: BoolArray) -> BoolArray:
    """Which of the readings are, (n,)."""
    return np.asarray(np.interp(stream.time_s, time_s, usable, left=0.0, right=0.0) > 0.5)


def _density_of_counts(position: TimeSeries, path_rad: FloatArray, time_s: FloatArray, usable: BoolArray) -> float:
    """The same of an encoder's.

    The errors of counts are as if drawn from a step's width over many speeds, but not at each: at half a count a
    reading they alternate, and their differences show many times their variance. So what counts add to the path that
    was gone, which has the other errors still in it, is taken off, and their variance put in its place. Noise of less
    than a count may hide behind that.
    """
    if position.steps == NO_STEPS:
        return _density(position, time_s, usable)
    chosen, counted = _used(position, time_s, usable), position.steps.read(path_rad)
    seen, left, shown = (noise_deviation(each, chosen) ** 2 for each in (position.value, path_rad, counted))
    variance = max(seen - max(shown - left, 0.0), 0.0) + position.steps.variance
    return float(variance * position.period_s)


def _segments(measured: Measured, origin_ns: int, time_s: FloatArray, use: Use) -> tuple[IntArray, BoolArray]:
    """The index of each instant's segment (-1: none), and whether that segment is for ``use``."""
    index = np.full(time_s.size, -1, dtype=np.int64)
    in_use = np.zeros(time_s.size, dtype=bool)
    for segment in measured.segments:
        span = [(segment.start_ns - origin_ns) * 1e-9, (segment.end_ns - origin_ns) * 1e-9]
        first, last = np.searchsorted(time_s, span)
        index[first:last] = segment.index
        in_use[first:last] = segment.use is use
    return index, in_use
