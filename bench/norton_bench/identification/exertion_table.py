"""The impedance as tables: what the port exerts held away from its source, and how it answers to being shaken there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.errors import ExperimentError
from norton_bench.identification.averages import (
    T_95,
    Branch,
    Mean,
    Setting,
    Sweep,
    Swept,
    both_ways,
    inside,
    line_amplitudes,
    mean_of,
    modulations_of,
    setting_in,
    swept,
    torque_in,
)
from norton_bench.identification.counts import resolution_of
from norton_bench.identification.load import LoadFit, fit_load
from norton_bench.records import Measured, SegmentInfo
from norton_bench.segments import HOLD, READ, TABULATE_IMPEDANCE, Use

# Names of its other segments: "sweep rising", "sweep falling", as those held.
SHAKE, SWEEP = "shake", "sweep"
# Whole numbers of periods a second, no one twice or thrice another; above a tenth of the loop's rate nothing is asked.
LINES_HZ = (2.0, 5.0, 11.0, 23.0, 47.0)
# What is measured of a shake begins here and lasts this long: whole periods of all lines, without its ends.
SHAKEN_FROM_S, SHAKEN_S = 0.3, 2.0
# Only the last part of a hold counts: before, friction and spring still settle.
HELD_SHARE = 0.5
# Places nearer than this share of the widest step are one.
SAME_PLACE = 0.3
# A torque of this share of the greatest, and of so many deviations, is one.
TOUCH_SHARE = 0.05
TOUCH_DEVIATIONS = 3.0
# Up to this share of the greatest torque, a spring is as good as straight: a few places alone are as noisy as readings.
NEAR_SHARE = 0.5
# A port that is no stiffer exerts nothing at all.
SOFTEST_NM_RAD = 1e-9
# Draws of what a repetition might have given, for the intervals of where the torque begins.
DRAWS = 400


@dataclass(frozen=True)
class Held:
    """The port held at ``displacement_rad`` (θ − θ_N) from the source of its setting, reached ``rising`` or falling."""

    setting: Setting
    displacement_rad: float
    rising: bool
    torque: Mean


@dataclass(frozen=True)
class Shaken:
    """The port's dynamic stiffness −τ/θ [N m/rad] at a frequency, about a place; the half-width is of either part."""

    setting: Setting
    displacement_rad: float
    frequency_hz: float
    stiffness_nm_rad: complex
    half_width_nm_rad: float


@dataclass(frozen=True)
class Zeros:
    """Between these displacements [rad] from the source the port exerts nothing: none wide for a spring.

    ``spacing_rad`` is how far the places lie apart that tell: what is no wider than that is no gap, but may be a curve
    between them.
    """

    low_rad: float
    high_rad: float
    width: Mean
    spacing_rad: float

    def loosened(self, by_rad: float) -> "Zeros":
        """The same, known less well; nothing is added where nobody knows how much."""
        by_rad = by_rad if np.isfinite(by_rad) else 0.0
        return replace(self, width=Mean(self.width.value, self.width.half_width + by_rad))

    @property
    def edges(self) -> tuple[float, float]:
        return self.low_rad, self.high_rad

    @property
    def is_gap(self) -> bool:
        return self.width.value - self.width.half_width > self.spacing_rad


@dataclass(frozen=True)
class SpringLine:
    """What the port exerts near its source, in few numbers.

    ``stiffness`` [N m/rad] is the slope of −τ over displacement on either side of the zeros, ``hysteresis_nm`` half of
    the greatest difference between the two directions, each place held; ``sweep`` is None where it was not swept, and
    ``zeros``, from the sweep if there is one, where one side was not reached.
    """

    setting: Setting
    source: Mean
    stiffness: Mean
    hysteresis_nm: float
    zeros: Zeros | None
    sweep: Sweep | None = None


