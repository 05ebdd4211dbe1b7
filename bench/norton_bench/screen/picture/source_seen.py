"""The motion source as it fills in: velocity against command while zero torque is imposed."""

from dataclasses import dataclass, field

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.records import Measured, SegmentInfo, Table

PROCEDURE, STAIRCASE, SWEEP = "free", "staircase", "search"
# The velocity of a level is that of the end of its dwell.
SETTLED_SHARE = 0.5
SHORTEST_DWELL_TICKS = 20
CLOUD_EVERY_TICKS = 10
LONGEST_CLOUD = 6000


@dataclass
class SourceSeen:
    """``levels``: by staircase, the command and the settled velocity [rad/s] of each level, shape (levels, 2).

    ``cloud`` holds the sweeps, likewise, shape (points, 2).
    """

    levels: dict[int, FloatArray] = field(default_factory=dict)
    cloud: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    _rising: dict[int, bool] = field(default_factory=dict)
    _stairs: dict[int, list[Table]] = field(default_factory=dict)

    def take(self, part: Measured) -> None:
        """What the part adds: sweeps as they are, staircases level by level."""
        for segment in part.segments:
            if segment.procedure == PROCEDURE and len(part.ticks):
                rows = part.ticks[part.ticks["segment"] == segment.index]
                if segment.name.startswith(STAIRCASE):
                    self._step(segment, rows)
                elif segment.name.startswith(SWEEP):
                    self._sweep(rows)

    def branch(self, *, rising: bool) -> FloatArray:
        """The levels approached from below, or from above."""
        found = [self.levels[index] for index, up in self._rising.items() if up is rising and len(self.levels[index])]
        return np.concatenate(found) if found else np.empty((0, 2))

    def _sweep(self, rows: Table) -> None:
        thin = rows[::CLOUD_EVERY_TICKS]
        self.cloud = np.concatenate([self.cloud, _pairs(thin)])[-LONGEST_CLOUD:]

    def _step(self, segment: SegmentInfo, rows: Table) -> None:
        pieces = self._stairs.setdefault(segment.index, [])
        pieces.append(rows)
        stairs = np.concatenate(pieces)
        edges = np.flatnonzero(np.diff(stairs["command"])) + 1
        dwells = [dwell for dwell in np.split(stairs, edges) if len(dwell) >= SHORTEST_DWELL_TICKS]
        settled = [_pairs(dwell[round(SETTLED_SHARE * len(dwell)) :]).mean(axis=0) for dwell in dwells]
        self.levels[segment.index] = np.array(settled).reshape(-1, 2)
        self._rising[segment.index] = "falling" not in segment.name


def _pairs(rows: Table) -> FloatArray:
    return np.column_stack([rows["command"], rows["velocity_rad_s"]])
