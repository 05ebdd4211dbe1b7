"""The impedance's samples: measured and predicted torque beside the motion that was imposed."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.identification.results import Trace
from norton_bench.records import Measured, SegmentInfo

_LOOP = "loop"  # names of the imposed procedure's segments
_GRID = "grid"
_WIDEST_LOOP = 12.0  # in units of the friction contact's deflection: beyond this the loop is mostly sliding
_STEADY_SHARE = 1e-6  # change of the reference velocity in a tick, of its greatest value


@dataclass(frozen=True)
class Loop:
    """Arrays of shape (n,); position about its middle."""

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    measured_nm: FloatArray
    predicted_nm: FloatArray


def presliding_loops(measured: Measured, trace: Trace, deflection_rad: float) -> list[Loop]:
    """The small loops, widest first, as far as they were fitted; ``deflection_rad`` is the contact's, τc/σ0."""
    loops = [_loop(measured, trace, segment) for segment in _segments(measured, _LOOP)]
    small = [loop for loop in loops if len(loop.position_rad) and _width(loop) <= _WIDEST_LOOP * deflection_rad]
    return sorted(small, key=_width, reverse=True)


def sliding_samples(measured: Measured, trace: Trace) -> Loop | None:
    """The steady part of the velocity grid, None where there was none."""
    loops = [_steady(measured, trace, segment) for segment in _segments(measured, _GRID)]
    if not any(len(loop.velocity_rad_s) for loop in loops):
        return None
    return Loop(
        *(
            np.concatenate([getattr(loop, name) for loop in loops])
            for name in ("position_rad", "velocity_rad_s", "measured_nm", "predicted_nm")
        )
    )


def bench_time_s(measured: Measured, stamp_ns: npt.ArrayLike) -> FloatArray:
    """Seconds since the first tick, the time axis of every trace."""
    origin_ns = measured.ticks["tick_ns"][0] if len(measured.ticks) else 0
    return np.asarray((np.asarray(stamp_ns, dtype=np.int64) - origin_ns) * 1e-9, dtype=np.float64)


def _segments(measured: Measured, kind: str) -> list[SegmentInfo]:
    return [
        segment for segment in measured.segments if segment.procedure == "imposed" and segment.name.startswith(kind)
    ]


def _width(loop: Loop) -> float:
    return float(np.ptp(loop.position_rad))


def _loop(measured: Measured, trace: Trace, segment: SegmentInfo) -> Loop:
    start_s, end_s = bench_time_s(measured, [segment.start_ns, segment.end_ns])
    known = np.isfinite(trace.measured) & np.isfinite(trace.predicted)
    chosen = np.flatnonzero(known & (trace.time_s >= start_s) & (trace.time_s < end_s))
    time_s = trace.time_s[chosen]
    if not len(chosen) or not len(measured.motion):
        return Loop(*(np.empty(0),) * 4)
    motion_s = bench_time_s(measured, measured.motion["arrival_ns"])
    position = np.interp(time_s, motion_s, measured.motion["position_rad"])
    return Loop(
        position_rad=position - (position.max() + position.min()) / 2,
        velocity_rad_s=np.interp(time_s, motion_s, measured.motion["velocity_rad_s"]),
        measured_nm=trace.measured[chosen],
        predicted_nm=trace.predicted[chosen],
    )


def _steady(measured: Measured, trace: Trace, segment: SegmentInfo) -> Loop:
    """The segment's samples where the velocity asked for stands still."""
    start_s, end_s = bench_time_s(measured, [segment.start_ns, segment.end_ns])
    ticks_s = bench_time_s(measured, measured.ticks["tick_ns"])
    chosen = (ticks_s >= start_s) & (ticks_s < end_s)
    wanted = measured.ticks["reference_velocity_rad_s"][chosen]
    if len(wanted) < 3 or not np.isfinite(wanted).any():
        return _loop(measured, trace, segment)
    still = np.abs(np.diff(wanted, append=wanted[-1])) <= _STEADY_SHARE * np.nanmax(np.abs(wanted))
    known = np.isfinite(trace.measured) & np.isfinite(trace.predicted)
    within = known & (trace.time_s >= start_s) & (trace.time_s < end_s)
    places = np.clip(np.searchsorted(ticks_s[chosen], trace.time_s), 0, len(still) - 1)
    masked = Trace(trace.time_s, np.where(within & still[places], trace.measured, np.nan), trace.predicted, trace.unit)
    return _loop(measured, masked, segment)
