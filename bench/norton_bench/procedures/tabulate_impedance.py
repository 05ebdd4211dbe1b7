"""The impedance of any actuator: the torque of the port when it is moved off its source (paper, section IV.B.1)."""

from collections.abc import Generator
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.exertion_table import SHAKE, SWEEP, shake_lines
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.options import TabulateImpedanceOptions
from norton_bench.procedures.tabulate_source import MOVE_S, Patience, at_zero_torque, levels_between, settle
from norton_bench.procedures.waves import EDGE_S, Motion, displaced, hold, imposed, ramp, sines_motion, sweep, ticks_in
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import HOLD, READ, TABULATE_IMPEDANCE, Segment, Use

STEP_S = 0.2
SHAKE_S = 2.6
READ_S = 0.5
# The port is moved no further at this share of the torque that rig and load allow.
TORQUE_SHARE = 0.5

# One position where the port is held: yields its segments, returns the measured torque [N m].
Place = Generator[Segment, Measured, float]
# All positions: yields their segments, returns the lowest and the highest, in steps from the source.
Around = Generator[Segment, Measured, tuple[int, int]]


@dataclass(frozen=True)
class TabulateImpedanceProcedure:
    """At each command: the source first, then the port held at positions on either side of it.

    At the source and at both ends the port is also shaken a little.

    The port moves down from the source, up through all positions, and down to the source again, so that each position
    but the outermost is reached from both sides. Then it moves along the same way once more, slowly and without stops.
    """

    options: TabulateImpedanceOptions = field(default_factory=TabulateImpedanceOptions)
    name: ClassVar[str] = TABULATE_IMPEDANCE

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "to move the port")

    def duration_s(self, rig: Rig) -> float:
        options = self.options
        holds = 4 * options.steps * (STEP_S + options.hold_s)
        shakes = 3 * SHAKE_S if options.shake_rad else 0.0
        source_s = MOVE_S + 0.5 * options.at_most_s + READ_S
        sweeps = 6 * options.displacement_rad / options.sweep_rad_s + 4 * EDGE_S if options.sweep_rad_s else 0.0
        return options.commands * (source_s + holds + shakes + sweeps) + MOVE_S

    def plan(self, known: Knowledge) -> Plan:
        options, before = self.options, 0.0
        make = partial(at_zero_torque, self.name, known.rig)
        patience = Patience(options.settled_rad_s, options.at_most_s)
        for level in levels_between(known.rig, options.lowest, options.highest, options.commands):
            yield from settle(make, known, before, level, patience)
            yield make(READ, Use.IDENTIFY, hold(level, READ_S, known.tick_s))
            ends = yield from self._around(known, level)
            yield from self._swept(known, level, ends)
            before = level
        yield make("leave", Use.PREPARE, ramp(before, 0.0, MOVE_S, known.tick_s))

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known

    def _around(self, known: Knowledge, level: float) -> Around:
        """Down from the source, up through all places, and down to the source again."""
        bound_nm = TORQUE_SHARE * min(known.rig.limits.torque_nm, known.rig.limits.load_torque_nm)
        here, steps, places = 0, self.options.steps, [0]
        for end, side in ((-steps, "falling"), (steps, "rising"), (0, "falling")):
            way = 1 if end > here else -1
            while here != end:
                here += way
                places.append(here)
                torque_nm = yield from self._place(known, level, way, side)
                too_much = here * way > 0 and abs(torque_nm) > bound_nm
                if too_much or (here in (0, end) and side == "rising") or here == -steps:
                    yield from self._shaken(known, level)
                if too_much:
                    break
        return min(places), max(places)

    def _swept(self, known: Knowledge, level: float, ends: tuple[int, int]) -> Plan:
        """Slowly to the lowest position that was held, to the highest, back to the lowest, and to the source."""
        speed_rad_s, step_rad = self.options.sweep_rad_s, self.options.displacement_rad / self.options.steps
        if speed_rad_s == 0.0:
            return
        low, high = (end * step_rad for end in ends)
        ways = (
            ("step", Use.PREPARE, low),
            (f"{SWEEP} rising", Use.IDENTIFY, high - low),
            (f"{SWEEP} falling", Use.IDENTIFY, low - high),
            ("step", Use.PREPARE, -low),
        )
        for name, use, distance_rad in ways:
            yield self._held(level, name, use, sweep(distance_rad, speed_rad_s, known.tick_s))

    def _place(self, known: Knowledge, level: float, way: int, side: str) -> Place:
        options, tick_s = self.options, known.tick_s
        step = displaced(way * options.displacement_rad / options.steps, STEP_S, tick_s)
        yield self._held(level, "step", Use.PREPARE, step)
        still = np.zeros(ticks_in(options.hold_s, tick_s))
        measured = yield self._held(level, f"{HOLD} {side}", Use.IDENTIFY, Motion(still, still, still))
        return float(np.mean(measured.ticks["torque_nm"]))

    def _shaken(self, known: Knowledge, level: float) -> Plan:
        if self.options.shake_rad > 0:
            frequency_hz, amplitude = shake_lines(known.tick_s)
            shake = sines_motion(frequency_hz, self.options.shake_rad * amplitude, SHAKE_S, known.tick_s)
            yield self._held(level, SHAKE, Use.IDENTIFY, shake)

    def _held(self, level: float, name: str, use: Use, motion: Motion) -> Segment:
        command: FloatArray = np.full(len(motion.position_rad), level)
        return imposed(self.name, name, use, command, motion)
