"""Any step under a modulation π of the actuator's impedance (the paper: ż = Z_state(z, Δx, π), f = Z_output(z, Δx, π)).

The modulator is at zero whenever the drives are enabled; a step without a modulation leaves it there.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.errors import RigError
from norton_bench.procedures.knowledge import Adaptive, Decision, Knowledge, Plan, Procedure, Reducing
from norton_bench.procedures.waves import ramp
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

RAMP_S = 1.0
WAY = "modulate"  # the name of the ramps' segments


@dataclass(frozen=True)
class ModulatedProcedure:
    """A procedure at each of ``modulations``, in the rig's own unit, one after the other; ramps lead there and back."""

    procedure: Procedure
    modulations: tuple[float, ...]

    @property
    def name(self) -> str:
        return self.procedure.name

    def require(self, rig: Rig) -> None:
        require_modulator(rig, self.name, self.modulations)
        self.procedure.require(rig)

    def duration_s(self, rig: Rig) -> float:
        return RAMP_S + len(self.modulations) * (RAMP_S + self.procedure.duration_s(rig))

    def reductions(self, known: Knowledge) -> tuple[str, ...]:
        """Those of the procedure: they are the same for each modulation."""
        return self.procedure.reductions(known) if isinstance(self.procedure, Reducing) else ()

    def plan(self, known: Knowledge) -> Plan:
        before, command = 0.0, 0.0
        for modulation in self.modulations:
            yield self._way(command, before, modulation, known.tick_s)
            command = yield from _held(self.procedure.plan(known), modulation)
            before = modulation
        yield self._way(command, before, 0.0, known.tick_s)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return self.procedure.conclude(known, measured)

    def _way(self, command: float, start: float, stop: float, tick_s: float) -> Segment:
        """From one modulation to the next; the actuator's command goes from where it was to zero."""
        ways = ramp(command, 0.0, RAMP_S, tick_s), ramp(start, stop, RAMP_S, tick_s)
        return Segment(self.name, WAY, Use.PREPARE, ways[0], modulation=ways[1])


@dataclass(frozen=True)
class ModulatedSteps:
    """An adaptive step, with each of its procedures at all of ``modulations``."""

    steps: Adaptive
    modulations: tuple[float, ...]

    @property
    def name(self) -> str:
        return self.steps.name

    def require(self, rig: Rig) -> None:
        require_modulator(rig, self.name, self.modulations)
        self.steps.require(rig)

    def duration_s(self, rig: Rig) -> float:
        return len(self.modulations) * self.steps.duration_s(rig)

    def following(self, known: Knowledge) -> Decision:
        decision = self.steps.following(known)
        if decision.procedure is None:
            return decision
        return replace(decision, procedure=ModulatedProcedure(decision.procedure, self.modulations))


def modulated(action: Procedure | Adaptive, modulations: tuple[float, ...]) -> ModulatedProcedure | ModulatedSteps:
    """The same step under these modulations."""
    if isinstance(action, Adaptive):
        return ModulatedSteps(action, modulations)
    return ModulatedProcedure(action, modulations)


def require_modulator(rig: Rig, name: str, modulations: tuple[float, ...]) -> None:
    """Raises RigError where the rig has no modulator, or where a modulation is outside of its range."""
    if rig.modulation is None:
        raise RigError(
            f"{rig.place}: step '{name}' names a modulation, but no drive sets the actuator's impedance; "
            "add a [modulator] section or leave the modulation out"
        )
    least, greatest = rig.modulation.span
    for modulation in modulations:
        if not least <= modulation <= greatest:
            unit = rig.modulation.unit
            raise RigError(
                f"{rig.place}: step '{name}' asks for a modulation of {modulation:g} {unit}, outside of "
                f"[modulator.command] from {least:g} to {greatest:g} {unit}; ask for another, or widen that"
            )


def _held(plan: Plan, modulation: float) -> Generator[Segment, Measured, float]:
    """Yield the plan's segments under one modulation; returns the last command of the actuator."""
    command, segment = 0.0, next(plan, None)
    while segment is not None:
        measured = yield replace(segment, modulation=np.full(segment.ticks, modulation))
        command = float(measured.ticks["command"][-1])
        try:
            segment = plan.send(measured)
        except StopIteration:
            segment = None
    return command
