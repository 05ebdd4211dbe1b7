"""What is done with the motor: held free, moved steadily, and brought to rest, again and again, in both directions.

Every experiment comes in pairs, the second with command and motion reversed: what the torque sensor's zero adds to
both cancels. Commands are multiples of the threshold at which the bench's own calibration
found that the motor begins to turn.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.waves import Motion, from_velocity, hold, imposed, pushed, ramp, zero_torque
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

SIDES = (1.0, -1.0)
MOVE_S, REST_S = 0.1, 0.3

# Free: the command in multiples of the threshold. The last part of a dwell is looked at, after some ten time constants.
FREE_LEVELS = (0.5, 1.6, 2.4, 3.3)
FREE_DWELL_S, FREE_LOOK_S = 0.8, 0.3

# Steady: velocities in multiples of the free one, under one command.
STEADY_LEVEL = 2.4
STEADY_SHARES = (0.2, 0.5, 0.8, 1.1)
STEADY_CHANGE_S, STEADY_DWELL_S, STEADY_LOOK_S = 0.2, 0.4, 0.3

# Stops: from a creep, the load's torque is taken back by so much, until friction holds the shaft.
STOP_LEVEL = 2.4
TAKEN_BACK_NM = (1.4e-3, 1.8e-3, 2.2e-3, 2.6e-3)
STOP_ROUNDS = 2
APPROACH_RAD_S, CREEP_RAD_S, CREEP_S = 2.0, 0.1, 0.25
# Torque that goes with the position must not be the same at every stop: each approach is longer by another share of
# half a radian, evenly spread (multiples of the golden ratio).
LONGER_S, GOLDEN = 0.25, 0.618034
STOP_S, STOP_LOOK_S = 0.5, 0.3

# Deviation: the port's velocity deviates from the source's by the same, to and fro, once because the port changes its
# velocity and once because the source does. Velocities in multiples of the free one, under one command.
DEVIATION_LEVEL = 2.4
DEVIATION_SHARES = (0.35, 0.85)
DEVIATION_RAMP_S, DEVIATION_RAMPS, DEVIATION_LEAD_S = 0.1, 8, 0.3
OF_PORT, OF_SOURCE = "port", "source"


@dataclass(frozen=True)
class _Motor:
    """What all of them have in common."""

    name: ClassVar[str]

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "to hold the port")

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known


@dataclass(frozen=True)
class FreeLevels(_Motor):
    """Zero torque at the port while each command is held, approached from below and from above by turns."""

    rounds: int = 6
    name: ClassVar[str] = "gallery free"

    def duration_s(self, rig: Rig) -> float:
        return self.rounds * 2 * len(FREE_LEVELS) * FREE_DWELL_S + REST_S

    def plan(self, known: Knowledge) -> Plan:
        threshold = threshold_of(known)
        for turn in range(self.rounds):
            rising = turn % 2 == 0
            for level in FREE_LEVELS if rising else FREE_LEVELS[::-1]:
                for side in SIDES:
                    label = f"{level:g} {side:+.0f} {'below' if rising else 'above'}"
                    command = self._command(threshold * side * level, threshold * side, rising, known.tick_s)
                    yield zero_torque(self.name, label, Use.PREPARE, command, known.rig)
        yield zero_torque(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, known.tick_s), known.rig)

    @staticmethod
    def _command(level: float, threshold: float, rising: bool, tick_s: float) -> FloatArray:
        """From one threshold below it, or above it, to the level."""
        start = level - threshold if rising else level + threshold
        before = hold(start, FREE_DWELL_S / 4, tick_s)
        return np.concatenate([before, hold(level, FREE_DWELL_S, tick_s)])


@dataclass(frozen=True)
class SteadySpeeds(_Motor):
    """One command, several velocities imposed."""

    rounds: int = 5
    name: ClassVar[str] = "gallery steady"

    def duration_s(self, rig: Rig) -> float:
        return self.rounds * 2 * len(STEADY_SHARES) * (STEADY_CHANGE_S + STEADY_DWELL_S)

    def plan(self, known: Knowledge) -> Plan:
        tick_s, before = known.tick_s, 0.0
        command, free_rad_s = STEADY_LEVEL * threshold_of(known), free_velocity_rad_s(known, STEADY_LEVEL)
        held = hold(0.0, STEADY_DWELL_S, tick_s)
        for turn in range(self.rounds):
            for share in STEADY_SHARES if turn % 2 == 0 else STEADY_SHARES[::-1]:
                for side in SIDES:
                    speed = side * share * free_rad_s
                    velocity = np.concatenate([ramp(before, speed, STEADY_CHANGE_S, tick_s), held + speed])
                    levels = np.full(len(velocity), side * command)
                    motion = from_velocity(velocity, tick_s)
                    yield imposed(self.name, f"{share:g} {side:+.0f}", Use.PREPARE, levels, motion)
                    before = speed
        stop = ramp(before, 0.0, STEADY_CHANGE_S, tick_s)
        yield imposed(self.name, "rest", Use.PREPARE, 0.0 * stop, from_velocity(stop, tick_s))


@dataclass(frozen=True)
class SameDeviation(_Motor):
    """The same deviation of the port from the source, at the same rate, by an acceleration of either of them."""

    rounds: int = 5
    name: ClassVar[str] = "gallery deviation"

    def duration_s(self, rig: Rig) -> float:
        return self.rounds * 4 * (2 * DEVIATION_LEAD_S + DEVIATION_RAMPS * DEVIATION_RAMP_S)

    def plan(self, known: Knowledge) -> Plan:
        tick_s, level = known.tick_s, DEVIATION_LEVEL * threshold_of(known)
        assert known.actuator is not None
        command_s_rad = known.actuator.network.viscous_damping_nms_rad / known.actuator.network.torque_gain
        steps = round(DEVIATION_RAMP_S / tick_s)
        up = np.arange(1, steps + 1) / steps
        swing = np.tile(np.concatenate([up, 1.0 - up]), DEVIATION_RAMPS // 2)
        least, most = (share * free_velocity_rad_s(known, DEVIATION_LEVEL) for share in DEVIATION_SHARES)
        still = np.zeros(swing.size)
        for _ in range(self.rounds):
            for side in SIDES:
                for moving in (OF_PORT, OF_SOURCE):
                    # The port goes up from its least velocity and back, or the source down from its greatest.
                    port, source = (swing, still) if moving == OF_PORT else (still, -swing)
                    velocity = least + (most - least) * port
                    command = level + command_s_rad * (most - least) * source
                    lead, tail = (ramp(*ends, DEVIATION_LEAD_S, tick_s) for ends in ((0.0, least), (least, 0.0)))
                    motion = from_velocity(side * np.concatenate([lead, velocity, tail]), tick_s)
                    rise, fall = (ramp(*ends, DEVIATION_LEAD_S, tick_s) for ends in ((0.0, level), (level, 0.0)))
                    commands = side * np.concatenate([rise, command, fall])
                    yield imposed(self.name, f"{moving} {side:+.0f}", Use.PREPARE, commands, motion)


@dataclass(frozen=True)
class SlowStops(_Motor):
    """Slow approaches of a blocked port from either side, under commands of either sign.

    The shaft creeps under imposed motion; then the load gives the mean of the torque that this took, less a little,
    and friction of both machines holds the shaft. A load drive that held the position would shiver by microradians,
    and friction's contact forgets how it came to rest (docs/gallery.md).
    """

    name: ClassVar[str] = "gallery stops"

    def duration_s(self, rig: Rig) -> float:
        return len(list(self._all())) * (3 * MOVE_S + 0.5 * LONGER_S + CREEP_S + STOP_S)

    def plan(self, known: Knowledge) -> Plan:
        tick_s, level = known.tick_s, STOP_LEVEL * threshold_of(known)
        for count, (taken_nm, sign, side) in enumerate(self._all()):
            label, command = f"{taken_nm:g} {sign:+.0f} {side:+.0f}", sign * level
            approach = self._approach(side, count * GOLDEN % 1.0, tick_s)
            commands = np.full(len(approach.velocity_rad_s), command)
            rise = ramp(0.0, command, MOVE_S, tick_s)
            commands[: len(rise)] = rise
            crept = yield imposed(self.name, f"creep {label}", Use.PREPARE, commands, approach)
            ticks = round(0.6 * CREEP_S / tick_s)
            needed_nm = float(np.mean(crept.ticks["load_torque_nm"][-ticks:]))
            eased_nm = needed_nm - side * taken_nm
            easing = ramp(needed_nm, eased_nm, STOP_S / 4, tick_s)
            back_nm = np.concatenate([easing, hold(eased_nm, 3 * STOP_S / 4, tick_s)])
            yield pushed(self.name, f"stop {label}", Use.PREPARE, back_nm, np.full(len(back_nm), command))
            yield imposed(self.name, "release", Use.PREPARE, ramp(command, 0.0, MOVE_S, tick_s))

    @staticmethod
    def _all() -> Iterator[tuple[float, float, float]]:
        """What is taken back, the command's sign, and the side of approach; what mirrors each other is adjacent."""
        for _ in range(STOP_ROUNDS):
            for taken_nm in TAKEN_BACK_NM:
                for with_command in SIDES:
                    for sign in SIDES:
                        yield taken_nm, sign, sign * with_command

    @staticmethod
    def _approach(side: float, longer: float, tick_s: float) -> Motion:
        fast, slow = side * APPROACH_RAD_S, side * CREEP_RAD_S
        parts = (
            ramp(0.0, fast, MOVE_S, tick_s),
            hold(fast, longer * LONGER_S, tick_s),
            ramp(fast, slow, MOVE_S, tick_s),
            hold(slow, CREEP_S, tick_s),
        )
        return from_velocity(np.concatenate(parts), tick_s)


def threshold_of(known: Knowledge) -> float:
    """The command at which the motor begins to turn, as far as the calibration tells. Raises ExperimentError."""
    if known.actuator is None or not known.actuator.converged:
        raise ExperimentError("the calibration did not tell at which command the motor turns: nothing can be chosen")
    return known.actuator.network.thresholds[1]


def free_velocity_rad_s(known: Knowledge, level: float) -> float:
    """How fast it then turns at so many thresholds, likewise."""
    command = level * threshold_of(known)
    assert known.actuator is not None
    return float(known.actuator.network.source_velocity(command))
