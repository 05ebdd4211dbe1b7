"""From where the setpoints are to where they are wanted: one short segment after the other.

Each goes on from the last. They are short, so that a host which is gone leaves the loop with a bench that it holds for
a moment and then idles, as in every session.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.jog.hands import Bounds, LoadDoes, Setpoints
from norton_bench.procedures.imposed import TORQUE_SHARE
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.procedures.waves import UNENDING, ticks_in
from norton_bench.records import Measured
from norton_bench.segments import PRESCRIBED_MOTION, ZERO_TORQUE, LoadMode, Segment, Use

NAME = "jog"
# A key acts with the next segment, and between two segments drives wait for the session: short enough for a hand, long
# enough that the loop hardly ever waits.
SEGMENT_S = 0.2
# From zero to the greatest command, torque or speed at the quickest: slow enough to see and to let go (0.2 s to see it
# and as much for the key: a simple reaction; the rest is margin).
RAMP_S = 1.0
# Of the rig's own rate: on it, rounding makes the guard clip one tick or other.
BELOW = 1 - 1e-6
MODES = {
    LoadDoes.COAST: LoadMode.UNDRIVEN,
    LoadDoes.TORQUE: LoadMode.TORQUE,
    LoadDoes.VELOCITY: LoadMode.ADMITTANCE,
    LoadDoes.ZERO_TORQUE: LoadMode.ADMITTANCE,
}


@dataclass
class Course:
    """``at`` is what was asked for last, tick by tick; ``known`` decides how hard the load may accelerate."""

    bounds: Bounds
    known: Knowledge
    at: Setpoints = field(default_factory=Setpoints)
    elapsed_s: float = field(default=0.0, init=False)
    too_fast: bool = field(default=False, init=False)
    _load_velocity_rad_s: float = field(default=0.0, init=False)

    def towards(self, wanted: Setpoints) -> Segment:
        """The next segment. ``wanted`` must be within bounds; nothing of it is done while the shaft is too fast."""
        wanted, tick_s = wanted.zeroed() if self.too_fast else wanted, self.known.tick_s
        ticks = ticks_in(SEGMENT_S, tick_s)
        if wanted.load is not self.at.load:
            # Whoever takes over an imposed motion takes over the shaft as it turns.
            turning = wanted.load is LoadDoes.VELOCITY
            self.at = replace(self.at, load=wanted.load, load_value=self._load_velocity_rad_s if turning else 0.0)
        segment = Segment(
            NAME,
            wanted.words(self.bounds.command_unit),
            Use.PREPARE,
            approach(self.at.command, wanted.command, self._command_rate_per_s * tick_s, ticks),
            MODES[wanted.load],
            stop_at_velocity_rad_s=UNENDING if self.too_fast else self.bounds.speed_rad_s,
        )
        load = approach(self.at.load_value, wanted.load_value, self._load_rate_per_s * tick_s, ticks)
        if wanted.load is LoadDoes.TORQUE:
            return replace(segment, load_torque_nm=load)
        if wanted.load is LoadDoes.VELOCITY:
            return self._imposed(segment, load)
        return replace(segment, admittance=ZERO_TORQUE)

    def went(self, segment: Segment, measured: Measured) -> None:
        """``segment`` is over: what it came to. A shaft that was too fast is let go of at once."""
        last = measured.ticks[-1]
        self.elapsed_s += len(measured.ticks) * self.known.tick_s
        velocity_rad_s = float(last["load_velocity_rad_s"])
        self._load_velocity_rad_s = velocity_rad_s if np.isfinite(velocity_rad_s) else 0.0
        self.too_fast = bool(abs(last["velocity_rad_s"]) >= self.bounds.speed_rad_s)
        # One that ends early does so for no other reason.
        turns = segment.velocity_rad_s if segment.mode is LoadMode.ADMITTANCE else segment.load_torque_nm
        index = len(measured.ticks) - 1 if self.too_fast else -1
        self.at = replace(
            self.at, command=float(segment.command[index]), load_value=float(turns[index]) if len(turns) else 0.0
        )
        if self.too_fast:
            held = self.at.load_value if self.at.load is LoadDoes.VELOCITY else 0.0
            self.at = replace(self.at, command=0.0, load_value=held)

    def _imposed(self, segment: Segment, velocity_rad_s: FloatArray) -> Segment:
        tick_s = self.known.tick_s
        return replace(
            segment,
            admittance=PRESCRIBED_MOTION,
            position_rad=np.cumsum(velocity_rad_s) * tick_s,
            velocity_rad_s=velocity_rad_s,
            acceleration_rad_s2=np.diff(velocity_rad_s, prepend=self.at.load_value) / tick_s,
        )

    @property
    def _command_rate_per_s(self) -> float:
        return min(self.bounds.greatest_command / RAMP_S, BELOW * self.known.rig.limits.command_rate_per_s)

    @property
    def _load_rate_per_s(self) -> float:
        calibration = self.known.calibration
        if self.at.load is not LoadDoes.VELOCITY or calibration is None:
            return self.bounds.greatest_load(self.at.load) / RAMP_S
        inertia_kgm2 = calibration.inertia_kgm2 + (calibration.actuator_inertia_kgm2 or calibration.inertia_kgm2)
        spare_rad_s2 = TORQUE_SHARE * self.bounds.load_torque_nm / inertia_kgm2
        return min(self.bounds.velocity_rad_s / RAMP_S, spare_rad_s2)


def approach(start: float, goal: float, step: float, ticks: int) -> FloatArray:
    """From ``start`` (not in it) towards ``goal``, at most ``step`` a tick; shape (ticks,). It ends at goal exactly."""
    way = goal - start
    gone = np.minimum(step * np.arange(1, ticks + 1), abs(way))
    return np.where(gone < abs(way), start + np.copysign(gone, way), goal)
