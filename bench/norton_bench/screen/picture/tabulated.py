"""Source and impedance as they are tabulated: where the port was read, and what it exerted there."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from norton_bench.identification.tables import exertion_table, source_table
from norton_bench.records import Measured, SegmentInfo

SOURCE, EXTERNAL, HELD = "source", "external", "held"


class Reading(NamedTuple):
    """``what``: the source at the actuator's port, or at the external one, or the port held away from it.

    ``rising`` is the side from which command or place were come to.
    """

    what: str
    rising: bool
    command: float
    position_rad: float
    torque_nm: float


@dataclass
class Tabulated:
    """``readings`` in the order in which they were made, by segment; the last one may still settle."""

    readings: dict[int, Reading] = field(default_factory=dict)

    @property
    def sources(self) -> list[Reading]:
        """Those of the port whose source was read last."""
        found = [each for each in self.readings.values() if each.what != HELD]
        return [each for each in found if each.what == found[-1].what]

    def take(self, part: Measured) -> None:
        """What the newest ticks say of each reading under way."""
        for segment in part.segments:
            what = _what(segment)
            rows = part.ticks[part.ticks["segment"] == segment.index] if what else part.ticks[:0]
            if not len(rows):
                continue
            command, position_rad, torque_nm = (
                float(np.mean(rows[column])) for column in ("command", "position_rad", "torque_nm")
            )
            self.readings[segment.index] = Reading(
                what, self._rising(segment, what, command), command, position_rad, torque_nm
            )

    def _rising(self, segment: SegmentInfo, what: str, command: float) -> bool:
        if what == HELD:
            return segment.name.endswith("rising")
        before = [each.command for index, each in self.readings.items() if index < segment.index]
        return command >= before[-1] if before else command >= 0.0


def _what(segment: SegmentInfo) -> str:
    """Empty where nothing is read."""
    if segment.procedure == exertion_table.PROCEDURE:
        if segment.name.startswith(exertion_table.HOLD):
            return HELD
        return SOURCE if segment.name == exertion_table.READ else ""
    if segment.procedure == source_table.PROCEDURE and segment.name.startswith(source_table.READ):
        return EXTERNAL if segment.name.endswith(EXTERNAL) else SOURCE
    return ""
