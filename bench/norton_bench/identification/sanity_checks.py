"""A solution's normal equations by block of rows: whether an unknown is the same throughout the record."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification.search_box import DELAY_TICKS
from norton_bench.identification.separable import Solution, linear_solution
from norton_bench.identification.shape import COULOMB, GAIN, INERTIA, LINEAR, VISCOUS
from norton_bench.models.parameters import Status

BLOCK_ROWS = 500
# A change that fewer blocks tell has no deviation that their scatter could give.
TELLING_BLOCKS = 6.0


@dataclass(frozen=True)
class Blocks:
    """Normal equations of each block of rows about the fit: ``gram`` (blocks, p, p), ``score`` (blocks, p).

    Readings' errors in the columns are taken off, as the fit does it: a stretch in which the shaft hardly accelerates
    would else seem to have less inertia than one in which it does.
    """

    gram: FloatArray
    score: FloatArray
    scale: FloatArray  # of the columns, (p,)
    time_s: FloatArray  # at which each block begins, (blocks,)

    @classmethod
    def of(cls, solution: Solution) -> "Blocks":
        """Of whole blocks; what is left at the end is too little for one."""
        jacobian, residual = solution.jacobian, solution.innovation
        count = len(residual) // BLOCK_ROWS
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0.0] = 1.0  # a free shaft has no torque to go with the inertia
        rows = (jacobian[: count * BLOCK_ROWS] / scale).reshape(count, BLOCK_ROWS, len(scale))
        left = residual[: count * BLOCK_ROWS].reshape(count, BLOCK_ROWS, 1)
        across = rows.transpose(0, 2, 1)
        gram, score = np.matmul(across, rows), np.matmul(across, left)[:, :, 0]
        at = np.arange(len(solution.contamination))
        in_block = solution.contamination * BLOCK_ROWS / len(residual)
        gram[:, at, at] -= in_block / scale[at] ** 2
        linearly = slice(len(solution.linear))
        score[:, linearly] += in_block[linearly] * solution.linear / scale[linearly]
        return cls(gram, score, scale, solution.regression.time_s()[: count * BLOCK_ROWS : BLOCK_ROWS])

    def only(self, chosen: npt.NDArray[np.bool_]) -> "Blocks":
        """Some of them, (blocks,)."""
        return replace(self, gram=self.gram[chosen], score=self.score[chosen], time_s=self.time_s[chosen])

    def told(self, column: int) -> FloatArray:
        """The share of what is told of one unknown, the others being unknown too, before each block: (blocks,)."""
        gram = self.gram.sum(axis=0)
        others = np.delete(np.arange(len(gram)), column)
        alone = np.zeros(len(gram))
        alone[column] = 1.0
        alone[others] = (
            -np.linalg.pinv(gram[np.ix_(others, others)], rcond=1e-10, hermitian=True) @ gram[others, column]
        )
        sizes = np.maximum(np.einsum("i,bij,j->b", alone, self.gram, alone), 0.0)
        return np.asarray((np.cumsum(sizes) - sizes) / max(sizes.sum(), 1e-300))

    def undone(self, solution: Solution, column: int) -> float:
        """What undoing the errors of readings adds to one unknown.

        They are undone as they are on average. Where one half has none of them and the other twice as many, the unknown
        seems changed by twice as much.
        """
        if column >= len(solution.linear):
            return 0.0
        told = 1.0 / float(np.linalg.pinv(self.gram.sum(axis=0), rcond=1e-10, hermitian=True)[column, column])
        share = float(solution.contamination[column]) / self.scale[column] ** 2 / told
        return float(abs(share * solution.linear[column]))

    def change(self, column: int, course: FloatArray, split: int) -> tuple[float, float]:
        """How far one unknown goes along ``course`` (blocks,), the others being the same throughout; its deviation.

        That is one more column: the unknown's own, times its course, less what all the columns explain of it. Where few
        blocks tell it, before ``split`` or after, or noise alone, their scatter is no deviation, and nothing is said.
        """
        gram = self.gram.sum(axis=0)
        moved = np.einsum("b,bi->i", course, self.gram[:, :, column])
        explained = np.linalg.pinv(gram, rcond=1e-10, hermitian=True) @ moved
        weights = np.zeros((len(self.gram), len(gram))) - explained
        weights[:, column] += course
        size = np.einsum("bi,bij,bj->b", weights, self.gram, weights)
        score = np.sum(weights * self.score, axis=1)
        told = float(size.sum())
        if told <= 0.0 or min(_as_many(size[:split]), _as_many(size[split:])) < TELLING_BLOCKS:
            return 0.0, float("inf")
        step = float(score.sum()) / told
        deviation = float(np.sqrt(np.sum((score - step * size) ** 2))) / told
        return step / self.scale[column], deviation / self.scale[column]


def loud(solution: Solution) -> npt.NDArray[np.bool_]:
    """In which blocks the machine's torque is more than the noise of the readings; in all where none was measured.

    Where feedback holds the torque at zero, what is left of it is mostly the sensor's noise, which moves the shaft a
    little later: a delay between motion and torque that no clock has.
    """
    count = len(solution.innovation) // BLOCK_ROWS
    if solution.free_motion:
        return np.ones(count, dtype=bool)
    own = slice(len(LINEAR))
    carried = solution.regression.carried(solution.linear)
    noise = np.concatenate([np.full(rows.usable.size, rows.noise() @ carried) for rows in solution.regression.rows])
    beyond = (solution.linear[own] @ solution.regression.columns(solution.shape)[0][own]) ** 2 - noise
    return np.asarray(beyond[: count * BLOCK_ROWS].reshape(count, BLOCK_ROWS).mean(axis=1) > 0.0)


def _as_many(weights: FloatArray) -> float:
    """How many equal weights would tell as much as these."""
    return float(weights.sum() ** 2 / max(np.sum(weights**2), 1e-300))


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
class FailedCheck:
    """A sanity check that a fit has failed: wrong signs, next to nothing explained, parameters that change midway.

    ``sentence`` says what is wrong, with the remedy. ``names`` are the estimates that it makes doubtful; where none is
    named, all of them. ``midway`` says that something changed at some instant.
    """

    sentence: str
    names: tuple[str, ...] = ()
    midway: bool = False


def failed_checks(
    solution: Solution, values: FloatArray, deviations: FloatArray, tick_s: float
) -> tuple[FailedCheck, ...]:
    """All that failed. ``values`` and their ``deviations`` are those of motor_values.PHYSICAL, then the two delays."""
    result = [*_too_short(solution, tick_s), *_slow_motion(solution, tick_s)]
    result += [*_wrong_signs(solution, values, deviations), *_unexplained(solution), *_cut_off(solution, tick_s)]
    return (*result, *([] if result else _changing(solution, tick_s)))


def status_of(status: Status, name: str, found: tuple[FailedCheck, ...]) -> Status:
    """``status``, unless it says that a number is valid which a check has failed."""
    failed = any(not check.names or name in check.names for check in found)
    return Status.DOUBTFUL if failed and status in (Status.VALID, Status.RATIO_ONLY) else status


def _too_short(solution: Solution, tick_s: float) -> Iterator[FailedCheck]:
    span_s = len(solution.residual) * tick_s
    if span_s < SHORTEST_S:
        yield FailedCheck(
            f"Only {span_s:.2g} s of the recording could be used: too little to say how good a number is; record more."
        )


def _slow_motion(solution: Solution, tick_s: float) -> Iterator[FailedCheck]:
    period_s = max(rows.signals.position_period_s for rows in solution.regression.rows)
    if period_s > SLOWEST_TICKS * tick_s:
        yield FailedCheck(
            f"The position is read only every {1e3 * period_s:.3g} ms: what the shaft does in between, and with it the "
            "friction, is not known; have the drive send it with every tick."
        )


def _wrong_signs(solution: Solution, values: FloatArray, deviations: FloatArray) -> Iterator[FailedCheck]:
    gain, inertia = (values[row] / max(deviations[row], 1e-300) for row in (0, 2))
    if solution.free_motion:
        # The gain is 1 by definition; what it is per unit of inertia has the sign.
        if inertia < -SIGNIFICANT:
            yield FailedCheck(
                "A positive command drives the shaft backwards: check the sign of the command and of the motion "
                "(direction of the actuator)."
            )
        return
    if inertia < -SIGNIFICANT:
        yield FailedCheck(
            "The inertia comes out negative: the signs of torque and motion do not agree; check the direction of the "
            "torque sensor and of the actuator."
        )
    elif gain < -SIGNIFICANT:
        yield FailedCheck(
            "A positive command drives the shaft backwards: check the sign of the command (direction of the actuator).",
            ("torque_gain", "torque_constant", "amplifier_gain"),
        )


def _unexplained(solution: Solution) -> Iterator[FailedCheck]:
    # What the readings' own errors leave is not to be explained: coarse counts may leave more than all motion.
    beyond = float(np.mean(solution.residual**2)) - solution.regression.noise_left(solution.linear)
    left = float(np.sqrt(max(beyond, 0.0)) / max(np.std(solution.regression.target()), 1e-300))
    if left > UNEXPLAINED:
        what = "motion" if solution.free_motion else "torque"
        yield FailedCheck(
            f"The network leaves {min(left, 1.0):.0%} of the {what} unexplained: check which reading is which, their "
            "units, signs and clocks, and whether something else acted."
        )


def _cut_off(solution: Solution, tick_s: float) -> Iterator[FailedCheck]:
    longest_s = USED_UP * DELAY_TICKS * tick_s
    for name, delay_s in (("command", solution.shape.command_delay_s), ("motion", solution.shape.motion_delay_s)):
        if abs(delay_s) > longest_s:
            yield FailedCheck(
                f"{name.capitalize()} and torque are out of step by more than the {1e3 * DELAY_TICKS * tick_s:.3g} ms "
                "that are searched: check the sensor's own filter and its clock."
            )


def _changing(solution: Solution, tick_s: float) -> Iterator[FailedCheck]:
    """A delay or a constant of the machine that differs before and after some instant."""
    blocks = Blocks.of(solution)
    count = blocks.time_s.size
    if count < FEWEST_BLOCKS:
        return
    splits = np.unique(np.linspace(0, count, SPLITS + 2)[1:-1].astype(np.int64))
    best: tuple[float, str, int] | None = None
    for column, name, worth_a_word, unit in _judged(solution, tick_s):
        least = max(worth_a_word, 2.0 * blocks.undone(solution, column))
        told = blocks.told(column)[splits]
        for split in splits[(told > TRIMMED) & (told < 1.0 - TRIMMED)]:
            after = (np.arange(count) >= split).astype(np.float64)
            change, deviation = blocks.change(column, after, int(split))
            ratio = abs(change) / max(deviation, 1e-300)
            if ratio > CHANGE_SIGNIFICANT and abs(change) > least and (best is None or ratio > best[0]):
                if not _confirmed(solution, blocks, column, least, int(split)):
                    continue
                amount = (
                    f"{1e3 * abs(change):.2g} ms" if unit == "s" else f"{CHANGE_SHARE * abs(change) / worth_a_word:.0%}"
                )
                best = (ratio, f"The {name} is not the same throughout: it differs by some {amount}", int(split))
    if best is not None:
        at_s = float(blocks.time_s[best[2]])
        yield FailedCheck(
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


# The command must explain this many times what nothing explains, or the port's torque sets no scale: errors in what
# explains a torque make its scale too small by the square of their share, here by 1/25, which can be taken off.
LEAST_EVIDENCE = 5.0
BELOW_ZERO = 3.0  # deviations: one in a thousand by chance
# Of the torque, rms: a fit leaves hardly more where nothing is wrong.
LEFT_BY_A_GOOD_FIT = 0.05
# Deviations to which a residual can be told from the noise in it.
TOLD_FROM_NOISE = 2.0


def scale_evidence(solution: Solution) -> float:
    """What only the command explains of the torque, over what nothing explains, both rms.

    Next to nothing where the machine across the port is passive: it then answers the motion as this one does,
    and the torque between them follows from the motion alone, whatever the command.
    """
    return _of_command_nm(solution) / float(np.sqrt(np.mean(solution.innovation**2)))


def comes_out_negative(solution: Solution, covariance: FloatArray) -> bool:
    """Whether inertia, damping or friction come out below zero, as no machine's are: then the fit has found the machine
    across the port, seen from the other side."""
    at = [INERTIA, VISCOUS, COULOMB]
    return bool(np.any(solution.linear[at] < -BELOW_ZERO * np.sqrt(np.diag(covariance))[at]))


def _of_command_nm(solution: Solution) -> float:
    """What only the command explains of the torque, rms."""
    lag, others = solution.jacobian[:, GAIN], np.delete(solution.jacobian, GAIN, axis=1)
    alone = lag - linear_solution(others.T, lag) @ others.T
    return float(abs(solution.linear[GAIN]) * np.sqrt(np.mean(alone**2)))


def why_no_scale(solution: Solution) -> str:
    """Why a load's own values cannot be told: its command explains too little, or nothing explains too much."""
    torque_nm = float(np.sqrt(np.mean(solution.regression.target() ** 2)))
    own, left = _of_command_nm(solution) / torque_nm, float(np.sqrt(np.mean(solution.innovation**2))) / torque_nm
    if own < LEAST_EVIDENCE * LEFT_BY_A_GOOD_FIT:
        return (
            "the port's torque follows from the motion alone, so the load's own values cannot be told: command the "
            "actuator too, independently of the load, and see that the torque sensor works"
        )
    return (
        f"the load's command, motion and friction leave {left:.0%} of the port's torque unexplained, too much to tell "
        f"the load's own values by: its command alone explains {own:.0%}, and should explain {LEAST_EVIDENCE:g} times "
        "what is left. Commands or readings may come late, by times that vary (a busy computer, an adapter, a full "
        "bus: `norton-bench rig check` shows it; end other programs and repeat), or something else acts on the shaft"
    )


def beyond_noise(solution: Solution) -> float:
    """The share of the residual's power that the torque readings' own noise does not explain, as far as can be told.

    That noise makes a number uncertain, as its deviation says, but sets no wrong scale; the encoder's does. The power
    of n normal errors is known to √(2/n) of itself (chi-squared), n rows that are not alike.
    """
    regression = solution.regression
    counts = [row.usable.size for row in regression.rows]
    noise = float(np.average([row.noise()[0] for row in regression.rows], weights=counts))
    determined = TOLD_FROM_NOISE * np.sqrt(2.0 * regression.alike / solution.residual.size)
    left = float(np.mean(solution.residual**2))
    return float(np.clip(1.0 - noise / max(left, 1e-300), min(determined, 1.0), 1.0))
