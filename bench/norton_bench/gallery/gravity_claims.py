"""The claim of section IV.C, from the experiments with a motor between two hanging arms."""

from dataclasses import dataclass
from functools import cached_property, partial
from math import asin

import numpy as np
import numpy.typing as npt

from norton_bench.gallery import gravity_figures as figures
from norton_bench.gallery.claim import Experiment, Shown, row
from norton_bench.gallery.gravity_experiments import ACTUATOR, EXTERNAL, LOOK_S, PORTS, SIGNS, TwoPorts
from norton_bench.gallery.repeated import mean
from norton_bench.records import SegmentInfo

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Arms:
    """The true arms, and where the bench saw them rest."""

    experiment: Experiment

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
        segments, label = self.experiment.measured.segments, f"{port} {side} {sign:+.0f}"
        return [each for each in segments if each.procedure == TwoPorts.name and each.name == label]

    def source_seen_rad(self, port: str) -> FloatArray:
        """The middle between what friction leaves open, one a round."""
        return np.asarray(0.5 * (self.rests_rad(port, "below") + self.rests_rad(port, "above")))


def claims(experiment: Experiment) -> tuple[Shown, ...]:
    """All of them. Raises ExperimentError where the recording lacks what they need."""
    return (two_ports(Arms(experiment)),)


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
        partial(figures.two_ports, arms),
        "Where the shaft rested under one command, round by round and by the side from which it was let go: with no "
        "torque at the actuator's port, and with none at the external one (half differences of either sign). Lines are "
        "the closed forms.",
    )
