"""The port held still: the Thévenin experiment. Its torque depends on how the shaft came to rest (section IV.D)."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from norton_bench.errors import RigError
from norton_bench.identification.source_map import FAST, FROM_REST
from norton_bench.procedures.excitations import bounds_of, held_within, words_for
from norton_bench.procedures.knowledge import Knowledge, Plan, refuse_servo
from norton_bench.procedures.options import BlockedOptions
from norton_bench.procedures.waves import Motion, coasting, from_velocity, hold, imposed, ramp
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

APPROACH_S = 0.5
STOP_S = 0.1
# Speeds of approach as shares of the velocity limit: slow, but fast enough to slide; and fast, so that all has slid.
APPROACH_SHARES = {"slow": 0.03, "fast": 0.3}
# Each level is reached twice, from either side.
SIDES = (("above", 1.0), ("below", -1.0))


@dataclass(frozen=True)
class BlockedProcedure:
    """Each command level is held while the shaft comes to rest from above and from below, or has never moved.

    A clamped shaft cannot move, so that the levels are stepped through in both directions; ``histories`` are ignored.
    """

    options: BlockedOptions = field(default_factory=BlockedOptions)
    name: ClassVar[str] = "blocked"

    def require(self, rig: Rig) -> None:
        refuse_servo(rig, self.name)
        if rig.wiring.torque_sensor is None:
            raise RigError(
                f"{rig.place}: step 'blocked' needs a torque sensor at the port; add a [torque_sensor] section"
            )
        if rig.wiring.load is None and rig.wiring.shaft != "clamped":
            raise RigError(
                f"{rig.place}: step 'blocked' needs something that holds the shaft; "
                'add a [load] section, or clamp the shaft and say [rig] shaft = "clamped"'
            )

    def duration_s(self, rig: Rig) -> float:
        options = self.options
        if rig.wiring.load is None:
            return 2 * options.levels * options.hold_s
        approached = sum(history in APPROACH_SHARES for history in options.histories)
        still = len(options.histories) - approached
        return options.levels * (
            2 * approached * (APPROACH_S + STOP_S + options.hold_s) + still * (2 * STOP_S + options.hold_s)
        )

    def plan(self, known: Knowledge) -> Plan:
        levels = self._levels(known)[0]
        return self._clamped(known, levels) if known.rig.wiring.load is None else self._driven(known, levels)

    def reductions(self, known: Knowledge) -> tuple[str, ...]:
        return words_for(f"{self.name}: levels", self._levels(known)[1])

    def _levels(self, known: Knowledge) -> tuple[np.ndarray, float]:
        """The commands to hold, and their share of the free command span."""
        fastest = max((APPROACH_SHARES.get(history, 0.0) for history in self.options.histories), default=0.0)
        approach, bounds, share = (
            self._approach(known, fastest * known.rig.limits.velocity_rad_s),
            bounds_of(known),
            1.0,
        )
        for level in known.span():
            command = np.full(len(approach.position_rad), share * level)
            share *= held_within(bounds, command, approach).share
        return share * np.linspace(*known.span(), self.options.levels), share

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known

    def _driven(self, known: Knowledge, levels: np.ndarray) -> Plan:
        for history in self.options.histories:
            if history in APPROACH_SHARES:
                yield from self._approached(known, levels, history)
            else:
                yield from self._from_rest(known, levels)

    def _approached(self, known: Knowledge, levels: np.ndarray, history: str) -> Plan:
        """Every level from both sides, approached at the speed of the history."""
        speed_rad_s = APPROACH_SHARES[history] * known.rig.limits.velocity_rad_s
        how, before = FAST if history == "fast" else "", 0.0
        for level in levels:
            for side, sign in SIDES:
                approach = self._approach(known, sign * speed_rad_s)
                command = hold(level, APPROACH_S + STOP_S, known.tick_s)
                settle = ramp(before, level, STOP_S, known.tick_s)
                command[: len(settle)] = settle
                yield imposed(self.name, f"approach from {side}{how}", Use.IDENTIFY, command, approach)
                yield self._hold(known, f"hold from {side}{how}", level)
                before = level
        yield imposed(self.name, "release", Use.PREPARE, ramp(before, 0.0, STOP_S, known.tick_s))

    def _from_rest(self, known: Knowledge, levels: np.ndarray) -> Plan:
        """Every level from zero, with the shaft held still throughout."""
        for level in levels:
            yield imposed(self.name, "load", Use.IDENTIFY, ramp(0.0, level, STOP_S, known.tick_s))
            yield self._hold(known, FROM_REST, level)
            yield imposed(self.name, "release", Use.PREPARE, ramp(level, 0.0, STOP_S, known.tick_s))

    def _hold(self, known: Knowledge, name: str, level: float) -> Segment:
        return imposed(self.name, name, Use.IDENTIFY, hold(level, self.options.hold_s, known.tick_s))

    def _clamped(self, known: Knowledge, levels: np.ndarray) -> Plan:
        before = 0.0
        for side, sequence in (("below", levels), ("above", levels[::-1])):
            for level in sequence:
                yield coasting(self.name, "load", Use.IDENTIFY, ramp(before, level, STOP_S, known.tick_s))
                yield coasting(
                    self.name, f"hold from {side}", Use.IDENTIFY, hold(level, self.options.hold_s, known.tick_s)
                )
                before = level
        yield coasting(self.name, "release", Use.IDENTIFY, ramp(before, 0.0, STOP_S, known.tick_s))

    def _approach(self, known: Knowledge, speed_rad_s: float) -> Motion:
        tick_s = known.tick_s
        start = ramp(0.0, speed_rad_s, STOP_S, tick_s)
        cruise = hold(speed_rad_s, APPROACH_S - STOP_S, tick_s)
        return from_velocity(np.concatenate([start, cruise, ramp(speed_rad_s, 0.0, STOP_S, tick_s)]), tick_s)
