"""Unseen command and unseen motion: nothing measured here is ever fitted."""

from dataclasses import dataclass, field
from typing import ClassVar

from bench.procedures.free import command_multisine
from bench.procedures.imposed import imposed_multisine
from bench.procedures.knowledge import Knowledge, Plan, require_model
from bench.procedures.makers import imposed, zero_torque
from bench.procedures.options import ValidateOptions
from bench.procedures.waves import hold
from bench.records import Measured
from bench.rig.rig import Rig
from bench.segments import Use

REST_S = 0.4
IMPOSED_AMPLITUDE = 0.4


@dataclass(frozen=True)
class ValidateProcedure:
    """A new multisine on the free actuator, then, with a load drive, a new motion under a new command."""

    options: ValidateOptions = field(default_factory=ValidateOptions)
    name: ClassVar[str] = "validate"

    def require(self, rig: Rig) -> None:
        """Any rig with a model will do: it validates what the rig can show."""
        require_model(rig, self.name)

    def duration_s(self, rig: Rig) -> float:
        parts = 1 if rig.wiring.load is None else 2
        return parts * (self.options.duration_s + REST_S)

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
            yield imposed(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s))

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
