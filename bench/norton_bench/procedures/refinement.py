"""The state of a refinement: its intervals, and which of them no longer narrow."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite, log

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.expansion import deviations
from norton_bench.identification.motor_values import KNOWN
from norton_bench.models.parameters import HALF_INTERVAL, Estimate, Status

# Estimates that more excitation can improve. The others have no value, and the fit reports why.
IMPROVABLE = (Status.VALID, Status.UNEXCITED)
# For an estimate that is not a parameter of the information matrix: the parameter from which it follows.
RESTS_ON = {"torque_constant": "torque_gain", "amplifier_gain": "torque_gain"}
# Counted where at least this much narrowing (a logarithm) was predicted; less than this share of it is a failure.
LEAST_FORESEEN = 0.05
LEAST_SHARE = 0.3
# After this many failures in sequence the parameter is set aside: its interval is not caused by noise.
MOST_FAILURES = 2


@dataclass(frozen=True)
class Interval:
    """Half of a parameter's 95 % interval, relative to its value: as the fit reports it, and as noise alone leaves it.

    ``row`` is the parameter's place in the information matrix.
    """

    name: str
    half_width: float
    of_noise: float
    row: int


@dataclass(frozen=True)
class Refinement:
    """The state of one refinement; ``target`` is the half-width asked for, relative.

    ``predicted`` has for each parameter the half-width before the last round and the predicted one after it;
    ``delivered`` has for each excitation the information that it gave. ``reasons`` are, once ``finished``, those why
    the target was not ``reached``.
    """

    target: float
    rounds: int = 0
    bench_time_s: float = 0.0
    predicted: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    failures: Mapping[str, int] = field(default_factory=dict)
    delivered: Mapping[str, FloatArray] = field(default_factory=dict)
    finished: bool = False
    reached: bool = False
    reasons: tuple[str, ...] = ()

    def judged(self, intervals: Iterable[Interval]) -> "Refinement":
        """With the failures of the last round counted: intervals that did not narrow as predicted from the noise."""
        failures = dict(self.failures)
        for interval in intervals:
            before, after = self.predicted.get(interval.name, (interval.half_width, interval.half_width))
            hoped = log(before / after)
            if hoped >= LEAST_FORESEEN:
                failed = log(before / interval.half_width) < LEAST_SHARE * hoped
                failures[interval.name] = failures.get(interval.name, 0) + 1 if failed else 0
        return replace(self, failures=failures, predicted={})

    def set_aside(self, interval: Interval) -> bool:
        """Whether more excitation did not narrow the interval."""
        return self.failures.get(interval.name, 0) >= MOST_FAILURES

    @property
    def sentences(self) -> tuple[str, ...]:
        """The reasons, each as a sentence."""
        return tuple(f"{reason[0].upper()}{reason[1:]}." for reason in self.reasons)

    def ended(self, *, reached: bool, reasons: Iterable[str] = ()) -> "Refinement":
        return replace(self, finished=True, reached=reached, reasons=tuple(reasons))


def half_width(estimate: Estimate) -> float:
    """Half of the 95 % interval over the value; infinite where there is none."""
    if estimate.status not in IMPROVABLE or not isfinite(estimate.std) or estimate.value == 0.0:
        return inf
    return HALF_INTERVAL * estimate.std / abs(estimate.value)


def intervals_of(estimates: Iterable[Estimate], of_noise: Iterable[float]) -> tuple[Interval, ...]:
    """Those that can be improved. ``of_noise`` are relative deviations in the order of KNOWN."""
    bound = dict(zip(KNOWN, of_noise, strict=True))
    intervals = []
    for estimate in estimates:
        name = RESTS_ON.get(estimate.name, estimate.name)
        width = half_width(estimate)
        if 0.0 < width < inf and name in bound:
            intervals.append(Interval(estimate.name, width, HALF_INTERVAL * bound[name], KNOWN.index(name)))
    return tuple(intervals)


def widest_of(estimates: Iterable[Estimate]) -> tuple[str, float] | None:
    """The parameter with the widest interval, and its half-width; None where no parameter has one."""
    widths = {estimate.name: half_width(estimate) for estimate in estimates}
    finite = {name: width for name, width in widths.items() if isfinite(width)}
    return max(finite.items(), key=lambda item: item[1]) if finite else None


def why_wide(interval: Interval) -> str:
    """Why an interval that was set aside stays as wide as it is."""
    about = f"the interval of {words(interval.name)}, {in_percent(interval.half_width)},"
    if interval.of_noise < 0.7 * interval.half_width:
        return (
            f"{about} is limited by model error, not by noise, which alone would give {in_percent(interval.of_noise)}"
        )
    return f"{about} does not narrow as it should with more data"


def words(name: str) -> str:
    return name.replace("_", " ")


def in_percent(half: float) -> str:
    return f"±{100 * half:.2g} %"


# A choice that narrows the widest interval by less than this share is not worth its time.
LEAST_GAIN = 0.002


@dataclass(frozen=True)
class Option:
    """An excitation to choose from: its duration, and its information matrix (k, k).

    The choice is greedy and minimax: each excitation is the one that narrows the widest relative interval most per
    time; its effect is assumed for the next choice.
    """

    duration_s: float
    information: FloatArray


@dataclass(frozen=True)
class Selection:
    """Indices of the options, in order, and the predicted widths (wanted,) after them all."""

    picks: tuple[int, ...]
    predicted: FloatArray


def select(
    options: Sequence[Option],
    known: FloatArray,
    widths: Callable[[FloatArray], FloatArray],
    *,
    target: float,
    time_s: float,
) -> Selection:
    """Fill ``time_s`` with ``options``, each as often as it helps, until all widths are within ``target``.

    ``known`` is the information there is (k, k); ``widths`` computes from deviations (k,) the widths, of which
    the greatest counts. Nothing is chosen where no option helps.
    """
    picks: list[int] = []
    now = widths(deviations(known))
    while np.max(now) > target:
        widest = int(np.argmax(now))
        fitting = [index for index, option in enumerate(options) if option.duration_s <= time_s]
        after = {index: widths(deviations(known + options[index].information)) for index in fitting}
        gain = {index: float(np.log(now[widest] / after[index][widest])) for index in fitting}
        useful = [index for index in fitting if gain[index] > LEAST_GAIN]
        if not useful:
            break
        best = max(useful, key=lambda index: gain[index] / options[index].duration_s)
        picks.append(best)
        known, now = known + options[best].information, after[best]
        time_s -= options[best].duration_s
    return Selection(tuple(picks), now)
