"""What the in-situ experiment has found: the torque that the actuator exerted in each trial, and its motion source.

All of it follows from the recording: the experiment itself judges its trials by the same functions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.assembly import LoadTaken, Trial, load_taken
from norton_bench.identification.at_ticks import in_band, sent_at_ticks
from norton_bench.identification.impedance_along import ImpedanceAlong, impedance_along
from norton_bench.identification.path_impedance import PathImpedance, path_impedance
from norton_bench.identification.trials import TrialFigures, diverge, number_of, settled, trial_segments
from norton_bench.models.parameters import HALF_INTERVAL
from norton_bench.records import Measured, SegmentInfo

# What its steps, and the segments of its trials, are called.
IN_SITU = "in_situ"
# How the segments of trials are called that were pushed off the path; their number follows.
PUSHED = "pushed "
# The source is the mean of so many last driven trials.
AVERAGED = 3


@dataclass(frozen=True, eq=False)
class Exerted:
    """One trial, at its ticks, arrays (ticks,): what the actuator exerted on its load, and how it moved meanwhile.

    ``uncertain_nm`` is the standard deviation of that torque by those of the load's values, rms; 0 where these are not
    known.
    """

    number: int
    driven: bool
    torque_nm: FloatArray  # in the taught band, less its mean over the trial
    position_rad: FloatArray  # from where the trial began
    uncertain_nm: float = 0.0

    @classmethod
    def of(cls, number: int, driven: bool, trial: Trial, load: LoadTaken, tick_s: float) -> "Exerted":
        position_rad = trial.seen.position_rad
        others = [_judged(trial.by(machine, tick_s).torque_nm, tick_s) for machine in load.machine.drawn()]
        return cls(
            number,
            driven,
            _judged(trial.torque_nm, tick_s),
            np.asarray(position_rad - position_rad[0]),
            _scatter(others),
        )


def _judged(torque_nm: FloatArray, tick_s: float) -> FloatArray:
    """A torque in the taught band, less its mean."""
    return in_band(torque_nm - np.mean(torque_nm), tick_s)


@dataclass(frozen=True, eq=False)
class SourceMotion:
    """The motion source under one command, arrays (ticks,); ``scatter_rad_s`` is how much trials differ, rms."""

    tick_s: float
    command: FloatArray
    position_rad: FloatArray
    velocity_rad_s: FloatArray
    scatter_rad_s: float


@dataclass(frozen=True, eq=False)
class InSituResult:
    """``assembly`` says in sentences what the load was taken for, ``reasons`` why it did not converge.

    ``impedance`` is that about the source's path, None where the trials do not tell one; ``along`` that along it,
    where trials were pushed off it.
    """

    trials: tuple[TrialFigures, ...]
    source: SourceMotion | None
    assembly: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    impedance: PathImpedance | None = None
    along: ImpedanceAlong | None = None

    @property
    def converged(self) -> bool:
        return converged(self.trials)


def in_situ_result(measured: Measured, tick_s: float) -> InSituResult | None:
    """What the last in-situ experiment in ``measured`` has found; None where there was none, or no trial was finished.

    Raises ExperimentError where a trial lacks readings.
    """
    load = load_taken(measured.events)
    if load is None:
        return None

    def readings_of(segments: Sequence[SegmentInfo]) -> list[Trial]:
        return [Trial.of(measured, each, load, tick_s) for each in segments]

    whole = _whole(trial_segments(measured, IN_SITU), load, tick_s)
    if not whole:
        return None
    readings, pushed = readings_of(whole), readings_of(_whole(pushed_segments(measured), load, tick_s))
    trials = [
        Exerted.of(number_of(segment), _driven(measured, segment, load, tick_s), reading, load, tick_s)
        for segment, reading in zip(whole, readings, strict=True)
    ]
    result, command = figures(trials), sent_at_ticks(measured, whole[0], "command", load.ticks, tick_s)
    return InSituResult(
        result,
        source_motion(trials, command, tick_s),
        load.said,
        why_not_settled(result),
        path_impedance(load.machine, [*readings, *pushed], tick_s),
        impedance_along(load.machine, [*_last_driven(trials, readings), *pushed], tick_s) if pushed else None,
    )


def pushed_segments(measured: Measured) -> list[SegmentInfo]:
    """The segments of the trials that were pushed off the path, of the last movement."""
    chosen = [each for each in measured.segments if each.procedure == IN_SITU and each.name.startswith(PUSHED)]
    trials_ns = [each.start_ns for each in trial_segments(measured, IN_SITU)]
    return [each for each in chosen if not trials_ns or each.start_ns > trials_ns[0]]


def _whole(segments: Sequence[SegmentInfo], load: LoadTaken, tick_s: float) -> list[SegmentInfo]:
    """Those that came to their end."""
    return [each for each in segments if round((each.end_ns - each.start_ns) * 1e-9 / tick_s) >= load.ticks]


def _last_driven(trials: Sequence[Exerted], readings: Sequence[Trial]) -> list[Trial]:
    """The trials that the source is the mean of: they were about its path."""
    driven = [reading for trial, reading in zip(trials, readings, strict=True) if trial.driven]
    return driven[-AVERAGED:]


def _driven(measured: Measured, segment: SegmentInfo, load: LoadTaken, tick_s: float) -> bool:
    """It shows in what was wished: what is sent may be rounded to something else than zero."""
    return bool(np.any(sent_at_ticks(measured, segment, "wished_load_torque_nm", load.ticks, tick_s)))


# Why there is nothing more to learn.
EXPLAINED = "the scatter of movements and the load's values explain what is left"


def converged(found: Sequence[TrialFigures]) -> bool:
    """Whether there is nothing more to learn, and two trials with the load left alone show how movements scatter."""
    return settled(found) and sum(not each.driven for each in found) >= 2


def why_not_settled(found: Sequence[TrialFigures]) -> tuple[str, ...]:
    """Sentences; none where what is left is no more than the scatter of movements, or than the load leaves open."""
    if converged(found):
        return ()
    if diverge(found):
        return ("it does not converge: two trials in a row were worse than one before them",)
    return (f"after {len(found)} trials more is left than the scatter of movements and the load's values explain",)


def figures(trials: Sequence[Exerted]) -> tuple[TrialFigures, ...]:
    """Of every trial: the noise floor is by how much those differ in which the load was left to itself.

    It is 0 as long as there are not two of them. What the load's uncertain values may add hides as much.
    """
    floor_nm = _scatter([each.torque_nm for each in trials if not each.driven])
    return tuple(
        TrialFigures(
            each.number,
            float(np.sqrt(np.mean(each.torque_nm**2))),
            floor_nm,
            float(np.hypot(floor_nm, HALF_INTERVAL * each.uncertain_nm)),
            each.driven,
        )
        for each in trials
    )


def source_motion(trials: Sequence[Exerted], command: FloatArray, tick_s: float) -> SourceMotion | None:
    """The mean motion of the last driven trials; None where there are not enough of them."""
    last = [each.position_rad for each in trials if each.driven][-AVERAGED:]
    if len(last) < AVERAGED:
        return None
    velocities = [np.gradient(in_band_motion(each, tick_s), tick_s) for each in last]
    position = np.mean(last, axis=0)
    return SourceMotion(tick_s, command, position, np.mean(velocities, axis=0), _scatter(velocities))


def in_band_motion(position_rad: FloatArray, tick_s: float) -> FloatArray:
    """A motion that need not end where it began, without what is above the band."""
    line = np.linspace(position_rad[0], position_rad[-1], len(position_rad))
    return np.asarray(line + in_band(position_rad - line, tick_s))


def _scatter(repeated: Sequence[FloatArray]) -> float:
    """By how much one of several repetitions differs from what they have in common, rms."""
    if len(repeated) < 2:
        return 0.0
    return float(np.sqrt(np.mean(np.var(np.stack(repeated), axis=0, ddof=1))))
