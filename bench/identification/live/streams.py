"""Streams as they come in, part by part: instants recovered on the way, then everything on one grid, a little late."""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from bench.identification import noise
from bench.identification.live.sanity import sound
from bench.identification.quantisation import moving, resolution_rad, unquantised
from bench.identification.signals import FINE, LONGEST_GAP_S, Port, Stream, stream_of
from bench.records import Measured, Table, stacked

FloatArray = npt.NDArray[np.float64]

# Clocks are followed over this long a window.
WINDOW_S = 1.5
# The grid ends this much before the newest reading: the reach of interpolation, and room for smoothing to settle.
MARGIN_S = 0.12
FIRST_AFTER_S = 0.4
# Parts are digested together until they make up this much: every piece costs the same, however short.
PIECE_S = 0.5
# Another estimate of the encoder's step replaces the one before only where it is clearly smaller.
SMALLER_STEP = 0.7
# Readings that are so many times noisier than their counts are noisy for another reason: they were taken at instants
# that nobody knows, for instance when a command came.
NOISIER_THAN_COUNTS = 2.0


@dataclass(frozen=True)
class Piece:
    """A stretch of the grid that follows the one before without a gap; shapes as in Signals."""

    time_s: FloatArray
    torque_nm: FloatArray
    position_rad: FloatArray
    path_rad: FloatArray
    moving: FloatArray  # 1 where readings are there and the counts tell what friction holds, else 0
    sent_s: FloatArray
    command: FloatArray
    count_variance_rad2: float  # of the positions' errors, as one reading a tick would have it
    released_at_zero: bool = False  # the drive: as in records.Chain


@dataclass
class LiveStreams:
    """Collects parts and hands out pieces."""

    tick_s: float
    origin_ns: int | None = None
    parts: list[Measured] = field(default_factory=list)
    resolution: float = 0.0
    _waiting_ticks: int = field(default=0, init=False)
    _next_s: float = field(default=float("-inf"), init=False)

    def add(self, part: Measured) -> Piece | None:
        """The grid as far as it can be known now; None where nothing new can be."""
        part = sound(part)
        if self._went_back(part):
            self.parts, self._next_s = [], float("-inf")
        self.parts.append(part)
        self._waiting_ticks += len(part.ticks)
        if self._waiting_ticks * self.tick_s < PIECE_S:
            return None
        self._waiting_ticks = 0
        motion, torque, ticks = (self._joined(name) for name in ("motion", "torque", "ticks"))
        if not len(motion) or not len(torque) or not len(ticks):
            return None
        if self.origin_ns is None:
            self.origin_ns = int(ticks["tick_ns"][0])
        self._forget(int(ticks["tick_ns"][-1]))
        position, port = (
            stream_of(table, column, self.origin_ns)
            for table, column in ((motion, "position_rad"), (torque, "torque_nm"))
        )
        sent_ns = ticks["tick_ns"] + ticks["lateness_ns"] + ticks["work_ns"] - self.origin_ns
        sent_s = np.asarray(sent_ns * 1e-9, dtype=np.float64)
        start_s, end_s = self._span(position.time_s, port.time_s, sent_s)
        count = int((end_s - start_s) / self.tick_s)
        if count <= 0 or (start_s > self._next_s and end_s - start_s < FIRST_AFTER_S):
            return None
        self._next_s = start_s + count * self.tick_s
        command = np.ascontiguousarray(ticks["command"], dtype=float)
        return self._piece(start_s, count, position, port, sent_s, command)

    def _went_back(self, part: Measured) -> bool:
        """Whether the clock was set back: what came before is then of another time."""
        before = next((each.ticks["tick_ns"][-1] for each in reversed(self.parts) if len(each.ticks)), None)
        return before is not None and len(part.ticks) > 0 and bool(part.ticks["tick_ns"][0] <= before)

    def _span(self, *runs: FloatArray) -> tuple[float, float]:
        """The next stretch without a silence in any of ``runs``, beginning where the last one ended if it can."""
        start_s = max(self._next_s, *(float(times[0]) + MARGIN_S for times in runs))
        end_s = min(float(times[-1]) - MARGIN_S for times in runs)
        for times in runs:
            for before in np.flatnonzero(np.diff(times) > LONGEST_GAP_S):
                silent_s, back_s = float(times[before]) - MARGIN_S, float(times[before + 1]) + MARGIN_S
                if start_s + self.tick_s <= silent_s:
                    end_s = min(end_s, silent_s)
                elif start_s < back_s:
                    start_s = back_s
        return start_s, end_s

    def _piece(
        self, start_s: float, count: int, position: Stream, port: Stream, sent_s: FloatArray, command: FloatArray
    ) -> Piece:
        time_s = np.asarray(start_s + np.arange(count) * self.tick_s, dtype=np.float64)
        fine_s = np.asarray(start_s + np.arange(count * FINE) * (self.tick_s / FINE), dtype=np.float64)
        self._look_at_counts(position.value)
        # Only what is new, and what its smoothing reaches back to.
        position = position.between(time_s[0] - 2 * MARGIN_S, np.inf)
        smooth = unquantised(position.value, self.resolution)
        path = replace(position, value=smooth)
        moving_then = moving(smooth, self.resolution)
        moves = np.interp(time_s, path.time_s, moving_then.astype(float)) > 0.5
        known = moves & position.covers(time_s) & port.covers(time_s)
        torque_nm = port.at(time_s)
        variance = self._variance_rad2(position.value, moving_then) * position.period_s / self.tick_s
        position_rad, path_rad = position.at(fine_s), path.at(fine_s)
        released = Port.ACTUATOR.value in self.parts[-1].chain.released_at_zero
        return Piece(
            time_s, torque_nm, position_rad, path_rad, known.astype(float), sent_s, command, variance, released
        )

    def _variance_rad2(self, position_rad: FloatArray, moving_then: npt.NDArray[np.bool_]) -> float:
        """Of the readings' own errors."""
        of_counts = self.resolution**2 / 12.0
        measured = noise.deviation(position_rad, moving_then) ** 2
        return measured if measured > NOISIER_THAN_COUNTS * of_counts else of_counts

    def _look_at_counts(self, position_rad: FloatArray) -> None:
        """The smallest step ever seen is the count: a constant speed makes all steps alike, and larger."""
        step = resolution_rad(position_rad)
        if step > 0.0 and (self.resolution == 0.0 or step < SMALLER_STEP * self.resolution):
            self.resolution = step

    def _joined(self, name: str) -> Table:
        return stacked([getattr(part, name) for part in self.parts])

    def _forget(self, now_ns: int) -> None:
        oldest_ns = now_ns - WINDOW_S * 1e9
        while len(self.parts) > 1 and (not len(self.parts[0].ticks) or self.parts[0].ticks["tick_ns"][-1] < oldest_ns):
            self.parts.pop(0)
