"""What of a part may be believed at all, before anything is learned from it.

A final fit can look at everything twice; what runs live digests each reading once and must not be poisoned by it.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from bench.records import Measured, Table

BoolArray = npt.NDArray[np.bool_]

# Readings arrive within so long of the ticks of their part.
STRAY_NS = 1_000_000_000
# A reading that leaves both neighbours behind by so many times what readings usually change is no reading.
SPIKE = 20.0
USUAL = 0.8


def sound(part: Measured) -> Measured:
    """The part without readings that are not finite, stand alone far off, or bear an impossible time."""
    ticks = part.ticks[np.isfinite(part.ticks["command"])]
    if not len(ticks):
        return replace(part, ticks=ticks, motion=part.motion[:0], torque=part.torque[:0])
    ticks = ticks[_rising(ticks["tick_ns"])]
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
    return table[~_spikes(table[column])]


def _rising(stamp_ns: npt.NDArray[np.int64]) -> BoolArray:
    """Stamps later than all before them."""
    latest = np.maximum.accumulate(stamp_ns)
    return np.concatenate([[True], stamp_ns[1:] > latest[:-1]])


def _spikes(values: npt.NDArray[np.float64]) -> BoolArray:
    """Single values far from both neighbours, on the same side of them."""
    spikes = np.zeros(values.size, dtype=bool)
    if values.size < 20:
        return spikes
    steps = np.diff(values)
    usual = SPIKE * float(np.quantile(np.abs(steps), USUAL))
    far = np.minimum(np.abs(steps[:-1]), np.abs(steps[1:])) > usual
    spikes[1:-1] = far & (steps[:-1] * steps[1:] < 0.0)
    return spikes
