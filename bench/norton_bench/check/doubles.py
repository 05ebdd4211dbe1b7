"""Two devices that share one address: two answers to one question, two rhythms in one stream, values that contradict
each other."""

from collections.abc import Sequence
from statistics import median

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.check.survey import BusSurvey, Key
from norton_drivers.readings import RawFrame
from norton_drivers.recognition import Answers

_READINGS_MIN = 40
# A rhythm is judged where the period is long against what an adapter and the host may hold frames up.
_SLOWEST_SEEN_NS = 20_000_000
_GAPS_MIN = 8
_STEADY = 0.15  # of the period
_APART = 0.15
_MOST = 0.8  # of the gaps: the host may be late now and then


def answered_twice(survey: BusSurvey, answers: Sequence[Answers]) -> list[RawFrame]:
    """An answer of each device whose every question had two."""
    counts: dict[tuple[Key, bytes], list[int]] = {}
    example: dict[tuple[Key, bytes], RawFrame] = {}
    for question, found in survey.answered(answers):
        asked = ((question.arbitration_id, question.extended), b"" if question.remote else question.data)
        counts.setdefault(asked, []).append(len(found))
        example[asked] = found[0]
    return [example[asked] for asked, each in counts.items() if min(each) >= 2 and median(each) == 2]


def two_rhythms(arrivals_ns: Sequence[int]) -> bool:
    """Whether every other arrival belongs to one steady stream, and those between to another.

    Not to be seen where the second falls into the middle of the first's period.
    """
    gaps = np.diff(np.asarray(arrivals_ns, float))
    if len(gaps) < _GAPS_MIN:
        return False
    periods, changes = gaps[:-1] + gaps[1:], np.diff(gaps)
    period = float(np.median(periods))
    steady = np.mean(np.abs(periods - period) < _STEADY * period)
    # Of one device, a gap is followed by one of its like; of two, by what is left of the period.
    alternating = np.mean((changes[:-1] * changes[1:] < 0) & (np.abs(changes[1:]) > _APART * period))
    return bool(period >= _SLOWEST_SEEN_NS and steady > _MOST and alternating > _MOST)


def contradictory(values: Sequence[float]) -> bool:
    """Whether readings at rest jump to and fro between two values, as those of two devices do."""
    readings: FloatArray = np.asarray(values, float)
    readings = readings[np.isfinite(readings)]
    if len(readings) < _READINGS_MIN:
        return False
    # Means, for a reading that flickers by its last bit has medians of anything.
    to_next = float(np.mean(np.abs(np.diff(readings))))
    to_after_next = float(np.mean(np.abs(readings[2:] - readings[:-2])))
    return to_next > 5 * to_after_next
