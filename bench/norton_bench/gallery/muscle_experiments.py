"""What is done with the pneumatic muscle: let go from either side of its source, and swept slowly across it."""

from dataclasses import dataclass
from typing import ClassVar

from norton_bench.gallery.moves import place_rad, swept
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.makers import zero_torque
from norton_bench.procedures.waves import hold, ramp
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

# Commands as shares of the greatest; both ends of a sweep, and its speed.
LEVELS = (0.5, 1.0)
REACH_RAD, SPEED_RAD_S = 0.45, 0.4
SETTLE_S, LOOK_S, LEAVE_S = 1.2, 0.3, 0.5
REFERENCES, REFERENCE_RAD = 4, 0.15


@dataclass(frozen=True)
class MuscleSweeps:
    """Under each command: the free port's place, reached from either side, and the torque along slow sweeps."""

    rounds: int = 5
    name: ClassVar[str] = "gallery muscle"

    def require(self, rig: Rig) -> None:
        require_load(rig, self.name, "to move the port")

    def duration_s(self, rig: Rig) -> float:
        each_s = 2 * (2 * REACH_RAD / SPEED_RAD_S + REACH_RAD / SPEED_RAD_S + SETTLE_S + 0.6)
        reference_s = SETTLE_S + 2 * REFERENCES * (2 * REFERENCE_RAD / SPEED_RAD_S + 0.2)
        return self.rounds * len(LEVELS) * (each_s + LEAVE_S + SETTLE_S) + reference_s

    def plan(self, known: Knowledge) -> Plan:
        rig, tick_s, before = known.rig, known.tick_s, 0.0
        for _ in range(self.rounds):
            for share in LEVELS:
                command = share * rig.command.limit
                yield zero_torque(self.name, "change", Use.PREPARE, ramp(before, command, LEAVE_S, tick_s), rig)
                held = hold(command, SETTLE_S, tick_s)
                rested = yield zero_torque(self.name, "settle", Use.PREPARE, held, rig)
                centre_rad = here_rad = place_rad(rested)
                for side, name in ((-1.0, "up"), (1.0, "down")):
                    away_rad = centre_rad + side * REACH_RAD - here_rad
                    yield swept(self.name, "away", command, away_rad, SPEED_RAD_S, tick_s)
                    across_rad = -2 * side * REACH_RAD
                    yield swept(self.name, f"sweep {name} {share:g}", command, across_rad, SPEED_RAD_S, tick_s)
                    rested = yield zero_torque(self.name, f"free {name} {share:g}", Use.PREPARE, held, rig)
                    here_rad = place_rad(rested)
                before = command
        yield zero_torque(self.name, "leave", Use.PREPARE, ramp(before, 0.0, LEAVE_S, tick_s), rig)
        yield from self._reference(known)

    def _reference(self, known: Knowledge) -> Plan:
        """Where the tare was taken, without a command: what the torque sensor reads there now has drifted since."""
        rig, tick_s = known.rig, known.tick_s
        rested = yield zero_torque(self.name, "settle", Use.PREPARE, hold(0.0, SETTLE_S, tick_s), rig)
        away_rad = -REFERENCE_RAD - place_rad(rested)
        yield swept(self.name, "away", 0.0, away_rad, SPEED_RAD_S, tick_s)
        for _ in range(REFERENCES):
            for name, across_rad in (("up", 2 * REFERENCE_RAD), ("down", -2 * REFERENCE_RAD)):
                yield swept(self.name, f"reference {name} 0", 0.0, across_rad, SPEED_RAD_S, tick_s)
        yield zero_torque(self.name, "leave", Use.PREPARE, hold(0.0, LEAVE_S, tick_s), rig)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known
