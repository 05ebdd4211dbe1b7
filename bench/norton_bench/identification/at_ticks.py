"""What was read and sent at the ticks of a segment, and the part of it in a band of frequencies."""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.counts import resolution_of, unquantised
from norton_bench.identification.readings import noise_deviation
from norton_bench.identification.signals import INTERPOLATION, stream_of
from norton_bench.records import Measured, SegmentInfo, Table

# Above it the bench's models are not known to a fraction of a turn of phase: nothing is learnt there.
TAUGHT_HZ = 30.0


@dataclass(frozen=True, eq=False)
class TickReadings:
    """What arrived during a segment, at its ticks: arrays of shape (ticks,), delays included.

    ``torque_nm`` is as read, bias included; None where no sensor reads it. ``torque_noise_nm`` is the standard
    deviation of one reading.
    """

    position_rad: FloatArray
    load_position_rad: FloatArray
    torque_nm: FloatArray | None = None
    torque_noise_nm: float = 0.0


def readings_at_ticks(measured: Measured, segment: SegmentInfo, ticks: int, tick_s: float) -> TickReadings:
    """What arrived in ``segment``, on the grid of its ticks. Raises ExperimentError where a stream has gaps in it."""
    part = measured.between(segment.start_ns, segment.end_ns)
    at_s: FloatArray = np.asarray(np.arange(ticks) * tick_s, dtype=np.float64)
    torque = part.torque[part.torque["valid"]]
    reads = len(torque) > 0
    return TickReadings(
        _position(part.motion, segment, at_s, "the actuator's position"),
        _position(part.load_motion, segment, at_s, "the load's position"),
        _at(torque, "torque_nm", segment, at_s, "torque") if reads else None,
        noise_deviation(torque["torque_nm"], np.ones(len(torque), dtype=bool)) if reads else 0.0,
    )


def sent_at_ticks(measured: Measured, segment: SegmentInfo, column: str, ticks: int, tick_s: float) -> FloatArray:
    """A column of the segment's ticks, (ticks,): what was sent last goes on where a tick was missed."""
    rows = measured.ticks[measured.ticks["segment"] == segment.index]
    numbers = np.round((rows["tick_ns"] - segment.start_ns) * 1e-9 / tick_s).astype(np.int64)
    last = np.searchsorted(numbers, np.arange(ticks), side="right") - 1
    return np.asarray(rows[column][np.maximum(last, 0)], dtype=np.float64)


def in_band(values: FloatArray, tick_s: float, highest_hz: float = TAUGHT_HZ, derivative: int = 0) -> FloatArray:
    """A derivative of ``values`` (..., ticks) below ``highest_hz``, without any delay; zero before and after."""
    ticks = values.shape[-1]
    size = 2 * ticks
    factors: FloatArray | ComplexArray = low_pass(size, tick_s, highest_hz)
    if derivative:
        factors = factors * (2j * np.pi * np.fft.rfftfreq(size, tick_s)) ** derivative
    return np.asarray(np.fft.irfft(np.fft.rfft(values, size) * factors, size)[..., :ticks])


def low_pass(size: int, tick_s: float, highest_hz: float = TAUGHT_HZ) -> FloatArray:
    """1 below ``highest_hz`` and 0 above twice that, at the frequencies of a real transform of ``size`` values."""
    above = np.clip(np.fft.rfftfreq(size, tick_s) / highest_hz - 1.0, 0.0, 1.0)
    return np.asarray(0.5 * (1.0 + np.cos(np.pi * above)))


def _position(table: Table, segment: SegmentInfo, at_s: FloatArray, what: str) -> FloatArray:
    """Counts undone: what friction holds minds every one of them."""
    step_rad = resolution_of(table["position_rad"]).width if len(table) else 0.0
    smooth = table.copy()
    if len(table):
        smooth["position_rad"] = unquantised(np.ascontiguousarray(table["position_rad"]), step_rad)
    return _at(smooth, "position_rad", segment, at_s, what)


def _at(table: Table, column: str, segment: SegmentInfo, at_s: FloatArray, what: str) -> FloatArray:
    """Interpolated at instants since the segment began; at its very ends the nearest that is known."""
    if len(table) < 4 * INTERPOLATION.half_width:
        raise ExperimentError(f"{segment.procedure}: next to nothing was read of {what} in {segment.name}; repeat it")
    stream = stream_of(table, column, segment.start_ns)
    reach_s = (INTERPOLATION.half_width + 1) * stream.period_s
    return stream.at(np.clip(at_s, stream.time_s[0] + reach_s, stream.time_s[-1] - reach_s))
