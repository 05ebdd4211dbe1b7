"""Repeated movements: what was seen of each trial at its ticks, and how near to zero its port torque came.

A trial is judged, and taught from, below TAUGHT_HZ: above it nothing is learnt, for there the bench's models are not
known to a fraction of a turn of phase. The torque sensor's own noise in that band is told by its readings, and is taken
off; the mean is left out, for a sensor drifts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, log10, sqrt

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.at_ticks import in_band, low_pass, readings_at_ticks
from norton_bench.records import Measured, SegmentInfo

# How segments that are trials are called; their number follows.
TRIAL = "trial "
# Noise hides a torque that adds no more than this share to its mean square; and what chance may add, in deviations.
HIDDEN_SHARE = 0.1
CHANCE = 3.0
# For good after so many of them, one after the other: meanwhile what was learnt still averages out.
TRIALS_AT_FLOOR = 3
# Trials so much worse than the best before them do not converge, once there are two of them in a row.
WORSE = 1.5


@dataclass(frozen=True)
class TrialFigures:
    """The port torque of one trial in the taught band, rms: with the sensor's noise in it, and the noise alone.

    ``hidden_nm`` is the greatest torque that noise and chance may hide. ``driven`` is False where the load was left to
    itself. ``learnt_nm`` is what the noise of earlier trials, learnt with the rest, may have put at the port.
    """

    number: int
    with_noise_nm: float
    noise_nm: float
    hidden_nm: float
    driven: bool = True
    learnt_nm: float = 0.0

    @property
    def torque_nm(self) -> float:
        """What the noise leaves of it: 0 where the noise alone explains all."""
        return sqrt(max(self.with_noise_nm**2 - self.noise_nm**2, 0.0))

    @property
    def at_floor(self) -> bool:
        """Whether noise explains what is left: that of the readings, and that which was learnt."""
        return self.torque_nm <= hypot(self.hidden_nm, self.learnt_nm)

    def below_db(self, first: "TrialFigures") -> float:
        """How far its torque lies below that of ``first``, at least: what may be hidden is taken to be there."""
        at_most_nm = max(self.torque_nm, self.hidden_nm)
        return 20 * log10(first.with_noise_nm / at_most_nm) if at_most_nm > 0.0 else float("inf")


def figures_of(number: int, torque_nm: FloatArray, noise_nm: float, tick_s: float) -> TrialFigures:
    """Of a port torque at the ticks (ticks,), each reading of which has the noise ``noise_nm``.

    In the first trial the load is not driven.
    """
    band = in_band(torque_nm - np.mean(torque_nm), tick_s)
    share = float(np.mean(low_pass(2 * len(band), tick_s) ** 2))
    chance = CHANCE * sqrt(2.0 / (share * len(band)))  # of a mean of so many independent squares
    band_noise_nm = sqrt(share) * noise_nm
    hidden_nm = band_noise_nm * sqrt(HIDDEN_SHARE + chance)
    learnt_nm = band_noise_nm / sqrt(max(averaged(number), 1)) if number > 1 else 0.0
    return TrialFigures(number, sqrt(float(np.mean(band**2))), band_noise_nm, hidden_nm, number > 1, learnt_nm)


def averaged(number: int) -> int:
    """How many lessons are averaged in a trial: those of the driven ones before it, beside which the undriven first
    one's weighs nothing. 0 where there is only that."""
    return max(number - 2, 0)


def trials(measured: Measured, tick_s: float, procedure: str) -> tuple[TrialFigures, ...]:
    """The figures of every trial of ``procedure`` that a torque sensor saw, from its recording; of the last movement,
    where there were several."""
    return tuple(_figures(measured, segment, tick_s) for segment in trial_segments(measured, procedure))


def trial_segments(measured: Measured, procedure: str) -> list[SegmentInfo]:
    """The segments of the trials of ``procedure``; of the last movement, where there were several."""
    chosen = [each for each in measured.segments if each.procedure == procedure and each.name.startswith(TRIAL)]
    first = max((place for place, segment in enumerate(chosen) if number_of(segment) == 1), default=0)
    return chosen[first:]


def number_of(segment: SegmentInfo) -> int:
    """Of a trial, from 1."""
    return int(segment.name.removeprefix(TRIAL))


def last_driven(found: Sequence[TrialFigures]) -> TrialFigures:
    """The last trial in which the load was driven, or the last of all."""
    return next((each for each in reversed(found) if each.driven), found[-1])


def settled(found: Sequence[TrialFigures]) -> bool:
    """Whether noise hides all that is left in the last driven trials, and not by chance."""
    last = [each for each in found if each.driven][-TRIALS_AT_FLOOR:]
    return len(last) == TRIALS_AT_FLOOR and all(each.at_floor for each in last)


def diverge(found: Sequence[TrialFigures]) -> bool:
    """Whether the last two driven trials are both worse than one before them, or than the load left to itself."""
    last = [place for place, each in enumerate(found) if each.driven][-2:]
    before = [each.with_noise_nm for place, each in enumerate(found) if place not in last]
    return len(last) == 2 and bool(before) and all(found[place].with_noise_nm > WORSE * min(before) for place in last)


def _figures(measured: Measured, segment: SegmentInfo, tick_s: float) -> TrialFigures:
    ticks = round((segment.end_ns - segment.start_ns) * 1e-9 / tick_s)
    result = readings_at_ticks(measured, segment, ticks, tick_s)
    if result.torque_nm is None:
        raise ExperimentError(f"{segment.name}: no torque was read")
    return figures_of(number_of(segment), result.torque_nm, result.torque_noise_nm, tick_s)
