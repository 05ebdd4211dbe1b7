"""What is done with a motor on which an arm hangs, and another behind its port: let go, at either port."""

from dataclasses import dataclass
from functools import cached_property, partial
from math import asin
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure

from norton_bench.arrays import FloatArray
from norton_bench.gallery.claim import PaperExperiment, Shown, let_go, mean, place_rad, row, swept
from norton_bench.gallery.impedances import Impedances, port_impedances
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.waves import hold, ramp, zero_torque
from norton_bench.records import Measured, SegmentInfo
from norton_bench.report.figures_network import legend
from norton_bench.report.svg import MEASURED, PREDICTED, figure
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


@dataclass(frozen=True)
class Arms:
    """The true arms, and where the bench saw them rest."""

    experiment: PaperExperiment

    @cached_property
    def command(self) -> float:
        chosen = self._let_go(ACTUATOR, "below", SIGNS[0])[0]
        inside = self.experiment.measured.between(chosen.start_ns, chosen.end_ns)
        return float(np.mean(inside.ticks["command"]))

    def source_rad(self, port: str) -> float:
        """Where the motor's torque carries the arms: its own alone at the actuator's port, both at the external one."""
        true = self.experiment.true
        carried_nm = true["gravity"] + (true["load_gravity"] if port == EXTERNAL else 0.0)
        return asin(true["torque_gain"] * self.command / carried_nm)

    def rests_rad(self, port: str, side: str) -> FloatArray:
        """Where the shaft came to rest, let go from one side, half the difference of either sign (rounds,)."""
        ends = [
            [
                float(np.mean(self.experiment.measured.between(first_ns, each.end_ns).motion["position_rad"]))
                for each in self._let_go(port, side, sign)
                for first_ns in (each.end_ns - round(LOOK_S * 1e9),)
            ]
            for sign in SIGNS
        ]
        return np.asarray(0.5 * (np.array(ends[0]) - np.array(ends[1])))

    def _let_go(self, port: str, side: str, sign: float) -> list[SegmentInfo]:
        return self.experiment.segments(TwoPorts.name, f"{port} {side} {sign:+.0f}")

    def source_seen_rad(self, port: str) -> FloatArray:
        """The middle between what friction leaves open, one a round."""
        return np.asarray(0.5 * (self.rests_rad(port, "below") + self.rests_rad(port, "above")))


def claims(experiment: PaperExperiment) -> tuple[Shown, ...]:
    """All of them. Raises ExperimentError where the recording lacks what they need."""
    return two_ports(Arms(experiment)), port_impedances(Impedances(experiment))


def two_ports(arms: Arms) -> Shown:
    name = "two ports"
    actuator, external = (arms.source_rad(port) for port in PORTS)
    seen = {port: arms.source_seen_rad(port) for port in PORTS}
    rows = (
        row(name, "source at the actuator's port", "rad", actuator, mean(seen[ACTUATOR]), external),
        row(name, "source at the external port", "rad", external, mean(seen[EXTERNAL]), actuator),
        row(name, "how far they lie apart", "rad", actuator - external, mean(seen[ACTUATOR] - seen[EXTERNAL]), 0.0),
    )
    return Shown(
        name,
        "Two ports of one actuator have two sources",
        "IV.C",
        "What lies between the ports (here an arm's weight) parts their sources: θ̂_N = θ_N + Z_A⁻¹(Z_G(θ_N)).",
        rows,
        partial(draw_two_ports, arms),
        "Where the shaft rested under one command, round by round and by the side from which it was let go: with no "
        "torque at the actuator's port, and with none at the external one (half differences of either sign). Lines are "
        "the closed forms.",
    )


NAMES = {"actuator": "θ̂_N, actuator's port", "external": "θ_N, external port"}


def draw_two_ports(arms: "Arms") -> Figure:
    picture = figure(3.4)
    axes = picture.subplots()
    for place, (port, name) in enumerate(NAMES.items()):
        style = "-" if place == 0 else (0, (4, 3))
        axes.axhline(arms.source_rad(port), color=PREDICTED, linestyle=style, label=name)
        for side, marker in (("above", "v"), ("below", "^")):
            rests = arms.rests_rad(port, side)
            rounds = np.arange(1, rests.size + 1)
            label = f"let go from {side}" if place == 0 else None
            axes.plot(
                rounds, rests, linestyle="none", marker=marker, color=MEASURED, markersize=4.5, label=label,
                markerfacecolor="none" if side == "above" else MEASURED,
            )  # fmt: skip
    axes.set_xticks(rounds)
    axes.set_xlabel("round")
    axes.set_ylabel("place of rest [rad]")
    legend(axes)
    return picture
