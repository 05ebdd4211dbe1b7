"""A virtual body at the port: the load acts a mass, a damper and a spring while the actuator pushes."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.rendering import require_change, require_rendered
from norton_bench.errors import ExperimentError
from norton_bench.identification.rendered import name_of
from norton_bench.procedures.excitations import bounds_of, free_within
from norton_bench.procedures.free import FASTEST_SHARE, command_multisine
from norton_bench.procedures.knowledge import Knowledge, Plan, refuse_servo, require_load
from norton_bench.procedures.options import RenderOptions
from norton_bench.procedures.waves import hold
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import GLIDE_S, RENDER, Admittance, LoadMode, Segment, Use

REST_S = 0.4
SEED = 6


@dataclass(frozen=True)
class RenderProcedure:
    """Takes the first law over where the shaft stands, and moves the actuator by a multisine command.

    From one body to the next, the shaft is not let go of, and the law changes while nothing pushes. Laws that the bench
    cannot render are refused before anything moves, with the nearest that it can.
    """

    options: RenderOptions = field(default_factory=RenderOptions)
    name: ClassVar[str] = RENDER

    def require(self, rig: Rig) -> None:
        refuse_servo(rig, self.name)
        require_load(rig, self.name, "to act the virtual body")

    def duration_s(self, rig: Rig) -> float:
        return sum(each.duration_s + 2 * REST_S for each in self.options.laws) + GLIDE_S * len(self.options.then)

    def reductions(self, known: Knowledge) -> tuple[str, ...]:
        """What the certificates of the laws say. Raises ExperimentError where there is none."""
        laws = [each.law for each in self.options.laws]
        if not any(law.has_body for law in laws):
            return ()
        if known.calibration is None:
            raise ExperimentError("render: needs a calibrated load drive; run the step 'calibrate' before it")
        calibration, tick_s = known.calibration, known.tick_s
        certificates = [require_rendered(calibration, tick_s, law).words for law in laws if law.has_body]
        for before, after in pairwise(laws):
            require_change(calibration, tick_s, before, after)
        return tuple(f"render: {words}" for words in certificates)

    def plan(self, known: Knowledge) -> Plan:
        for segment in self._segments(known):
            measured = yield segment
            turns_rad_s = np.abs(measured.ticks["velocity_rad_s"][-1:])
            if np.any(turns_rad_s >= segment.stop_at_velocity_rad_s):
                return

    def _segments(self, known: Knowledge) -> list[Segment]:
        """All of them beforehand: while the load acts one law, there is no time to compute the next."""
        segments = list[Segment]()
        for each in self.options.laws:
            if segments:
                segments.append(self._segment(known, "change", each.law, hold(0.0, GLIDE_S, known.tick_s)))
            command = self._command(known, each.duration_s)
            segments.append(self._segment(known, name_of(each.law), each.law, command))
        return segments

    def _command(self, known: Knowledge, duration_s: float) -> FloatArray:
        """Of the actuator, (ticks,)."""
        options, rest = self.options, hold(0.0, REST_S, known.tick_s)
        wave = options.amplitude * command_multisine(known, known.span(), duration_s, SEED, options.highest_hz)
        return np.concatenate([rest, free_within(bounds_of(known), wave) * wave, rest])

    def _segment(self, known: Knowledge, name: str, law: Admittance, command: FloatArray) -> Segment:
        return Segment(
            self.name,
            name,
            Use.PREPARE,  # most of it is within the presliding length: fits want motion that was chosen for them
            command,
            LoadMode.ADMITTANCE,
            law,
            stop_at_velocity_rad_s=FASTEST_SHARE * known.rig.limits.velocity_rad_s,
        )

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
