"""Whether this actuator's network can be told from its port without ambiguity: the paper's three conditions (IV.B, VI).

``norton_bench.networks.checks`` asks the equations of a network; here the measurements are asked, so that what the
bench did not show is not claimed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.identification.impedance_table import PARTS, ImpedanceTable
from norton_bench.identification.results import FitResult, SourceMap, Trace, Validation
from norton_bench.identification.rows import Aligned, align
from norton_bench.identification.signals import Signals
from norton_bench.identification.source_map import Settling, settling
from norton_bench.identification.without_model import WithoutModel
from norton_bench.networks.findings import VERDICTS
from norton_bench.records import Measured, SegmentInfo

# Torque within this many deviations of its noise, or this share of the loop's greatest, counts as next to none.
DEVIATIONS, SHARE = 3.0, 0.02
LEAST_STROKES = 4


# Backlash as the port shows it: a range of displacement in which it exerts nothing.
@dataclass(frozen=True)
class ZeroRange:
    """The mean width over all strokes, and its 95 % interval (Student's, of the scatter between strokes).

    ``crossing_rad`` is how far the port moves through zero at the slope that it has beside it: what is no wider
    than that is no gap, but a curve.
    """

    width_rad: float
    interval_rad: tuple[float, float]
    crossing_rad: float
    strokes: int

    @property
    def is_gap(self) -> bool:
        return self.interval_rad[0] > self.crossing_rad


def zero_range(
    stretches: Sequence[Aligned],
    segments: Sequence[SegmentInfo],
    *,
    inertia_kgm2: float,
    bias_nm: float,
    noise_nm: float,
) -> ZeroRange | None:
    """From the imposed loops; None where there are too few strokes that go through zero.

    Torque is freed of the sensor's zero, ``bias_nm``, and of what the actuator's own inertia takes. A curve that
    crosses zero stays within ± T as long as it takes from T to 2 T on both sides together; a gap comes on top of that.
    """
    loops = {each.index for each in segments if each.procedure == "imposed" and each.name.startswith("loop")}
    result: list[tuple[float, float]] = []
    for stretch in stretches:
        torque_nm = stretch.torque_nm - bias_nm + inertia_kgm2 * stretch.acceleration_rad_s2
        for stroke in _strokes(stretch, loops):
            result += _ways(torque_nm[stroke], stretch.velocity_rad_s[stroke] * stretch.signals.tick_s, noise_nm)
    if len(result) < LEAST_STROKES:
        return None
    near, beside = np.array(result).T
    widths = near - beside
    mean, deviation = float(np.mean(widths)), float(np.std(widths, ddof=1) / np.sqrt(len(widths)))
    half = t_quantile(0.975, len(widths) - 1) * deviation
    return ZeroRange(
        max(mean, 0.0), (max(mean - half, 0.0), max(mean + half, 0.0)), float(np.mean(beside)), len(widths)
    )


def _strokes(stretch: Aligned, loops: set[int]) -> Iterator[slice]:
    """From one turning point of a loop to the next."""
    for index in sorted(loops):
        inside = np.flatnonzero((stretch.signals.segment == index) & stretch.usable)
        if inside.size:
            turns = np.flatnonzero(np.diff(np.sign(stretch.velocity_rad_s[inside])) != 0) + 1
            edges = inside[0] + turns
            yield from (slice(int(first), int(last)) for first, last in pairwise(edges))


def _ways(torque_nm: FloatArray, way_rad: FloatArray, noise_nm: float) -> list[tuple[float, float]]:
    """The way within ± T of zero, and that from there to 2 T; nothing where the stroke does not go well through it."""
    limit_nm = max(DEVIATIONS * noise_nm, SHARE * float(np.max(np.abs(torque_nm))))
    if not (torque_nm.max() > 2 * limit_nm and torque_nm.min() < -2 * limit_nm):
        return []
    size = np.abs(torque_nm)
    near, beside = size <= limit_nm, (size > limit_nm) & (size <= 2 * limit_nm)
    return [(float(abs(way_rad[near].sum())), float(abs(way_rad[beside].sum())))]


Interval = tuple[float, float]

# The impedance form is usable where motion and command leave no more than this share of an unseen torque, and is not
# where they leave more than that.
USABLE, NOT_USABLE = 0.2, 0.5
# Of a step's change, still to come in the last quarter of its dwell: this little where the port settles, this much
# where it does not.
SETTLED, UNSETTLED = 0.1, 0.3
# Branches of the source that differ by less than this share of the greatest velocity are one.
SAME_BRANCH = 0.02
# Torque under unseen motion is drawn anew in blocks of this many samples, longer than its memory.
BLOCK, RESAMPLES, SEED = 500, 400, 9
TAILS = (0.025, 0.975)
CERTAIN = 0.95


@dataclass(frozen=True)
class Condition:
    """One condition: whether it holds (None: these data cannot tell), why, and the figure it was judged by.

    ``figure`` says what ``value`` is, in ``unit``; ``interval`` is of 95 %. NaN where nothing was measured.
    """

    condition: str
    holds: bool | None
    why: str
    figure: str = ""
    value: float = float("nan")
    interval: Interval = (float("nan"), float("nan"))
    unit: str = ""

    @property
    def verdict(self) -> str:
        return VERDICTS[self.holds]

    def __str__(self) -> str:
        return f"{self.condition.capitalize()}: {self.verdict}; {self.why}."


@dataclass(frozen=True)
class Evidence:
    """What the three conditions are judged from; None where it was not measured."""

    unseen: tuple[Trace, ...] = ()  # torque under motion that no fit has seen: by the network, and without a model
    table: ImpedanceTable | None = None
    source: SourceMap | None = None
    gap: ZeroRange | None = None
    settling: Settling | None = None


def conditions(evidence: Evidence) -> tuple[Condition, ...]:
    """The three of them, in the paper's order."""
    return (_impedance_form(evidence.unseen), _unique_zero(evidence), _zero_dynamics(evidence.settling))


def evidence_of(
    fit: FitResult,
    stretches: Sequence[Signals],
    measured: Measured,
    *,
    validation: Validation | None,
    modelless: WithoutModel | None,
    source: SourceMap | None,
) -> Evidence:
    """From what a recording has been fitted with; ``stretches`` are those that the fit has seen."""
    traces = (
        None if validation is None else validation.torque,
        None if modelless is None else modelless.unseen,
    )
    return Evidence(
        unseen=tuple(trace for trace in traces if trace is not None and np.isfinite(trace.predicted).any()),
        table=None if modelless is None else modelless.table,
        source=source,
        gap=_gap(fit, stretches, measured),
        settling=settling(measured),
    )


def _gap(fit: FitResult, stretches: Sequence[Signals], measured: Measured) -> ZeroRange | None:
    if fit.ratios_only or any(stretch.torque_nm is None for stretch in stretches):
        return None
    return zero_range(
        align(stretches, fit.motion_delay_s),
        measured.segments,
        inertia_kgm2=fit.network.inertia_kgm2,
        bias_nm=fit.torque_bias_nm,
        noise_nm=fit.torque_rms_nm,
    )


def _impedance_form(unseen: Sequence[Trace]) -> Condition:
    name, figure = (
        "impedance form",
        "share of the torque, kept apart from the fit, that motion and command leave unexplained",
    )
    if not unseen:
        return Condition(name, None, "no torque was measured under an imposed motion that was kept apart from the fit")
    share, interval = min((_left_over(trace) for trace in unseen), key=lambda result: result[0])
    holds = usable(interval)
    why = {
        True: "the torque follows from the measured motion and the command, also for motion kept apart from the fit",
        False: "most of the torque follows neither from the motion nor from the command",
        None: "part of the torque is explained by nothing here: another friction, or noise",
    }[holds]
    return Condition(name, holds, why, figure, share, interval, "")


def usable(share: Interval) -> bool | None:
    """Whether what is left over is so little that the rest can be used; None where the interval leaves that open."""
    if share[1] <= USABLE:
        return True
    return False if share[0] > NOT_USABLE else None


def _left_over(trace: Trace) -> tuple[float, Interval]:
    """Rms of what is not predicted over that of the torque, and its interval by drawing blocks anew."""
    known = np.isfinite(trace.measured) & np.isfinite(trace.predicted)
    return share_left((trace.measured - trace.predicted)[known], trace.measured[known], BLOCK)


def share_left(error: FloatArray, torque: FloatArray, block: int) -> tuple[float, Interval]:
    """Rms of an error over that of the torque, (samples,) each, and its interval by drawing blocks of samples anew."""
    blocks = max(2, error.size // block)
    sums = np.array(
        [(np.sum(e**2), np.sum(t**2)) for e, t in zip(np.array_split(error, blocks), np.array_split(torque, blocks),
         strict=True)]
    )  # fmt: skip
    drawn = sums[np.random.default_rng(SEED).integers(0, blocks, (RESAMPLES, blocks))].sum(axis=1)
    low, high = np.quantile(np.sqrt(drawn[:, 0] / drawn[:, 1]), TAILS)
    return float(np.sqrt(sums[:, 0].sum() / sums[:, 1].sum())), (float(low), float(high))


def _unique_zero(evidence: Evidence) -> Condition:
    """One free motion to a command: no gap in displacement, and a torque that falls with velocity throughout."""
    name = "unique zero"
    if evidence.gap is not None and evidence.gap.is_gap:
        return Condition(
            name,
            False,
            "backlash: the port exerts nothing over a range of displacement, so its source is known to within that",
            "width of the interval of zeros",
            evidence.gap.width_rad,
            evidence.gap.interval_rad,
            "rad",
        )
    differs = _branches_differ(evidence.source)
    fall = None if evidence.table is None else _least_fall(evidence.table)
    if fall is None:
        return _by_branches(name, differs)
    value, interval, certain = fall
    if differs:
        holds, why = False, "one command has two free velocities, by the side from which it is approached"
    elif certain[1] < 0.0:
        holds, why = False, "at one command the torque rises with velocity, so that it may vanish at several"
    elif certain[0] > 0.0:
        holds, why = (
            True,
            "at each command the torque falls with velocity and is zero at one velocity (at any position)"
            + _no_gap(evidence.gap),
        )
    else:
        holds, why = None, "the torque's fall with velocity is lost in its scatter: impose fewer velocities for longer"
    return Condition(name, holds, why, "least fall of torque with velocity", value, interval, "N*m*s/rad")


def _no_gap(gap: ZeroRange | None) -> str:
    if gap is None:
        return "; whether there is backlash was not looked for"
    return f"; small loops show no gap wider than {1e3 * max(gap.interval_rad[1], gap.crossing_rad):.2g} mrad"


def _branches_differ(source: SourceMap | None) -> bool | None:
    result = None if source is None else source.hysteresis()
    if result is None or source is None:
        return None
    matters_rad_s = SAME_BRANCH * float(np.nanmax(np.abs(source.velocity_rad_s)))
    return result.significant and abs(result.difference_rad_s) > matters_rad_s


def _by_branches(name: str, differs: bool | None) -> Condition:
    if differs is None:
        return Condition(name, None, "neither a velocity at which the torque vanishes nor the free motion was measured")
    if differs:
        return Condition(name, False, "one command has two free velocities, by the side from which it is approached")
    why = "each command has one free velocity, from whichever side; what lies beside it was not measured"
    return Condition(name, True, why)


def _least_fall(table: ImpedanceTable) -> tuple[float, Interval, Interval] | None:
    """Where torque falls least with velocity [N m s/rad]: value, interval, and that of all cells at once.

    None where no two cells of one command were measured.
    """
    apart = np.diff(table.velocity_rad_s)
    falls = -np.diff(table.torque_nm, axis=1) / apart
    deviations = np.hypot(table.torque_std_nm[:, 1:], table.torque_std_nm[:, :-1]) / apart
    falls, deviations = (each[np.isfinite(falls)] for each in (falls, deviations))
    if not falls.size:
        return None
    one, all_of_them = (t_quantile(0.5 + 0.5 * level, PARTS - 1) for level in (CERTAIN, 1 - (1 - CERTAIN) / falls.size))
    least = int(np.argmin(falls))
    value, deviation = float(falls[least]), float(deviations[least])
    lowest = float(np.min(falls - all_of_them * deviations))
    highest = float(np.min(falls + all_of_them * deviations))
    return value, (value - one * deviation, value + one * deviation), (lowest, highest)


def _zero_dynamics(seen: Settling | None) -> Condition:
    name, figure = "stable zero dynamics", "of a step's change, still to come in the last quarter of its dwell"
    if seen is None:
        return Condition(name, None, "no staircase of the free port was recorded to settle on: run the step 'free'")
    low, high = seen.left_interval
    if high <= SETTLED:
        holds, why = True, f"with no torque at the port, {seen.steps} steps of the command settled{_in_time(seen)}"
    elif low > UNSETTLED:
        holds, why = False, f"with no torque at the port, the motion does not settle within {seen.dwell_s:.2g} s"
    else:
        holds, why = None, f"the motion has not clearly settled within {seen.dwell_s:.2g} s: dwell longer on each level"
    return Condition(name, holds, why, figure, seen.left, seen.left_interval, "")


def _in_time(seen: Settling) -> str:
    if not seen.time_s:
        return ", faster than could be followed"
    low, high = (1e3 * each for each in seen.time_interval_s)
    return f" with a time constant of {1e3 * seen.time_s:.3g} ms ({low:.3g} to {high:.3g} ms)"
