"""Plans that keep to every limit of the rig, by what has been measured so far: made smaller until they do."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.procedures.calibrate import first_inertia_kgm2
from norton_bench.procedures.excitations import SHARE, Bounds
from norton_bench.procedures.knowledge import Knowledge, why_no_basis
from norton_bench.procedures.waves import Motion
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig

# A plan of which less than this is left tells nothing any more; the guard is there for what it does then.
LEAST = 0.05
# Each try is so much smaller than the last.
SMALLER = 0.95
# What is named as made smaller: less than this of what was asked for.
WORTH_A_WORD = 0.99


@dataclass(frozen=True)
class Sized:
    """A plan at ``share`` of the size that was asked for: command and motion alike, both of shape (ticks,)."""

    command: FloatArray
    motion: Motion
    share: float


def bounds_of(known: Knowledge) -> Bounds | None:
    """The rig's limits, judged by the calibration and the actuator's first fit; None where one is missing."""
    fit = known.actuator
    if known.calibration is None or fit is None or first_inertia_kgm2(fit) is None:
        return None
    if why_no_basis(replace(fit, converged=True), "the actuator") is not None:
        return None
    return Bounds(known.rig, fit.network.dissipative(), known.calibration, travel_left_rad(known.records, known.rig))


def travel_left_rad(records: Sequence[Measured], rig: Rig) -> float:
    """How far the shaft may go either way, from where it stands, within the window about where it stood at first."""
    limit_rad = rig.limits.position_rad
    if not records or not np.isfinite(limit_rad):
        return limit_rad
    position_rad = np.concatenate([records[0].ticks["position_rad"], records[-1].ticks["position_rad"]])
    stood_rad = position_rad[np.isfinite(position_rad)]
    return limit_rad - abs(float(stood_rad[-1] - stood_rad[0]))


def imposed_within(bounds: Bounds | None, command: FloatArray, motion: Motion) -> Sized:
    """Command and imposed motion, as large as the limits allow, and no larger than asked for."""
    share = 1.0
    while bounds is not None and share > LEAST and not bounds.allow(share * command, motion.scaled(share), SHARE):
        share *= SMALLER
    return Sized(share * command, motion.scaled(share), share)


def held_within(bounds: Bounds | None, command: FloatArray, motion: Motion) -> Sized:
    """The same where the motion is small, and only the command is made smaller."""
    share = 1.0
    while bounds is not None and share > LEAST and not bounds.allow(share * command, motion, SHARE):
        share *= SMALLER
    return Sized(share * command, motion, share)


def free_within(bounds: Bounds | None, command: FloatArray) -> float:
    """The share of ``command`` (ticks,) under which the free motion, and what the load takes to follow, stay inside."""
    share = 1.0
    while bounds is not None and share > LEAST and not bounds.allow_free(share * command, SHARE):
        share *= SMALLER
    return share


def words_for(what: str, share: float) -> tuple[str, ...]:
    """What it costs that ``what`` was made smaller; nothing where it hardly was."""
    if share > WORTH_A_WORD:
        return ()
    return (
        f"{what} at {share:.0%} of its usual size, to stay within {SHARE:.0%} of every limit: as much time tells "
        f"parameters {1 / share:.1f} times less finely; higher [limits] or a longer step would mend that",
    )
