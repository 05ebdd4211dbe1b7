"""A virtual body at the port: the load acts a mass, a damper and a spring while the actuator pushes."""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from norton_bench.control.rendering import require_rendered
from norton_bench.errors import ExperimentError
from norton_bench.identification.rendered import name_of
from norton_bench.procedures.excitations import bounds_of, free_within
from norton_bench.procedures.free import FASTEST_SHARE, command_multisine
from norton_bench.procedures.knowledge import Knowledge, Plan, refuse_servo, require_load
from norton_bench.procedures.options import RenderOptions
from norton_bench.procedures.waves import hold
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import RENDER, LoadMode, Segment, Use

REST_S = 0.4
SEED = 6


@dataclass(frozen=True)
class RenderProcedure:
    """Takes the law over where the shaft stands, and moves the actuator by a multisine command.

    A law that the bench cannot render is refused before anything moves, with the nearest that it can.
    """

    options: RenderOptions = field(default_factory=RenderOptions)
    name: ClassVar[str] = RENDER

    def require(self, rig: Rig) -> None:
        refuse_servo(rig, self.name)
        require_load(rig, self.name, "to act the virtual body")

    def duration_s(self, rig: Rig) -> float:
        return self.options.duration_s + 2 * REST_S

    def reductions(self, known: Knowledge) -> tuple[str, ...]:
        """What the certificate of the law says. Raises ExperimentError where there is none."""
        if not self.options.law.has_body:
            return ()
        if known.calibration is None:
            raise ExperimentError("render: needs a calibrated load drive; run the step 'calibrate' before it")
        return (f"render: {require_rendered(known.calibration, known.tick_s, self.options.law).words}",)

    def plan(self, known: Knowledge) -> Plan:
        options, tick_s = self.options, known.tick_s
        rest = hold(0.0, REST_S, tick_s)
        wave = options.amplitude * command_multisine(known, known.span(), options.duration_s, SEED, options.highest_hz)
        command = free_within(bounds_of(known), wave) * wave
        yield Segment(
            self.name,
            name_of(self.options.law),
            Use.PREPARE,  # most of it is within the presliding length: fits want motion that was chosen for them
            np.concatenate([rest, command, rest]),
            LoadMode.ADMITTANCE,
            self.options.law,
            stop_at_velocity_rad_s=FASTEST_SHARE * known.rig.limits.velocity_rad_s,
        )

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
