"""What of a part may be believed at all, before anything is learned from it.

A final fit can look at everything twice; what runs live digests each reading once and must not be poisoned by it.
"""

from dataclasses import replace

import numpy as np

from norton_bench.identification.soundness.stray import rising, spikes
from norton_bench.records import Measured, Table

# Readings arrive within so long of the ticks of their part.
STRAY_NS = 1_000_000_000


def sound(part: Measured) -> Measured:
    """The part without readings that are not finite, stand alone far off, or bear an impossible time."""
    ticks = part.ticks[np.isfinite(part.ticks["command"])]
    if not len(ticks):
        return replace(part, ticks=ticks, motion=part.motion[:0], torque=part.torque[:0])
    ticks = ticks[rising(ticks["tick_ns"])]
    span_ns = int(ticks["tick_ns"][0]) - STRAY_NS, int(ticks["tick_ns"][-1]) + STRAY_NS
    return replace(
        part,
        ticks=ticks,
        motion=_readings(part.motion, "position_rad", span_ns),
        torque=_readings(part.torque[part.torque["valid"]], "torque_nm", span_ns),
    )


def _readings(table: Table, column: str, span_ns: tuple[int, int]) -> Table:
    arrival_ns = table["arrival_ns"]
    table = table[np.isfinite(table[column]) & (arrival_ns >= span_ns[0]) & (arrival_ns <= span_ns[1])]
    return table[~spikes(table[column])]
