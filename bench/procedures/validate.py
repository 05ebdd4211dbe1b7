"""Unseen command and unseen motion: nothing measured here is ever fitted."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from bench.procedures.free import command_multisine
from bench.procedures.imposed import imposed_multisine
from bench.procedures.knowledge import Knowledge, Plan, require_model
from bench.procedures.makers import imposed, zero_torque
from bench.procedures.options import ValidateOptions
from bench.procedures.waves import hold, ramp, sine_motion, velocity_steps
from bench.records import Measured
from bench.rig.rig import Rig
from bench.segments import Use

REST_S = 0.4
IMPOSED_AMPLITUDE = 0.4
# Motions unlike those that are fitted: other speeds between that grid's, a motion as slow as none there, loops of other
# sizes at another frequency. All are slower, and under lesser commands, than what the experiments have done already.
SLOW_SHARE, SLOW_S = 0.1, 2.0  # of that amplitude
SPEED_SHARES = (0.08, -0.08, 0.6, -0.6)
CHANGE_S, DWELL_S = 0.15, 0.4
COMMAND_SHARES = (0.6, 0.3)  # of the span, from its upper and from its lower end
LOOPS_RAD = (1e-3, 8e-3)
LOOP_HZ, LOOP_CYCLES = 6.0, 5


@dataclass(frozen=True)
class ValidateProcedure:
    """A new multisine on the free actuator, then, with a load drive, new motions unlike each other."""

    options: ValidateOptions = field(default_factory=ValidateOptions)
    name: ClassVar[str] = "validate"

    def require(self, rig: Rig) -> None:
        """Any rig with a model will do: it validates what the rig can show."""
        require_model(rig, self.name)

    def duration_s(self, rig: Rig) -> float:
        free_s = self.options.duration_s + REST_S
        if rig.wiring.load is None:
            return free_s
        slides_s = len(COMMAND_SHARES) * (len(SPEED_SHARES) + 1) * (CHANGE_S + DWELL_S)
        return 2 * free_s + SLOW_S + slides_s + len(LOOPS_RAD) * LOOP_CYCLES / LOOP_HZ

    def plan(self, known: Knowledge) -> Plan:
        seed, tick_s, rig = self.options.seed, known.tick_s, known.rig
        if rig.wiring.load is not None or rig.wiring.shaft == "free":
            command = command_multisine(known, known.span(), self.options.duration_s, seed)
            yield zero_torque(self.name, "free multisine", Use.VALIDATE, command, rig)
            yield zero_torque(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s), rig)
        if rig.wiring.load is not None:
            motion = imposed_multisine(known, IMPOSED_AMPLITUDE, self.options.duration_s, seed + 1)
            command = command_multisine(known, known.span(), self.options.duration_s, seed + 2)
            yield imposed(self.name, "imposed multisine", Use.VALIDATE, command, motion)
            yield from self._unlike(known)
            yield imposed(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s))

    def _unlike(self, known: Knowledge) -> Plan:
        """Slow motion, sliding at other speeds, small loops."""
        tick_s, greatest_rad_s = known.tick_s, IMPOSED_AMPLITUDE * known.rig.limits.velocity_rad_s
        low, high = known.span()
        slow = imposed_multisine(known, IMPOSED_AMPLITUDE, SLOW_S, self.options.seed + 3).scaled(SLOW_SHARE)
        command = SLOW_SHARE * command_multisine(known, known.span(), SLOW_S, self.options.seed + 4)
        yield imposed(self.name, "imposed slowly", Use.VALIDATE, command, slow)
        steps = velocity_steps(greatest_rad_s * np.array(SPEED_SHARES), CHANGE_S, DWELL_S, tick_s)
        ticks = len(steps.velocity_rad_s)
        for level in (COMMAND_SHARES[0] * high, COMMAND_SHARES[1] * low):
            command, rise = np.full(ticks, level), ramp(0.0, level, CHANGE_S, tick_s)
            command[: len(rise)], command[-len(rise) :] = rise, rise[::-1]
            yield imposed(self.name, f"imposed speeds {level:+.3g}", Use.VALIDATE, command, steps)
        for amplitude_rad in LOOPS_RAD:
            loop = sine_motion(amplitude_rad, LOOP_HZ, LOOP_CYCLES, tick_s)
            still = np.zeros(len(loop.position_rad))
            yield imposed(self.name, f"imposed loop {amplitude_rad * 1e3:g} mrad", Use.VALIDATE, still, loop)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
