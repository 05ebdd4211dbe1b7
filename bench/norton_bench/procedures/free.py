"""Zero torque: the free motion is the motion source itself (paper, section IV.B.1)."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError, RigError
from norton_bench.procedures.excitations import bounds_of, free_within
from norton_bench.procedures.knowledge import Knowledge, Plan
from norton_bench.procedures.options import FreeOptions
from norton_bench.procedures.servo_plans import free_goals, goal_span, servo_free_s
from norton_bench.procedures.tare import turned
from norton_bench.procedures.waves import growth, highest_hz, hold, multisine, ramp, staircase, zero_torque
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

TOO_FAST = "too fast"  # the rest after stairs that were
SEARCH_S = 6.0
REST_S = 0.4
MOVE_S = 0.4
# A multisine's command may peak here, as a share of the span found: the source is monotonic, so velocity stays inside.
MULTISINE_SHARE = 0.95
# A staircase ends where the shaft reaches this share of the velocity limit. Planned are 80 % at most, and what it gains
# until a command of zero acts, some 10 ms later, is a few per cent.
FASTEST_SHARE = 0.9
# It is then tried again, slower. Each try leaves two thirds of the command beyond friction, or less.
TRIES = 8


@dataclass(frozen=True)
class FreeProcedure:
    """A search for the span of commands, then a slow staircase from both sides, then a multisine.

    With a load drive the admittance law imposes zero torque; without one the shaft must be free.
    """

    options: FreeOptions = field(default_factory=FreeOptions)
    name: ClassVar[str] = "free"

    def require(self, rig: Rig) -> None:
        if rig.wiring.load is None and rig.wiring.shaft != "free":
            raise RigError(
                f"{rig.place}: step 'free' needs a shaft that can turn; [rig] shaft is \"{rig.wiring.shaft}\""
            )
        if rig.wiring.load is not None and rig.wiring.torque_sensor is None:
            raise RigError(
                f"{rig.place}: step 'free' needs a torque sensor to hold at zero; add a [torque_sensor] section"
            )

    def duration_s(self, rig: Rig) -> float:
        if rig.holds_position:
            options = self.options
            return servo_free_s(options.levels, options.dwell_s, options.duration_s) + REST_S
        stairs = 2 * self.options.levels * self.options.dwell_s
        return 2 * (SEARCH_S + REST_S) + stairs + 2 * MOVE_S + self.options.duration_s + REST_S

    def plan(self, known: Knowledge) -> Plan:
        return self._servo_plan(known) if known.rig.holds_position else self._plan(known)

    def _servo_plan(self, known: Knowledge) -> Plan:
        options, rig = self.options, known.rig
        for name, goals in free_goals(known, options.levels, options.dwell_s, options.duration_s):
            yield zero_torque(self.name, name, Use.IDENTIFY, goals, rig)
        yield zero_torque(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, known.tick_s), rig)

    def _plan(self, known: Knowledge) -> Plan:
        rig, tick_s = known.rig, known.tick_s
        wanted_rad_s = self.options.amplitude * rig.limits.velocity_rad_s
        ends = []
        for side in (-1.0, 1.0):
            search = growth(side * rig.command.limit, SEARCH_S, tick_s)
            measured = yield zero_torque(
                self.name, "search", Use.IDENTIFY, search, rig, stop_at_velocity_rad_s=wanted_rad_s
            )
            ends.append(float(measured.ticks["command"][-1]))
            yield self._rest(rig, "rest", ends[-1])
        low, high = self._span_within(known, ends)
        for _ in range(TRIES):
            climbed = yield from self._climb(rig, low, high)
            if climbed:
                break
            low, high = self._slower(known, low), self._slower(known, high)
        command = command_multisine(known, (low, high), self.options.duration_s, 1)
        command = free_within(bounds_of(known), command) * command
        yield zero_torque(self.name, "multisine", Use.IDENTIFY, command, rig)
        yield zero_torque(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, tick_s), rig)

    def _rest(self, rig: Rig, name: str, command: float) -> Segment:
        """A motor is let go of at once; a servo that holds a velocity would brake as hard as it can: it is led."""
        still = hold(0.0, REST_S, rig.tick_s)
        led = still if rig.servo is None else np.concatenate([ramp(command, 0.0, MOVE_S, rig.tick_s), still])
        return zero_torque(self.name, name, Use.PREPARE, led, rig)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        if known.rig.holds_position:
            return replace(known, command_span=(-goal_span(known), goal_span(known)))
        searches = [segment for segment in measured.segments if segment.name == "search"]
        ends = [measured.between(s.start_ns, s.end_ns).ticks["command"][-1] for s in searches]
        low, high = self._span_within(known, ends)
        for segment in measured.segments:
            if segment.name == TOO_FAST:
                low, high = self._slower(known, low), self._slower(known, high)
        if turned(measured) < 0.05 * self.options.amplitude * known.rig.limits.velocity_rad_s:
            raise ExperimentError(
                f"free: the actuator hardly moved up to its greatest command {known.rig.command.limit:g} "
                f"{known.rig.command.unit}; raise [actuator] command limit, or free the shaft"
            )
        return replace(known, command_span=(low, high))

    def _climb(self, rig: Rig, low: float, high: float) -> Generator[Segment, Measured, bool]:
        """The staircase from both ends; returns whether the shaft stayed well below its velocity limit.

        Friction makes speed grow faster than torque; a calibration with little motion does not predict that.
        """
        tick_s, fastest_rad_s = rig.tick_s, FASTEST_SHARE * rig.limits.velocity_rad_s
        for name, levels in self._stairs(low, high):
            there, back = ramp(0.0, levels[0], MOVE_S, tick_s), ramp(levels[-1], 0.0, MOVE_S, tick_s)
            stairs = staircase(levels, self.options.dwell_s, tick_s)
            for segment in (
                zero_torque(
                    self.name, f"approach {name}", Use.PREPARE, there, rig, stop_at_velocity_rad_s=fastest_rad_s
                ),
                zero_torque(
                    self.name, f"staircase {name}", Use.IDENTIFY, stairs, rig, stop_at_velocity_rad_s=fastest_rad_s
                ),
            ):
                measured = yield segment
                ended_early = len(measured.ticks) < segment.ticks
                if ended_early and abs(measured.ticks["velocity_rad_s"][-1]) >= fastest_rad_s:
                    yield self._rest(rig, TOO_FAST, float(measured.ticks["command"][-1]))
                    return False
            yield zero_torque(self.name, f"leave {name}", Use.PREPARE, back, rig)
        return True

    def _slower(self, known: Knowledge, command: float) -> float:
        """One end of the span, made smaller: less of the part of the command beyond friction."""
        taken = 0.0 if known.tare is None or known.tare.moving_command is None else abs(known.tare.moving_command)
        beyond = max(abs(command) - taken, 0.0)
        return float(np.copysign(abs(command) - beyond * (1.0 - self.options.amplitude / FASTEST_SHARE), command))

    def _span_within(self, known: Knowledge, ends: Sequence[float]) -> tuple[float, float]:
        """The ends of the span, made smaller where the shaft would become too fast with time.

        The search ends when the speed is reached. A shaft with much inertia and little damping would still accelerate;
        where the calibration is good enough, the staircase is simulated.
        """
        low, high, tick_s = float(min(ends)), float(max(ends)), known.tick_s
        # One staircase after the other: a shaft that gains speed slowly loses it slowly, too.
        stairs = [
            part
            for _, levels in self._stairs(low, high)
            for part in (
                ramp(0.0, levels[0], MOVE_S, tick_s),
                staircase(levels, self.options.dwell_s, tick_s),
                ramp(levels[-1], 0.0, MOVE_S, tick_s),
            )
        ]
        share = free_within(bounds_of(known), np.concatenate(stairs))
        return share * low, share * high

    def _stairs(self, low: float, high: float) -> list[tuple[str, FloatArray]]:
        levels = np.linspace(low, high, self.options.levels)
        return [("rising", levels), ("falling", levels[::-1])]


def command_multisine(
    known: Knowledge, span: tuple[float, float], duration_s: float, seed: int, high_hz: float | None = None
) -> FloatArray:
    """A multisine that fills ``span`` from a fifth of a hertz to ``high_hz``, or as far as any goes."""
    low, high = span
    high_hz = highest_hz(known.tick_s) if high_hz is None else high_hz
    wave = multisine(duration_s, known.tick_s, low_hz=0.2, high_hz=high_hz, seed=seed, slope=-0.25)
    return 0.5 * (high + low) * np.abs(wave) + MULTISINE_SHARE * 0.5 * (high - low) * wave
