"""What the in-situ experiment has found: the torque that the actuator exerted in each trial, and its motion source.

All of it follows from the recording: the experiment itself judges its trials by the same functions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.load_taken import LoadTaken, load_taken
from norton_bench.identification.trials import (
    Seen,
    TrialFigures,
    diverge,
    in_band,
    number_of,
    seen,
    sent,
    settled,
    trial_segments,
)
from norton_bench.records import Measured, SegmentInfo

# What its steps, and the segments of its trials, are called.
IN_SITU = "in_situ"
# The source is the mean of so many last driven trials.
AVERAGED = 3


@dataclass(frozen=True, eq=False)
class Trial:
    """What was seen of one trial, the load torque that was sent, and the torque that the load tells: (ticks,)."""

    seen: Seen
    load_torque_nm: FloatArray
    torque_nm: FloatArray

    @classmethod
    def of(cls, measured: Measured, segment: SegmentInfo, load: LoadTaken, tick_s: float) -> "Trial":
        """Raises ExperimentError where a stream has gaps in it."""
        found = seen(measured, segment, load.ticks, tick_s)
        load_torque_nm = sent(measured, segment, "load_torque_nm", load.ticks, tick_s)
        return cls(found, load_torque_nm, -load.machine.torque_nm(load_torque_nm, found.load_position_rad, tick_s))


@dataclass(frozen=True, eq=False)
class Exerted:
    """One trial, at its ticks, arrays (ticks,): what the actuator exerted on its load, and how it moved meanwhile."""

    number: int
    driven: bool
    torque_nm: FloatArray  # in the taught band, less its mean over the trial
    position_rad: FloatArray  # from where the trial began

    @classmethod
    def of(cls, number: int, driven: bool, trial: Trial, tick_s: float) -> "Exerted":
        torque_nm, position_rad = trial.torque_nm, trial.seen.position_rad
        return cls(
            number, driven, in_band(torque_nm - np.mean(torque_nm), tick_s), np.asarray(position_rad - position_rad[0])
        )


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
    """``assembly`` says in sentences what the load was taken for, ``reasons`` why it did not converge."""

    trials: tuple[TrialFigures, ...]
    source: SourceMotion | None
    assembly: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        return settled(self.trials)


def in_situ_result(measured: Measured, tick_s: float) -> InSituResult | None:
    """What the last in-situ experiment in ``measured`` has found; None where there was none, or no trial was finished.

    Raises ExperimentError where a trial lacks readings.
    """
    load = load_taken(measured.events)
    if load is None:
        return None
    segments = trial_segments(measured, IN_SITU)
    whole = [each for each in segments if round((each.end_ns - each.start_ns) * 1e-9 / tick_s) >= load.ticks]
    if not whole:
        return None
    trials = [_exerted(measured, each, load, tick_s) for each in whole]
    found, command = figures(trials), sent(measured, whole[0], "command", load.ticks, tick_s)
    return InSituResult(found, source_motion(trials, command, tick_s), load.said, why_not_settled(found))


def _exerted(measured: Measured, segment: SegmentInfo, load: LoadTaken, tick_s: float) -> Exerted:
    """Whether it was driven shows in what was wished: what is sent may be rounded to something else than zero."""
    driven = bool(np.any(sent(measured, segment, "wished_load_torque_nm", load.ticks, tick_s)))
    return Exerted.of(number_of(segment), driven, Trial.of(measured, segment, load, tick_s), tick_s)


def why_not_settled(found: Sequence[TrialFigures]) -> tuple[str, ...]:
    """Sentences; none where what is left is what movements differ by anyway."""
    if settled(found):
        return ()
    if diverge(found):
        return ("it does not converge: two trials in a row were worse than one before them",)
    return (f"after {len(found)} trials there was still more than movements differ by",)


def figures(trials: Sequence[Exerted]) -> tuple[TrialFigures, ...]:
    """Of every trial: the noise floor is by how much those differ in which the load was left to itself.

    It is 0 as long as there are not two of them.
    """
    floor_nm = _scatter([each.torque_nm for each in trials if not each.driven])
    return tuple(
        TrialFigures(each.number, float(np.sqrt(np.mean(each.torque_nm**2))), floor_nm, floor_nm, each.driven)
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
