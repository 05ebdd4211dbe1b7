"""The static source: where the port rests, with nothing pulling at it, under each command (paper, section IV.B.1)."""

from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import RigError
from norton_bench.identification.tables.source_table import LEAVE, PROCEDURE, READ
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.makers import coasting, zero_torque
from norton_bench.procedures.options import TabulateSourceOptions
from norton_bench.procedures.settling import MOVE_S, Maker, Patience, settle
from norton_bench.procedures.waves import hold, ramp
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use


@dataclass(frozen=True)
class TabulateSourceProcedure:
    """Commands rising, then falling; each is held until the shaft rests, then read.

    At the actuator's port the torque sensor is held at zero: the bench supplies whatever the load's own body takes. At
    the external port the load's drive gives nothing, and its body hangs on the actuator (section IV.C).
    """

    options: TabulateSourceOptions = field(default_factory=TabulateSourceOptions)
    name: ClassVar[str] = PROCEDURE

    def require(self, rig: Rig) -> None:
        if self.options.port == "external":
            require_load(rig, self.name, "whose body the external port moves")
        if rig.wiring.load is None and rig.wiring.shaft != "free":
            raise RigError(
                f"{rig.place}: step '{self.name}' needs a shaft that can turn; [rig] shaft is \"{rig.wiring.shaft}\""
            )

    def duration_s(self, rig: Rig) -> float:
        each_s = MOVE_S + 0.5 * self.options.at_most_s + self.options.read_s
        return (2 * self.options.levels - 1) * each_s + MOVE_S

    def plan(self, known: Knowledge) -> Plan:
        options, before = self.options, 0.0
        make, patience = self._maker(known.rig), Patience(options.settled_rad_s, options.at_most_s)
        levels = levels_between(known.rig, options.lowest, options.highest, options.levels)
        for level in np.concatenate([levels, levels[-2::-1]]):
            yield from settle(make, known, before, level, patience)
            yield make(f"{READ} {options.port}", Use.IDENTIFY, hold(level, options.read_s, known.tick_s))
            before = level
        yield make(LEAVE, Use.PREPARE, ramp(before, 0.0, MOVE_S, known.tick_s))

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known

    def _maker(self, rig: Rig) -> Maker:
        if self.options.port == "external":
            return partial(coasting, self.name)
        return partial(at_zero_torque, self.name, rig)


def at_zero_torque(procedure: str, rig: Rig, name: str, use: Use, command: FloatArray) -> Segment:
    """Nothing pulls at the actuator's port."""
    return zero_torque(procedure, name, use, command, rig)


def levels_between(rig: Rig, lowest: float, highest: float, count: int) -> FloatArray:
    """Commands evenly spread between two shares of the greatest, as far as the rig allows; shape (count,)."""
    least, greatest = rig.command.span
    ends = np.clip(np.array([lowest, highest]) * rig.command.limit, least, greatest)
    return np.linspace(ends[0], ends[1], count)
