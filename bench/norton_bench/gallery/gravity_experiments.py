"""What is done with a motor on which an arm hangs, and another behind its port: let go, at either port."""

from dataclasses import dataclass
from typing import ClassVar

from norton_bench.gallery.moves import let_go, place_rad, swept
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.makers import zero_torque
from norton_bench.procedures.waves import hold, ramp
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

PORTS = ACTUATOR, EXTERNAL = "actuator", "external"
LEVEL = 0.8  # of the greatest command
SIGNS = (1.0, -1.0)
# Let go from so far on either side, and how.
AWAY_RAD, SPEED_RAD_S = 0.25, 0.5
EASING_S, SETTLE_S, LOOK_S, LEAVE_S = 1.0, 1.0, 0.3, 1.0
# Under zero torque the load drive shivers, and friction lets go of the shaft little by little: in about two seconds.
FORGET_S = 4.0


@dataclass(frozen=True)
class TwoPorts:
    """The same command at the actuator's port, whose torque is held at zero, and at the external one, left alone.

    Each round is done with the command in either sign: half of the difference is free of the torque sensor's zero. At
    the actuator's port the bench carries the arm behind it; at the external port the motor carries both.
    """

    rounds: int = 4
    name: ClassVar[str] = "gallery ports"

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "on which the second arm hangs")

    def duration_s(self, rig: Rig) -> float:
        away_s = 2 * AWAY_RAD / SPEED_RAD_S + 0.4
        each_s = LEAVE_S + SETTLE_S + 4 * away_s + 2 * (EASING_S + SETTLE_S + FORGET_S)
        return self.rounds * len(SIGNS) * each_s + LEAVE_S

    def plan(self, known: Knowledge) -> Plan:
        rig, tick_s, before = known.rig, known.tick_s, 0.0
        for _ in range(self.rounds):
            for sign in SIGNS:
                command = sign * LEVEL * rig.command.limit
                yield zero_torque(self.name, "change", Use.PREPARE, ramp(before, command, LEAVE_S, tick_s), rig)
                held = hold(command, SETTLE_S, tick_s)
                rested = yield zero_torque(self.name, "settle", Use.PREPARE, held, rig)
                yield from self._both(rig, command, sign, place_rad(rested))
                before = command
        yield zero_torque(self.name, "end", Use.PREPARE, ramp(before, 0.0, LEAVE_S, tick_s), rig)

    def _both(self, rig: Rig, command: float, sign: float, place: float) -> Plan:
        """Let go from either side, at the one port and then at the other, about where the shaft was seen to rest."""
        here_rad, tick_s = place, rig.tick_s
        for port in PORTS:
            middle_rad = place
            for side, name in ((-1.0, "below"), (1.0, "above")):
                away_rad = middle_rad + sign * side * AWAY_RAD - here_rad
                away = yield swept(self.name, "away", command, away_rad, SPEED_RAD_S, tick_s)
                label = f"{port} {name} {sign:+.0f}"
                if port == ACTUATOR:
                    rested = yield zero_torque(self.name, label, Use.PREPARE, hold(command, FORGET_S, tick_s), rig)
                else:
                    rested = yield let_go(self.name, label, command, away, EASING_S, SETTLE_S, tick_s)
                here_rad = middle_rad = place_rad(rested)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