@dataclass(frozen=True)
class ExertionTable:
    """All that was read, by setting (rounded); ``sources`` are where the free port rested."""

    held: tuple[Held, ...]
    shaken: tuple[Shaken, ...]
    sources: dict[Setting, Mean]
    swept: tuple[Swept, ...] = ()

    @property
    def settings(self) -> tuple[Setting, ...]:
        """By command, then by modulation."""
        return tuple(sorted(self.sources))

    @property
    def modulations(self) -> tuple[float | None, ...]:
        """In increasing order; (None,) without a modulator."""
        return modulations_of(self.sources)

    def branch(self, setting: Setting, rising: bool) -> Branch:
        """Displacement [rad], torque [N m] and its half-width in one direction, by displacement: (places,) each."""
        own = [held for held in self.held if held.setting == setting.rounded and held.rising is rising]
        own.sort(key=lambda held: held.displacement_rad)
        rows = [(held.displacement_rad, held.torque.value, held.torque.half_width) for held in own]
        table = np.array(rows, dtype=float).reshape(-1, 3)
        return table[:, 0], table[:, 1], table[:, 2]

    def curve(self, setting: Setting) -> Branch:
        """The mean of both directions wherever either was held and both reach: displacement, torque, half-width."""
        rising, falling = self.branch(setting, True), self.branch(setting, False)
        if not (rising[0].size and falling[0].size):
            return rising if rising[0].size else falling
        places = _apart(np.concatenate([rising[0], falling[0]]))
        low, high = (end(rising[0]) for end in (np.min, np.max))
        low, high = max(low, np.min(falling[0])), min(high, np.max(falling[0]))
        slack = SAME_PLACE * float(np.max(np.diff(places), initial=0.0))
        places = places[(places >= low - slack) & (places <= high + slack)]
        means = [sum(np.interp(places, side[0], side[k]) for side in (rising, falling)) / 2 for k in (1, 2)]
        return places, np.asarray(means[0]), np.asarray(means[1])

    def hysteresis_nm(self, setting: Setting) -> float:
        """Half of the greatest difference between the directions; NaN where one is missing."""
        places, _, _ = self.curve(setting)
        rising, falling = self.branch(setting, True), self.branch(setting, False)
        if not (rising[0].size and falling[0].size and places.size):
            return float("nan")
        apart = np.interp(places, *rising[:2]) - np.interp(places, *falling[:2])
        return float(np.max(np.abs(apart))) / 2

    def exertion_nm(self, setting: Setting, displacement_rad: float) -> float:
        """Mean torque at a displacement from the source, by straight lines; NaN beyond what was measured."""
        displacement, torque, _ = self.curve(setting)
        return float(np.interp(displacement_rad, displacement, torque, left=np.nan, right=np.nan))

    def lines(self) -> tuple[SpringLine, ...]:
        """One for each setting."""
        return tuple(self._line(setting) for setting in self.settings)

    def sweep(self, setting: Setting) -> Sweep | None:
        """Both ways across, the last that were made; None where there are not both, of one place at least in common."""
        own = {each.rising: each for each in self.swept if each.setting == setting.rounded}
        result = both_ways(own[True], own[False]) if len(own) == 2 else None
        return result if result is not None and result.mean[0].size else None

    def _line(self, setting: Setting) -> SpringLine:
        branches = [self.branch(setting, rising) for rising in (True, False)]
        sweep = self.sweep(setting)
        zeros = _zeros(branches) if sweep is None else _swept_zeros(sweep)
        stiffness = _slope(branches, zeros)
        if zeros is not None and sweep is not None:
            zeros = zeros.loosened(abs(sweep.friction.value) / max(abs(stiffness.value), SOFTEST_NM_RAD))
        return SpringLine(setting, self.sources[setting], stiffness, self.hysteresis_nm(setting), zeros, sweep)


