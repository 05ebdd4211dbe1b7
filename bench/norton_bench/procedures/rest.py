"""The bench left alone for a while, and watched: to cool down, or to see what drifts."""

from dataclasses import dataclass, field
from typing import ClassVar

from norton_bench.procedures.knowledge import Knowledge, Plan
from norton_bench.procedures.options import RestOptions
from norton_bench.procedures.waves import coasting, hold
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

# A segment holds all its commands: a long rest is made of many.
PIECE_S = 10.0


@dataclass(frozen=True)
class RestProcedure:
    """Drives enabled, no command, the load coasting: everything is measured and recorded, nothing is fitted."""

    options: RestOptions = field(default_factory=RestOptions)
    name: ClassVar[str] = "rest"

    def require(self, rig: Rig) -> None:
        """Any rig will do."""

    def duration_s(self, rig: Rig) -> float:
        return self.options.duration_s

    def plan(self, known: Knowledge) -> Plan:
        left_s = self.options.duration_s
        while left_s > 0.5 * known.tick_s:
            piece_s = min(left_s, PIECE_S)
            yield coasting(self.name, "rest", Use.PREPARE, hold(0.0, piece_s, known.tick_s))
            left_s -= piece_s

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
