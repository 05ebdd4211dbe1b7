"""What the bench is doing when a fault strikes: motion imposed by one drive, a changing command on the other."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.procedures.free import command_multisine
from norton_bench.procedures.imposed import imposed_multisine
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.makers import back, imposed
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

DURATION_S = 1.5
MOTION_SHARE = 0.3
COMMAND_SHARE = 0.5
SWINGS = 2  # of a modulator
REST_S = 0.2


@dataclass(frozen=True)
class Exercise:
    """A second and a half of it; then both drives let go, slowly where the actuator may be a spring."""

    name: ClassVar[str] = "exercise"

    def require(self, rig: Rig) -> None:
        require_load(rig, "faults", "so that there is motion to be disturbed")

    def duration_s(self, rig: Rig) -> float:
        return DURATION_S + REST_S

    def plan(self, known: Knowledge) -> Plan:
        limit = COMMAND_SHARE * known.rig.command.limit
        motion = imposed_multisine(known, MOTION_SHARE, DURATION_S, seed=3)
        command = command_multisine(known, (-limit, limit), DURATION_S, seed=4)
        moving = imposed(self.name, "motion and command", Use.PREPARE, command, motion)
        moved = yield replace(moving, modulation=_modulation(known.rig, moving.ticks))
        yield back(self.name, "rest", known.rig, moved, REST_S)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known


def _modulation(rig: Rig, ticks: int) -> FloatArray:
    """To and fro from zero; none where nothing is modulated."""
    if rig.modulation is None:
        return np.empty(0)
    phase = 2 * np.pi * SWINGS * np.arange(ticks) / ticks
    return np.asarray(0.5 * COMMAND_SHARE * rig.modulation.limit * (1 - np.cos(phase)))