def shake_lines(tick_s: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies [Hz] and amplitudes, which sum up to 1, of the small shaking; shape (lines,) each."""
    frequency_hz = np.array([line for line in LINES_HZ if line <= 0.1 / tick_s] or LINES_HZ[:1])
    amplitude = frequency_hz**-0.5
    return frequency_hz, amplitude / amplitude.sum()


def exertion_table(measured: Measured, tick_s: float) -> ExertionTable:
    """From every hold and shake. Raises ExperimentError where there is none.

    Shaking is read with the load's encoder, whose delay and whose spring to the port the calibration has told; without
    a calibration in the recording only the holds are tabulated.
    """
    if not any(
        segment.procedure == TABULATE_IMPEDANCE and segment.name.startswith(HOLD) for segment in measured.segments
    ):
        raise ExperimentError(f"no exertion was tabulated: run the step '{TABULATE_IMPEDANCE}'")
    count_rad = resolution_of(measured.motion["position_rad"]).width
    load = _load(measured, tick_s)
    held, shaken, sources, ways = list[Held](), list[Shaken](), dict[Setting, Mean](), list[Swept | None]()
    for segment in measured.segments:
        if segment.procedure != TABULATE_IMPEDANCE:
            continue
        setting = setting_in(measured, segment).rounded
        position = mean_of(inside(measured.motion, segment)["position_rad"], count_rad / 2)
        if segment.name == READ:
            sources[setting] = position
        elif segment.name.startswith(HOLD):
            held.append(_held(measured, segment, setting, sources[setting].value))
        elif segment.name == SHAKE and load is not None:
            shaken += _shaken(measured, segment, load, setting, position.value - sources[setting].value, tick_s)
        elif segment.name.startswith(SWEEP):
            ticks = inside(measured.ticks, segment, "tick_ns")
            ways.append(swept(ticks, setting, "rising" in segment.name, sources[setting].value))
    return ExertionTable(tuple(held), tuple(shaken), sources, tuple(way for way in ways if way is not None))


def _load(measured: Measured, tick_s: float) -> LoadFit | None:
    if not any(segment.use is Use.CALIBRATE for segment in measured.segments):
        return None
    return fit_load(measured, tick_s)


def _held(measured: Measured, segment: SegmentInfo, setting: Setting, source_rad: float) -> Held:
    start_ns = round(segment.end_ns - HELD_SHARE * (segment.end_ns - segment.start_ns))
    late = measured.between(start_ns, segment.end_ns)
    position_rad = float(np.mean(late.motion["position_rad"]))
    return Held(setting, position_rad - source_rad, "rising" in segment.name, torque_in(late, segment))


def _shaken(
    measured: Measured, segment: SegmentInfo, load: LoadFit, setting: Setting, displacement_rad: float, tick_s: float
) -> Iterator[Shaken]:
    """At every line: torque over the angle on the actuator's side of the sensor, both in the torque's time."""
    start_ns = segment.start_ns + round(SHAKEN_FROM_S * 1e9)
    part = measured.between(start_ns, start_ns + round(SHAKEN_S * 1e9))
    torque, motion = part.torque[part.torque["valid"]], part.load_motion
    frequency_hz, _ = shake_lines(tick_s)
    omega = 2 * np.pi * frequency_hz
    torque_nm, deviation_nm = line_amplitudes((torque["arrival_ns"] - start_ns) * 1e-9, torque["torque_nm"], omega)
    angle_rad, _ = line_amplitudes((motion["arrival_ns"] - start_ns) * 1e-9, motion["position_rad"], omega)
    angle_rad = angle_rad * np.exp(1j * omega * load.result.motion_delay_s)
    angle_rad = angle_rad + torque_nm / (load.sensor_stiffness_nm_rad + 1j * omega * load.sensor_damping_nms_rad)
    for line, (exerted, angle) in enumerate(zip(torque_nm, angle_rad, strict=True)):
        half = 1.96 * deviation_nm / abs(angle)
        yield Shaken(setting, displacement_rad, float(frequency_hz[line]), complex(-exerted / angle), float(half))


def _apart(places: FloatArray) -> FloatArray:
    """Each place once, increasing: those that differ by little of a step are one, which control did not quite meet."""
    ordered = np.sort(places)
    steps = np.diff(ordered)
    if not steps.size:
        return ordered
    groups = np.split(ordered, np.flatnonzero(steps > SAME_PLACE * np.max(steps)) + 1)
    return np.array([np.mean(group) for group in groups])


def _slope(branches: Sequence[Branch], zeros: Zeros | None) -> Mean:
    """Of parallel straight lines, one in each direction on either side of the zeros, by what they leave of −τ."""
    parts = [(x, y) for x, y, _ in branches]
    if zeros is not None:
        parts = [(x[side], y[side]) for x, y in parts for side in (x >= zeros.high_rad, x <= zeros.low_rad)]
    parts = [(x - x.mean(), y - y.mean()) for x, y in parts if x.size > 1]
    free = sum(x.size - 1 for x, _ in parts) - 1
    if free < 1:
        return Mean(float("nan"), float("nan"))
    x, y = (np.concatenate(each) for each in zip(*parts, strict=True))
    slope = float(x @ y / (x @ x))
    deviation = float(np.sqrt(np.sum((y - slope * x) ** 2) / free / (x @ x)))
    return Mean(-slope, t_quantile(0.975, free) * deviation)


def _swept_zeros(sweep: Sweep) -> Zeros | None:
    """In the middle between the mean of both ways, where friction blurs the edges inwards, and either way by itself.

    By itself each shows its edges further apart: what slides is late.
    """
    mean, by_itself = _zeros([sweep.mean]), _zeros(sweep.ways)
    if mean is None or by_itself is None:
        return None
    low_rad, high_rad = (0.5 * sum(ends) for ends in zip(mean.edges, by_itself.edges, strict=True))
    width_rad = 0.5 * (mean.width.value + by_itself.width.value)
    return replace(mean, low_rad=low_rad, high_rad=high_rad, width=Mean(width_rad, mean.width.half_width))


def _zeros(branches: Sequence[Branch]) -> Zeros | None:
    """The mean of both directions, so that friction at the port, which shifts them apart, drops out."""
    edges = [_edges(*branch) for branch in branches if branch[0].size]
    result = [each for each in edges if each is not None]
    if not result or len(result) < len(edges):
        return None
    low, high = np.mean(result, axis=0)
    width = np.maximum(high - low, 0.0)
    half = float(np.ptp(np.quantile(width[1:], (0.025, 0.975)))) / 2
    spacing_rad = max(_widest_step(places, float(low[0]), float(high[0])) for places, _, _ in branches)
    return Zeros(float(low[0]), float(high[0]), Mean(float(width[0]), half), spacing_rad)


def _widest_step(places: FloatArray, low: float, high: float) -> float:
    """Beside the zeros: across a gap the port may jump."""
    steps = (np.diff(side) for side in (places[places <= low], places[places >= high]))
    return float(np.max(np.concatenate(list(steps)), initial=0.0))


def _edges(displacement: FloatArray, torque: FloatArray, half: FloatArray) -> FloatArray | None:
    """Where the port begins to resist on either side, (2, 1 + DRAWS): as read, and as a repetition might have given it.

    There the line through the places with torque meets zero, up to half of the greatest torque of that side: two at
    least, and within what was reached. None where a side has fewer.
    """
    least_nm = max(TOUCH_SHARE * float(np.max(np.abs(torque))), TOUCH_DEVIATIONS * float(np.max(half)) / T_95)
    random = np.random.default_rng(1)
    draws = torque + random.standard_normal((DRAWS, torque.size)) * half / T_95
    values, edges = np.vstack([torque, draws]), []
    for side in (-1.0, 1.0):
        touching = np.flatnonzero((-side * torque > least_nm) & (side * displacement > side * np.median(displacement)))
        if touching.size < 2:
            return None
        touching = touching[np.argsort(side * displacement[touching])]
        weak = np.count_nonzero(np.abs(torque[touching]) <= NEAR_SHARE * np.max(np.abs(torque[touching])))
        near = touching[: max(weak, 2)]
        places = displacement[near] - np.mean(displacement[near])
        slope = values[:, near] @ places / np.sum(places**2)
        edges.append(np.mean(displacement[near]) - np.mean(values[:, near], axis=1) / slope)
    return np.asarray(np.clip(np.array(edges), np.min(displacement), np.max(displacement)))
