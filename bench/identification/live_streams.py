"""Streams as they come in, part by part: instants recovered on the way, then everything on one grid, a little late."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from bench.identification import loops
from bench.identification.kernels import TABLE_PER_UNIT
from bench.identification.quantisation import moving, resolution_rad, unquantised
from bench.identification.signals import FINE, INTERPOLATION
from bench.identification.timing import nominal_period_s, sampled_at_s
from bench.records import NO_DEVICE_TIME, Measured, Table

FloatArray = npt.NDArray[np.float64]

# Clocks are followed over this long a window.
WINDOW_S = 1.5
# The grid ends this much before the newest reading: the reach of interpolation, and room for smoothing to settle.
MARGIN_S = 0.06
FIRST_AFTER_S = 0.4


@dataclass(frozen=True)
class Piece:
    """A stretch of the grid that follows the one before without a gap; shapes as in Signals."""

    time_s: FloatArray
    torque_nm: FloatArray
    position_rad: FloatArray
    path_rad: FloatArray
    moving: FloatArray  # 1 where the encoder's counts tell what friction holds, else 0
    sent_s: FloatArray
    command: FloatArray


@dataclass
class LiveStreams:
    """Collects parts and hands out pieces."""

    tick_s: float
    origin_ns: int | None = None
    parts: list[Measured] = field(default_factory=list)
    resolution: float = 0.0
    _next_s: float = field(default=float("nan"), init=False)

    def add(self, part: Measured) -> Piece | None:
        """The grid as far as it can be known now; None where nothing new can be."""
        self.parts.append(part)
        motion, torque, ticks = (self._joined(name) for name in ("motion", "torque", "ticks"))
        if not len(motion) or not len(torque) or not len(ticks):
            return None
        if self.origin_ns is None:
            self.origin_ns = int(ticks["tick_ns"][0])
        self._forget(int(ticks["tick_ns"][-1]))
        torque = torque[torque["valid"]]
        motion_s, torque_s = self._times(motion, None), self._times(torque, _own_clock(torque))
        newest_s = min(motion_s[-1], torque_s[-1], (int(ticks["tick_ns"][-1]) - self.origin_ns) * 1e-9) - MARGIN_S
        oldest_s = max(motion_s[0], torque_s[0]) + MARGIN_S
        if np.isnan(self._next_s) or self._next_s < oldest_s:
            # The beginning, or a silence longer than what is kept: a new start.
            self._next_s = oldest_s
        count = int((newest_s - self._next_s) / self.tick_s)
        if count <= 0 or newest_s - oldest_s < FIRST_AFTER_S:
            return None
        return self._piece(count, motion, motion_s, torque, torque_s, ticks)

    def _piece(
        self, count: int, motion: Table, motion_s: FloatArray, torque: Table, torque_s: FloatArray, ticks: Table
    ) -> Piece:
        assert self.origin_ns is not None
        time_s = np.asarray(self._next_s + np.arange(count) * self.tick_s, dtype=np.float64)
        fine_s = np.asarray(self._next_s + np.arange(count * FINE) * (self.tick_s / FINE), dtype=np.float64)
        self._next_s = float(time_s[-1] + self.tick_s)
        # Only what is new, and what its smoothing reaches back to.
        first = int(np.searchsorted(motion_s, time_s[0] - 2 * MARGIN_S))
        position = np.ascontiguousarray(motion["position_rad"][first:], dtype=float)
        if self.resolution == 0.0:
            self.resolution = resolution_rad(np.ascontiguousarray(motion["position_rad"]))
        path = unquantised(position, self.resolution)
        table, period_s = INTERPOLATION.table(), nominal_period_s(motion["arrival_ns"])
        torque_nm = np.ascontiguousarray(torque["torque_nm"], dtype=float)
        torque_period_s = nominal_period_s(torque["arrival_ns"])
        sent_s = np.asarray((ticks["tick_ns"] + ticks["lateness_ns"] - self.origin_ns) * 1e-9, dtype=np.float64)
        return Piece(
            time_s,
            np.asarray(loops.resample(torque_s, torque_nm, torque_period_s, time_s, table, TABLE_PER_UNIT)),
            np.asarray(loops.resample(motion_s[first:], position, period_s, fine_s, table, TABLE_PER_UNIT)),
            np.asarray(loops.resample(motion_s[first:], path, period_s, fine_s, table, TABLE_PER_UNIT)),
            np.round(np.interp(time_s, motion_s[first:], moving(path, self.resolution).astype(float))),
            sent_s,
            np.ascontiguousarray(ticks["command"], dtype=float),
        )

    def _joined(self, name: str) -> Table:
        return np.concatenate([getattr(part, name) for part in self.parts])

    def _forget(self, now_ns: int) -> None:
        oldest_ns = now_ns - WINDOW_S * 1e9
        while len(self.parts) > 1 and (not len(self.parts[0].ticks) or self.parts[0].ticks["tick_ns"][-1] < oldest_ns):
            self.parts.pop(0)

    def _times(self, table: Table, device_ns: npt.NDArray[np.int64] | None) -> FloatArray:
        assert self.origin_ns is not None
        return sampled_at_s(table["arrival_ns"], device_ns, self.origin_ns)


def _own_clock(torque: Table) -> npt.NDArray[np.int64] | None:
    own = torque["device_ns"]
    return own if len(own) and own[0] != NO_DEVICE_TIME else None
