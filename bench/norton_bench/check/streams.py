"""How steadily readings came, and what is wrong with that."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import pstdev

from norton_bench.check.findings import Problem, StreamCheck
from norton_bench.check.watch import Watched
from norton_bench.errors import ExperimentError
from norton_bench.rig.rig import Rig
from norton_drivers.errors import DeviceTimeoutError
from norton_drivers.readings import DriveState, DriveStatus, TorqueReading


def streams_of(each: Watched, watch_s: float) -> tuple[StreamCheck, ...]:
    """One figure for each stream that the device has."""
    return tuple(
        _stream(name, [reading.arrival_ns for reading in readings], each.ages_ns.get(name, []), watch_s)
        for name, readings in each.readings.items()
    )


def _stream(name: str, stamps: Sequence[int], ages_ns: Sequence[int], watch_s: float) -> StreamCheck:
    gaps = [(later - earlier) * 1e-9 for earlier, later in pairwise(stamps)]
    return StreamCheck(
        name,
        len(stamps),
        len(gaps) / sum(gaps) if sum(gaps) > 0 else len(stamps) / watch_s,
        pstdev(gaps) if gaps else 0.0,
        sum(ages_ns) / len(ages_ns) * 1e-9 if ages_ns else 0.0,
        max(gaps, default=watch_s),
    )


def stream_problems(each: Watched, streams: Sequence[StreamCheck], rig: Rig) -> Iterator[Problem]:
    """Streams that are missing, too slow for the guard, or invalid by their own word."""
    role, stale_s = each.settings.role, rig.limits.stale_after_ns * 1e-9
    for stream in streams:
        needed = stream.name != "current"
        if needed and stream.readings == 0:
            yield DeviceTimeoutError(
                f"[{role}] sends no {stream.name} readings; switch on its cyclic messages, check power and cable"
            )
        elif needed and stream.longest_gap_s > stale_s:
            yield ExperimentError(
                f"[{role}] {stream.name} readings come at {stream.rate_hz:.0f} Hz with gaps of up to "
                f"{stream.longest_gap_s * 1e3:.1f} ms, beyond stale_after = {stale_s * 1e3:g} ms: "
                "let the device send more often, or raise [limits] stale_after"
            )
    invalid = sum(isinstance(r, TorqueReading) and not r.valid for r in each.readings.get("torque", ()))
    if invalid:
        yield ExperimentError(f"[{role}] marks {invalid} of its readings as invalid; check it for overload or faults")


def status_problems(role: str, status: DriveStatus | None) -> Iterator[Problem]:
    """A drive that is in fault."""
    if status is not None and status.state is DriveState.FAULT:
        words = ", ".join(status.errors) or "no reason given"
        yield ExperimentError(f"[{role}] drive is in fault: {words}; mend the cause, it is cleared on enabling")
