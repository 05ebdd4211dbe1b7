"""Unseen command and unseen motion: nothing measured here is ever fitted."""

from dataclasses import dataclass, field
from typing import ClassVar

from bench.procedures.free import command_multisine
from bench.procedures.imposed import imposed_multisine
from bench.procedures.knowledge import Knowledge, Plan, require_model
from bench.procedures.makers import imposed, zero_torque
from bench.procedures.options import ValidateOptions
from bench.procedures.waves import hold
from bench.procedures.within import Sized, bounds_of, free_within, imposed_within, words_for
from bench.records import Measured
from bench.rig.rig import Rig
from bench.segments import FloatArray, Use

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
        tick_s, rig = known.tick_s, known.rig
        if rig.wiring.load is not None or rig.wiring.shaft == "free":
            command = self._free(known)
            command = free_within(bounds_of(known), command) * command
            yield zero_torque(self.name, "free multisine", Use.VALIDATE, command, rig)
            yield zero_torque(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s), rig)
        if rig.wiring.load is not None:
            sized = self._imposed(known)
            yield imposed(self.name, "imposed multisine", Use.VALIDATE, sized.command, sized.motion)
            yield imposed(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s))

    def spared(self, known: Knowledge) -> tuple[str, ...]:
        free = free_within(bounds_of(known), self._free(known))
        driven = self._imposed(known).share if known.rig.wiring.load is not None else 1.0
        return (
            *words_for(f"{self.name}, free multisine:", free),
            *words_for(f"{self.name}, imposed multisine:", driven),
        )

    def _free(self, known: Knowledge) -> FloatArray:
        return command_multisine(known, known.span(), self.options.duration_s, self.options.seed)

    def _imposed(self, known: Knowledge) -> Sized:
        motion = imposed_multisine(known, IMPOSED_AMPLITUDE, self.options.duration_s, self.options.seed + 1)
        command = command_multisine(known, known.span(), self.options.duration_s, self.options.seed + 2)
        return imposed_within(bounds_of(known), command, motion)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
