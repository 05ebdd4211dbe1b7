"""From readings, each with its own arrival time, to one sample a tick with the age of every signal."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from norton_bench.sample import Sample
from norton_drivers.readings import CurrentReading, MotionReading, TorqueReading


@dataclass
class Alignment:
    """Keeps the newest reading of every stream. An age counts from arrival, never from the tick that saw it."""

    torque_bias_nm: float = 0.0
    _motion: MotionReading | None = field(default=None, init=False)
    _load: MotionReading | None = field(default=None, init=False)
    _torque: TorqueReading | None = field(default=None, init=False)
    _current: CurrentReading | None = field(default=None, init=False)
    _load_current: CurrentReading | None = field(default=None, init=False)
    _modulator: MotionReading | None = field(default=None, init=False)

    def update(
        self,
        tick_ns: int,
        motion: Sequence[MotionReading],
        load: Sequence[MotionReading],
        torque: Sequence[TorqueReading],
        current: Sequence[CurrentReading] = (),
        load_current: Sequence[CurrentReading] = (),
        modulator: Sequence[MotionReading] = (),
    ) -> Sample:
        """The sample at ``tick_ns`` given what arrived since the last one (oldest first)."""
        if motion:
            self._motion = motion[-1]
        if load:
            self._load = load[-1]
        if torque:
            self._torque = torque[-1]
        if current:
            self._current = current[-1]
        if load_current:
            self._load_current = load_current[-1]
        if modulator:
            self._modulator = modulator[-1]
        m, ld, tq, i, il = self._motion, self._load, self._torque, self._current, self._load_current
        md = self._modulator
        nan = float("nan")
        # What arrives while the tick is reading its ports has an age of 0, not a negative one.
        return Sample(
            tick_ns,
            nan if tq is None or not tq.valid else tq.torque_nm - self.torque_bias_nm,
            -1 if tq is None else max(0, tick_ns - tq.arrival_ns),
            bool(torque),
            nan if m is None else m.position_rad,
            nan if m is None else m.velocity_rad_s,
            -1 if m is None else max(0, tick_ns - m.arrival_ns),
            bool(motion),
            nan if ld is None else ld.position_rad,
            nan if ld is None else ld.velocity_rad_s,
            -1 if ld is None else max(0, tick_ns - ld.arrival_ns),
            bool(load),
            nan if i is None else i.current_a,
            -1 if i is None else max(0, tick_ns - i.arrival_ns),
            bool(current),
            nan if il is None else il.current_a,
            -1 if il is None else max(0, tick_ns - il.arrival_ns),
            bool(load_current),
            len(torque),
            len(motion),
            len(load),
            nan if md is None else md.position_rad,
            -1 if md is None else max(0, tick_ns - md.arrival_ns),
        )
