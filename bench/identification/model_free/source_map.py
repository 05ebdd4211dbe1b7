"""The two static experiments, as measured: the motion source (free) and the Thévenin source (blocked), section IV.D."""

import numpy as np
import numpy.typing as npt

from bench.errors import ExperimentError
from bench.identification.model_free.dwells import PIECES, SKIPPED_SHARE, pieces_of, settled
from bench.identification.results import BlockedMap, SourceMap
from bench.records import Measured, SegmentInfo, Table

FloatArray = npt.NDArray[np.float64]

# The last part of a hold counts: before it the shaft still settles.
SETTLED_SHARE = 0.5
SHORTEST_DWELL_TICKS = 20
LEAST_READINGS = 3 * PIECES
# How the names of held segments tell the history by which standstill was reached: "hold from above, fast", ...
FAST, FROM_REST = ", fast", "hold from rest"
# Holds are averaged in this many blocks; the scatter of the blocks is that of correlated noise.
BLOCKS = 5


def source_map(measured: Measured) -> SourceMap:
    """Steady free velocity against command, from the staircases. Raises ExperimentError where there is none."""
    levels, velocities, spans_s = [], [], []
    for segment in measured.segments:
        if not is_staircase(segment):
            continue
        before = _command_before(measured.ticks, segment)
        for command, begin_ns, end_ns in dwells(measured.ticks, segment):
            start_ns = round(begin_ns + SKIPPED_SHARE * (end_ns - begin_ns))
            rows = measured.motion[_rows(measured.motion, "arrival_ns", start_ns, end_ns)]
            if len(rows) >= LEAST_READINGS:
                levels.append((command, command >= before))
                time_s = (rows["arrival_ns"] - rows["arrival_ns"][0]) * 1e-9
                velocities.append(pieces_of(time_s, rows["position_rad"]))
                spans_s.append(time_s[-1])
            before = command
    if not levels:
        raise ExperimentError("no staircase was recorded: run the step 'free' to measure the static source map")
    command, rising = np.array(levels, dtype=float).T
    found = settled(np.array(velocities), np.array(spans_s))
    deviation = np.std(found.resampled, axis=0)
    return SourceMap(command, found.velocity, deviation, rising > 0, found.resampled, found.settling_s)


def blocked_map(measured: Measured) -> BlockedMap:
    """Torque at standstill against command, by the side of approach. Raises ExperimentError where there is none."""
    levels, histories = [], []
    for segment in measured.segments:
        if segment.procedure != "blocked" or not segment.name.startswith("hold"):
            continue
        ticks = measured.ticks[_rows(measured.ticks, "tick_ns", segment.start_ns, segment.end_ns)]
        start_ns = round(segment.end_ns - SETTLED_SHARE * (segment.end_ns - segment.start_ns))
        torque = measured.torque[_rows(measured.torque, "arrival_ns", start_ns, segment.end_ns)]
        mean = _mean(torque["torque_nm"][torque["valid"]])
        if mean is not None and len(ticks):
            levels.append((float(np.median(ticks["command"])), *mean, "above" in segment.name))
            histories.append(_history(segment.name))
    if not levels:
        raise ExperimentError("no held level was recorded: run the step 'blocked' to measure the Thévenin source")
    table = np.array(levels, dtype=float)
    return BlockedMap(table[:, 0], table[:, 1], table[:, 2], table[:, 3] > 0, tuple(histories))


def _history(name: str) -> str:
    if name == FROM_REST:
        return "rest"
    return "fast" if name.endswith(FAST) else "slow"


def _rows(table: Table, key: str, start_ns: int, end_ns: int) -> slice:
    first, last = np.searchsorted(table[key], [start_ns, end_ns])
    return slice(int(first), int(last))


def _command_before(ticks: Table, segment: SegmentInfo) -> float:
    """The command from which the first level is reached, or would be by steps like the next one."""
    rows = _rows(ticks, "tick_ns", segment.start_ns, segment.end_ns)
    own = ticks["command"][rows]
    earlier = ticks["command"][: rows.start][-1] if rows.start > 0 else own[0]
    changed = own[own != own[0]]
    if earlier != own[0] or not changed.size:
        return float(earlier)
    return float(own[0] - (changed[0] - own[0]))


def is_staircase(segment: SegmentInfo) -> bool:
    """Whether it holds level after level with no torque at the port."""
    return segment.procedure == "free" and segment.name.startswith("staircase")


def dwells(ticks: Table, segment: SegmentInfo) -> list[tuple[float, int, int]]:
    """Each level of a staircase: the command, and when its dwell begins and ends [ns]."""
    own = ticks[_rows(ticks, "tick_ns", segment.start_ns, segment.end_ns)]
    edges = np.flatnonzero(np.diff(own["command"]) != 0) + 1
    return [
        (float(part["command"][0]), int(part["tick_ns"][0]), int(part["tick_ns"][-1]))
        for part in np.split(own, edges)
        if len(part) >= SHORTEST_DWELL_TICKS
    ]


def _mean(values: FloatArray) -> tuple[float, float] | None:
    if len(values) < 4 * BLOCKS:
        return None
    means = [float(np.mean(part)) for part in np.array_split(values, BLOCKS)]
    return float(np.mean(values)), float(np.std(means, ddof=1) / np.sqrt(BLOCKS))
