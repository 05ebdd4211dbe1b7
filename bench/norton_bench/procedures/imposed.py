"""Prescribed motion: measures the impedance, by moving the port off the motion of the source (section IV.B.1)."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import ClassVar

import numpy as np

from norton_bench.control.design import design_tracking
from norton_bench.errors import RigError
from norton_bench.procedures.excitations import Sized, bounds_of, imposed_multisine, imposed_within, words_for
from norton_bench.procedures.free import command_multisine
from norton_bench.procedures.knowledge import VELOCITY_SHARE, Knowledge, Plan, require_load
from norton_bench.procedures.options import ImposedOptions
from norton_bench.procedures.plans_of_servos import LIMIT_STRETCH, SHAKEN, plans_for
from norton_bench.procedures.waves import (
    hold,
    imposed,
    pushed,
    ramp,
    sine_motion,
    velocity_steps,
)
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

CHANGE_S = 0.15
DWELL_S = 0.35
REST_S = 0.3
LOOP_HZ = 4.0
LOOP_CYCLES = 4
LOOP_AMPLITUDES_RAD = (0.5e-3, 1.5e-3, 5e-3, 15e-3, 50e-3)
SHAKEN_SEED = 31


@dataclass(frozen=True)
class ImposedProcedure:
    """A grid of velocities and commands, presliding loops, and a multisine motion under a multisine command."""

    options: ImposedOptions = field(default_factory=ImposedOptions)
    name: ClassVar[str] = "imposed"

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "to impose motion")
        asked_rad_s = max((abs(each) for each in self.options.velocities_rad_s), default=0.0)
        if asked_rad_s > VELOCITY_SHARE * rig.limits.velocity_rad_s:
            raise RigError(
                f"{rig.place}: step 'imposed' asks for {asked_rad_s:g} rad/s, but [limits] velocity = "
                f"{rig.limits.velocity_rad_s:g} rad/s leaves room for {VELOCITY_SHARE:.0%} of itself; "
                "lower `velocities` in the session or raise the limit"
            )

    def duration_s(self, rig: Rig) -> float:
        if (servo := plans_for(rig)) is not None:
            return servo.imposed_s(self.options.duration_s) + len(LOOP_AMPLITUDES_RAD) * LOOP_CYCLES / LOOP_HZ + REST_S
        grid = self.options.commands * (len(self.velocities_rad_s(rig)) + 1) * (CHANGE_S + DWELL_S)
        loops = len(LOOP_AMPLITUDES_RAD) * LOOP_CYCLES / LOOP_HZ
        return grid + loops + self.options.duration_s + REST_S

    def velocities_rad_s(self, rig: Rig) -> np.ndarray:
        """The velocities of the grid, in an order that moves the shaft back and forth."""
        if self.options.velocities_rad_s:
            return np.array(self.options.velocities_rad_s)
        greatest = self.options.amplitude * rig.limits.velocity_rad_s
        return greatest * np.array([0.1, -0.1, 0.4, -0.4, 1.0, -1.0])

    def plan(self, known: Knowledge) -> Plan:
        for name, sized in self._stretches(known):
            yield imposed(self.name, name, Use.IDENTIFY, sized.command, sized.motion)
        if (servo := plans_for(known.rig)) is not None:
            for shake in servo.shakes(known, self.options.duration_s, SHAKEN_SEED):
                yield pushed(self.name, SHAKEN, Use.IDENTIFY, shake.load_nm, shake.command)
            if (limit := servo.limit(known)) is not None:
                yield imposed(self.name, LIMIT_STRETCH, Use.IDENTIFY, *limit)
        yield imposed(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, known.tick_s))

    def reductions(self, known: Knowledge) -> tuple[str, ...]:
        shares = [(name, sized.share) for name, sized in self._stretches(known)]
        if (servo := plans_for(known.rig)) is not None:
            shares.append(servo.shaken_share(known, self.options.duration_s, SHAKEN_SEED))
        smaller = (words_for(f"{self.name}, {name}:", share) for name, share in shares)
        return (*_gentler(known), *chain.from_iterable(smaller))

    def _stretches(self, known: Knowledge) -> Iterator[tuple[str, Sized]]:
        """The commands and motions to impose, in order, each with its name."""
        if (servo := plans_for(known.rig)) is not None:
            loops = tuple((amplitude_rad, LOOP_HZ, LOOP_CYCLES) for amplitude_rad in LOOP_AMPLITUDES_RAD)
            yield from servo.stretches(known, self.options.duration_s, 3, loops)
            return
        tick_s, bounds = known.tick_s, bounds_of(known)
        low, high = known.span()
        steps = velocity_steps(self.velocities_rad_s(known.rig), CHANGE_S, DWELL_S, tick_s)
        ticks = len(steps.velocity_rad_s)
        for level in np.linspace(low, high, self.options.commands):
            command = np.full(ticks, level)
            rise = ramp(0.0, level, CHANGE_S, tick_s)
            command[: len(rise)], command[-len(rise) :] = rise, rise[::-1]
            yield f"grid {level:+.3g}", imposed_within(bounds, command, steps)
        for amplitude_rad in LOOP_AMPLITUDES_RAD:
            loop = sine_motion(amplitude_rad, LOOP_HZ, LOOP_CYCLES, tick_s)
            still = np.zeros(len(loop.position_rad))
            yield f"loop {amplitude_rad * 1e3:g} mrad", imposed_within(bounds, still, loop)
        motion = imposed_multisine(known, self.options.amplitude, self.options.duration_s, seed=3)
        command = command_multisine(known, (low, high), self.options.duration_s, seed=4)
        yield "multisine", imposed_within(bounds, command, motion)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known


def _gentler(known: Knowledge) -> tuple[str, ...]:
    """A sentence where the gains of the load are lower than usual, and the cost of that; else none."""
    gentler = 1.0 if known.calibration is None else design_tracking(known.calibration, known.tick_s).gentler
    if gentler == 1.0:
        return ()
    return (
        f"imposed: the load follows with gains {gentler:.0f} times gentler than usual, the boldest that are stable on "
        "this bench: the actuator's command moves the shaft off its motion by so much more, and it moves less as "
        "planned; finer counts, or less delay from command to torque, would mend that",
    )
