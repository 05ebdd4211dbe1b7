"""What a fit itself shows to be impossible: wrong signs, next to nothing explained, parameters that change midway.

Every finding is a sentence with the mend, and makes estimates doubtful.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.regression import GAIN, INERTIA
from norton_bench.identification.separable import DELAY_TICKS, Solution
from norton_bench.identification.soundness.blocks import Blocks, loud
from norton_bench.models.parameters import Status

# Beyond these many deviations a sign is no accident.
SIGNIFICANT = 3.0
# A fit that leaves more than this of what it explains has understood nothing.
UNEXPLAINED = 0.5
# From less than this no deviation can be told.
SHORTEST_S = 2.0
# Friction depends on the way gone: of a position read more rarely than this too little is known of it.
SLOWEST_TICKS = 2.5
# A delay that is used up to this share of what was searched is cut off.
USED_UP = 0.999
# What differs before and after an instant by so many deviations, and by so much, has changed. (A busy host alone shifts
# the delay of readings without a clock of their own by half a tick, which no estimate minds.)
CHANGE_SIGNIFICANT = 6.0
CHANGE_TICKS = 1.5
CHANGE_SHARE = 0.1
FEWEST_BLOCKS = 16
SPLITS = 15
# A change is looked for where each side has this share of what is told of the unknown (Andrews, Econometrica 61, 1993):
# what is odd in a stretch that tells little is no change of the machine.
TRIMMED = 0.15
DELAYS = {2: "command", 3: "motion"}


@dataclass(frozen=True)
class Doubt:
    """A sentence, and the estimates it concerns; none named: all. ``midway``: something changed at some instant."""

    sentence: str
    names: tuple[str, ...] = ()
    midway: bool = False


def doubts(solution: Solution, values: FloatArray, deviations: FloatArray, *, tick_s: float) -> tuple[Doubt, ...]:
    """All findings. ``values`` and their ``deviations`` are those of fit.PHYSICAL, then the two delays."""
    found = [*_too_short(solution, tick_s), *_slow_motion(solution, tick_s)]
    found += [*_wrong_signs(solution, values, deviations), *_unexplained(solution), *_cut_off(solution, tick_s)]
    return (*found, *([] if found else _changing(solution, tick_s)))


def status_of(status: Status, name: str, found: tuple[Doubt, ...]) -> Status:
    """``status``, unless it says that a doubted number is valid."""
    doubted = any(not doubt.names or name in doubt.names for doubt in found)
    return Status.DOUBTFUL if doubted and status in (Status.VALID, Status.RATIO_ONLY) else status


def _too_short(solution: Solution, tick_s: float) -> Iterator[Doubt]:
    span_s = len(solution.residual) * tick_s
    if span_s < SHORTEST_S:
        yield Doubt(
            f"Only {span_s:.2g} s of the recording could be used: too little to say how good a number is; record more."
        )


def _slow_motion(solution: Solution, tick_s: float) -> Iterator[Doubt]:
    period_s = max(rows.signals.position_period_s for rows in solution.regression.rows)
    if period_s > SLOWEST_TICKS * tick_s:
        yield Doubt(
            f"The position is read only every {1e3 * period_s:.3g} ms: what the shaft does in between, and with it the "
            "friction, is not known; have the drive send it with every tick."
        )


def _wrong_signs(solution: Solution, values: FloatArray, deviations: FloatArray) -> Iterator[Doubt]:
    gain, inertia = (values[row] / max(deviations[row], 1e-300) for row in (0, 2))
    if solution.free_motion:
        # The gain is 1 by definition; what it is per unit of inertia has the sign.
        if inertia < -SIGNIFICANT:
            yield Doubt(
                "A positive command drives the shaft backwards: check the sign of the command and of the motion "
                "(direction of the actuator)."
            )
        return
    if inertia < -SIGNIFICANT:
        yield Doubt(
            "The inertia comes out negative: the signs of torque and motion do not agree; check the direction of the "
            "torque sensor and of the actuator."
        )
    elif gain < -SIGNIFICANT:
        yield Doubt(
            "A positive command drives the shaft backwards: check the sign of the command (direction of the actuator).",
            ("torque_gain", "torque_constant", "amplifier_gain"),
        )


def _unexplained(solution: Solution) -> Iterator[Doubt]:
    target = solution.regression.target()
    left = float(np.sqrt(np.mean(solution.residual**2)) / max(np.std(target), 1e-300))
    if left > UNEXPLAINED:
        what = "motion" if solution.free_motion else "torque"
        yield Doubt(
            f"The network leaves {min(left, 1.0):.0%} of the {what} unexplained: check which reading is which, their "
            "units, signs and clocks, and whether something else acted."
        )


def _cut_off(solution: Solution, tick_s: float) -> Iterator[Doubt]:
    longest_s = USED_UP * DELAY_TICKS * tick_s
    for name, delay_s in (("command", solution.shape.command_delay_s), ("motion", solution.shape.motion_delay_s)):
        if abs(delay_s) > longest_s:
            yield Doubt(
                f"{name.capitalize()} and torque are out of step by more than the {1e3 * DELAY_TICKS * tick_s:.3g} ms "
                "that are searched: check the sensor's own filter and its clock."
            )


def _changing(solution: Solution, tick_s: float) -> Iterator[Doubt]:
    """A delay or a constant of the machine that differs before and after some instant."""
    blocks = Blocks.of(solution)
    count = blocks.time_s.size
    if count < FEWEST_BLOCKS:
        return
    splits = np.unique(np.linspace(0, count, SPLITS + 2)[1:-1].astype(np.int64))
    best: tuple[float, str, int] | None = None
    for column, name, least, unit in _judged(solution, tick_s):
        told = blocks.told(column)[splits]
        for split in splits[(told > TRIMMED) & (told < 1.0 - TRIMMED)]:
            after = (np.arange(count) >= split).astype(np.float64)
            change, deviation = blocks.change(column, after, int(split))
            ratio = abs(change) / max(deviation, 1e-300)
            if ratio > CHANGE_SIGNIFICANT and abs(change) > least and (best is None or ratio > best[0]):
                if not _confirmed(solution, blocks, column, least, int(split)):
                    continue
                amount = f"{1e3 * abs(change):.2g} ms" if unit == "s" else f"{CHANGE_SHARE * abs(change) / least:.0%}"
                best = (ratio, f"The {name} is not the same throughout: it differs by some {amount}", int(split))
    if best is not None:
        at_s = float(blocks.time_s[best[2]])
        yield Doubt(
            f"{best[1]} before and after {at_s:.3g} s; a clock jumped, readings were lost, or a sensor or the machine "
            "changed: record it again.",
            midway=True,
        )


def _confirmed(solution: Solution, blocks: Blocks, column: int, least: float, split: int) -> bool:
    """Whether what differs before and after does so where the machine's torque is more than noise."""
    chosen = loud(solution)
    before, count = int(np.count_nonzero(chosen[:split])), int(np.count_nonzero(chosen))
    if not 0 < before < count:
        return False
    told = blocks.only(chosen)
    change, deviation = told.change(column, (np.arange(count) >= before).astype(np.float64), before)
    enough = TRIMMED < told.told(column)[before] < 1.0 - TRIMMED
    return enough and abs(change) > max(least, CHANGE_SIGNIFICANT * deviation)


def _judged(solution: Solution, tick_s: float) -> Iterator[tuple[int, str, float, str]]:
    """Columns of the jacobian, what they are called, the least change worth a word, and its unit ("": relative)."""
    slowest_s = max(rows.signals.torque_period_s for rows in solution.regression.rows)
    for column, name in ((GAIN, "torque gain"), (INERTIA, "inertia")):
        if not (solution.free_motion and column == INERTIA):
            yield column, name, CHANGE_SHARE * abs(float(solution.linear[column])), ""
    for position, unknown in enumerate(solution.free):
        if unknown in DELAYS:
            name = f"delay between {DELAYS[unknown]} and torque"
            yield len(solution.linear) + position, name, CHANGE_TICKS * max(tick_s, slowest_s), "s"
