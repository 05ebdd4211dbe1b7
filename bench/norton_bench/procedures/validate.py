"""A command and motions for validation: nothing measured here is fitted."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.procedures.excitations import (
    Sized,
    bounds_of,
    free_within,
    imposed_multisine,
    imposed_within,
    words_for,
)
from norton_bench.procedures.free import command_multisine
from norton_bench.procedures.knowledge import Knowledge, Plan, require_model
from norton_bench.procedures.options import ValidateOptions
from norton_bench.procedures.plans_of_servos import SHAKEN, plans_for
from norton_bench.procedures.servo_plans import free_goal
from norton_bench.procedures.waves import hold, imposed, pushed, ramp, sine_motion, velocity_steps, zero_torque
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

REST_S = 0.4
IMPOSED_AMPLITUDE = 0.4
# Motions unlike those that are fitted: speeds between those of the grid, a slower motion, loops of other sizes at
# another frequency. All are slower, and have smaller commands, than those of the experiments before.
SLOW_SHARE, SLOW_S = 0.1, 2.0  # of that amplitude
SHAKEN_SEED = 51
SPEED_SHARES = (0.08, -0.08, 0.6, -0.6)
CHANGE_S, DWELL_S = 0.15, 0.4
COMMAND_SHARES = (0.6, 0.3)  # of the span, from its upper and from its lower end
LOOPS_RAD = (1e-3, 8e-3)
LOOP_HZ, LOOP_CYCLES = 6.0, 5


@dataclass(frozen=True)
class ValidateProcedure:
    """A new multisine on the free actuator; then, with a load drive, several new motions."""

    options: ValidateOptions = field(default_factory=ValidateOptions)
    name: ClassVar[str] = "validate"

    def require(self, rig: Rig) -> None:
        """Possible on any rig with a model; it validates what the rig can measure."""
        require_model(rig, self.name)

    def duration_s(self, rig: Rig) -> float:
        free_s = self.options.duration_s + REST_S
        if rig.wiring.load is None:
            return free_s
        if (servo := plans_for(rig)) is not None:
            return free_s + servo.imposed_s(self.options.duration_s) + len(LOOPS_RAD) * LOOP_CYCLES / LOOP_HZ
        slides_s = len(COMMAND_SHARES) * (len(SPEED_SHARES) + 1) * (CHANGE_S + DWELL_S)
        return 2 * free_s + SLOW_S + slides_s + len(LOOPS_RAD) * LOOP_CYCLES / LOOP_HZ

    def plan(self, known: Knowledge) -> Plan:
        tick_s, rig = known.tick_s, known.rig
        if rig.wiring.load is not None or rig.wiring.shaft == "free":
            command = self._free(known)
            command = free_within(bounds_of(known), command) * command
            yield zero_torque(self.name, "free multisine", Use.VALIDATE, command, rig)
            yield zero_torque(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s), rig)
        if rig.wiring.load is not None:
            for name, sized in self._driven(known):
                yield imposed(self.name, name, Use.VALIDATE, sized.command, sized.motion)
            if (servo := plans_for(rig)) is not None:
                for shake in servo.shakes(known, self.options.duration_s, SHAKEN_SEED):
                    yield pushed(self.name, SHAKEN, Use.VALIDATE, shake.load_nm, shake.command)
            yield imposed(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s))

    def reductions(self, known: Knowledge) -> tuple[str, ...]:
        shares = [("free multisine", free_within(bounds_of(known), self._free(known)))]
        if known.rig.wiring.load is not None:
            shares += [(name, sized.share) for name, sized in self._driven(known)]
            if (servo := plans_for(known.rig)) is not None:
                shares.append(servo.shaken_share(known, self.options.duration_s, SHAKEN_SEED))
        return tuple(sentence for name, share in shares for sentence in words_for(f"{self.name}, {name}:", share))

    def _free(self, known: Knowledge) -> FloatArray:
        if known.rig.holds_position:
            return free_goal(known, self.options.duration_s, self.options.seed)
        return command_multisine(known, known.span(), self.options.duration_s, self.options.seed)

    def _driven(self, known: Knowledge) -> Iterator[tuple[str, Sized]]:
        """A multisine, slow motion, sliding at other speeds, small loops, each with its name."""
        if (servo := plans_for(known.rig)) is not None:
            loops = tuple((amplitude_rad, LOOP_HZ, LOOP_CYCLES) for amplitude_rad in LOOPS_RAD)
            for name, sized in servo.stretches(known, self.options.duration_s, self.options.seed + 1, loops):
                yield f"imposed {name}", sized
            return
        seed, tick_s, bounds = self.options.seed, known.tick_s, bounds_of(known)
        low, high = known.span()
        motion = imposed_multisine(known, IMPOSED_AMPLITUDE, self.options.duration_s, seed + 1)
        command = command_multisine(known, known.span(), self.options.duration_s, seed + 2)
        yield "imposed multisine", imposed_within(bounds, command, motion)
        slow = imposed_multisine(known, IMPOSED_AMPLITUDE, SLOW_S, seed + 3).scaled(SLOW_SHARE)
        command = SLOW_SHARE * command_multisine(known, known.span(), SLOW_S, seed + 4)
        yield "imposed slowly", imposed_within(bounds, command, slow)
        greatest_rad_s = IMPOSED_AMPLITUDE * known.rig.limits.velocity_rad_s
        steps = velocity_steps(greatest_rad_s * np.array(SPEED_SHARES), CHANGE_S, DWELL_S, tick_s)
        for level in (COMMAND_SHARES[0] * high, COMMAND_SHARES[1] * low):
            command, rise = np.full(len(steps.velocity_rad_s), level), ramp(0.0, level, CHANGE_S, tick_s)
            command[: len(rise)], command[-len(rise) :] = rise, rise[::-1]
            yield f"imposed speeds {level:+.3g}", imposed_within(bounds, command, steps)
        for amplitude_rad in LOOPS_RAD:
            loop = sine_motion(amplitude_rad, LOOP_HZ, LOOP_CYCLES, tick_s)
            still = np.zeros(len(loop.position_rad))
            yield f"imposed loop {amplitude_rad * 1e3:g} mrad", imposed_within(bounds, still, loop)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
